"""Heads: descriptions and weights that somebody changed, and released files that are none."""

import io
import json
import os
import pickle
import shutil
import struct
import zipfile
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

from .harness import ACCEPTED, REFUSED, Attack
from .workdir import JUNK, edit, flip
from .world import World

PREDICT = (
    "predict",
    "--work",
    "work",
    "--head",
    "head",
    "--caption",
    "a bed and a chair",
)


class Runs:
    """A pickle that would run a command."""

    def __reduce__(self) -> tuple[Any, ...]:
        return os.system, ("touch owned",)


def released(change: Callable[[dict[str, Any]], object] | None = None) -> dict[str, Any]:
    """A checkpoint in the form of the released ones, of random weights; small ones."""
    import torch

    # Sizes and names of the smaller released architecture; zeros but for a few.
    layers = {
        "scene_feat_net": (1024, 512, 256, 256),
        "shift_net": (256, 128, 64, 1),
        "scale_net": (256, 128, 64, 1),
    }
    model = {}
    for net, sizes in layers.items():
        for number, (before, after) in enumerate(pairwise(sizes)):
            model[f"module.{net}.{2 * number}.weight"] = torch.zeros(after, before) + 0.01
            model[f"module.{net}.{2 * number}.bias"] = torch.zeros(after)
    content = {"model": model, "global_step": 7}
    content["best_eval_measures_nyu"] = torch.arange(9) / 10
    if change:
        change(content)
    return content


def save(content: Any, path: Path) -> None:
    import torch

    torch.save(content, path)


def deflated(path: Path) -> None:
    """A .pt file whose storages are deflated zeros: 5 GB out of some MB."""
    save(released(), path)
    made = io.BytesIO()
    with (
        zipfile.ZipFile(path) as old,
        zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as new,
    ):
        for item in old.infolist():
            if item.filename.endswith("/data/0"):
                with new.open(item.filename, "w", force_zip64=True) as file:
                    for _ in range(5 * 64):
                        file.write(bytes(1 << 24))
            else:
                new.writestr(item.filename, old.read(item))
    path.write_bytes(made.getvalue())


def stored_large(path: Path) -> None:
    """A storage that its pickle says is larger than the file."""
    save(released(), path)
    data = path.read_bytes()
    path.write_bytes(data.replace(b"\x80\x02", b"\x80\x02", 1)[: len(data) - 4000])


def strided(content: dict[str, Any]) -> None:
    import torch

    content["model"]["module.scene_feat_net.0.weight"] = torch.zeros(1).expand(100_000, 100_000)


def _first(value: Any) -> Callable[[dict[str, Any]], object]:
    return lambda c: c["model"].update({"module.scene_feat_net.0.weight": value()})


def _imports() -> Iterator[tuple[str, Callable[[Path], object]]]:
    import torch  # only its names: no work is done here

    def changed(change: Callable[[dict[str, Any]], object]) -> Callable[[Path], object]:
        return lambda path: save(released(change), path)

    yield "nothing in it", lambda p: p.write_bytes(b"")
    yield "no checkpoint", lambda p: p.write_bytes(b"\0" * 5000)
    yield "text", lambda p: p.write_text("hello\x1b[31m")
    yield "a folder", lambda p: p.mkdir()
    yield "a pipe", lambda p: os.mkfifo(p)
    yield "sparse, 20 GB", lambda p: (p.touch(), os.truncate(p, 20 << 30))
    yield "a pickle that runs", lambda p: p.write_bytes(pickle.dumps(Runs()))
    yield "an entry that runs", lambda p: save(released(lambda c: c.update(x=Runs())), p)
    yield "deflated to 5 GB", deflated
    yield "cut", stored_large
    yield "expanded to 40 GB", changed(strided)
    yield "no model", changed(lambda c: c.pop("model"))
    yield "model is text", changed(lambda c: c.update(model="x"))
    yield "model is empty", changed(lambda c: c.update(model={}))
    yield "a weight is text", changed(_first(lambda: "x"))
    yield "a weight is None", changed(_first(lambda: None))
    yield "a weight is a list", changed(_first(lambda: [1.0]))
    yield "a weight of one side", changed(_first(lambda: torch.zeros(512)))
    yield "a weight of no sides", changed(_first(lambda: torch.tensor(0.0)))
    yield "another shape", changed(_first(lambda: torch.zeros(512, 1000)))
    yield "no columns", changed(_first(lambda: torch.zeros(512, 0)))
    yield "nan", changed(_first(lambda: torch.full((512, 1024), float("nan"))))
    yield "inf", changed(_first(lambda: torch.full((512, 1024), float("inf"))))
    yield (
        "past float32",
        changed(_first(lambda: torch.full((512, 1024), 1e300, dtype=torch.float64))),
    )
    yield "complex", changed(_first(lambda: torch.zeros(512, 1024, dtype=torch.complex64)))
    yield "whole numbers", changed(_first(lambda: torch.zeros(512, 1024, dtype=torch.int64)))
    yield "truths", changed(_first(lambda: torch.zeros(512, 1024, dtype=torch.bool)))
    yield "sparse tensor", changed(_first(lambda: torch.zeros(512, 1024).to_sparse()))
    yield "meta tensor", changed(_first(lambda: torch.zeros(512, 1024, device="meta")))
    yield "numbers as names", changed(lambda c: c["model"].update({3: torch.zeros(1)}))
    yield "one weight too many", changed(lambda c: c["model"].update(more=torch.zeros(1)))
    yield "one weight too few", changed(lambda c: c["model"].pop("module.shift_net.0.bias"))
    yield "measures are text", changed(lambda c: c.update(best_eval_measures_nyu="x"))
    yield "ten measures", changed(lambda c: c.update(best_eval_measures_nyu=torch.zeros(10)))
    yield (
        "measures are nested",
        changed(lambda c: c.update(best_eval_measures_nyu=torch.zeros(9, 2))),
    )
    yield (
        "measures are nan",
        changed(lambda c: c.update(best_eval_measures_nyu=torch.full((9,), torch.nan))),
    )
    yield "step is a tensor", changed(lambda c: c.update(global_step=torch.zeros(3)))
    yield "step is text", changed(lambda c: c.update(global_step="\x1b[31m"))
    yield (
        "measures by control characters",
        changed(lambda c: c.update({"best_eval_measures_\x1b[31mx": torch.zeros(9)})),
    )


def _tensors() -> Iterator[tuple[str, Callable[[Path], object]]]:
    """Changes of head.safetensors."""

    def header(change: Callable[[dict[str, Any]], object]) -> Callable[[Path], object]:
        def write(path: Path) -> None:
            data = path.read_bytes()
            size = struct.unpack("<Q", data[:8])[0]
            content = json.loads(data[8 : 8 + size])
            change(content)
            text = json.dumps(content).encode()
            path.write_bytes(struct.pack("<Q", len(text)) + text + data[8 + size :])

        return write

    def numbers(name: str, value: float) -> Callable[[Path], object]:
        def write(path: Path) -> None:
            from safetensors.torch import load, save

            tensors = load(path.read_bytes())
            tensors[name].view(-1)[0] = value
            path.write_bytes(save(tensors))

        return write

    yield "a header of 2^60 bytes", lambda p: p.write_bytes(struct.pack("<Q", 1 << 60) + b"{}")
    yield (
        "a header nested deep",
        lambda p: p.write_bytes(struct.pack("<Q", 200_000) + b"[" * 200_000),
    )
    yield "empty", lambda p: p.write_bytes(b"")
    yield "sparse, 20 GB", lambda p: os.truncate(p, 20 << 30)
    yield "a pipe", lambda p: (p.unlink(), os.mkfifo(p))
    yield "overlapping offsets", header(lambda h: h["mean"].update(h["factor"]))
    yield "another dtype", header(lambda h: h["mean"].update(dtype="I32"))
    yield "a shape too large", header(lambda h: h["mean"].update(shape=[1 << 40]))
    yield "a name with control characters", header(lambda h: h.update({"\x1b[31m": h.pop("mean")}))
    for name in ("mean", "factor", "reference"):
        for value in (float("nan"), float("inf"), -float("inf")):
            yield f"{name} {value}", numbers(name, value)
    for share in (0.2, 0.35, 0.5, 0.65, 0.8, 0.99):
        for bit in (0, 6):
            yield f"bit {bit} at {share}", lambda p, s=share, b=bit: flip(p, s, b)


def _descriptions() -> Iterator[tuple[str, Callable[[dict[str, Any]], object]]]:
    """Changes of head.json."""
    yield "format 99", lambda d: d.update(format=99)
    yield "an architecture that runs", lambda d: d["architecture"].update(name="os:system")
    yield "an architecture of a file", lambda d: d["architecture"].update(name="evil:Evil")
    yield "dim 2^14", lambda d: d["features"].update(dim=2**14)
    yield "dim 2^60", lambda d: d["features"].update(dim=2**60)
    yield "dim -1", lambda d: d["features"].update(dim=-1)
    yield "dim text", lambda d: d["features"].update(dim="384")
    yield "dim 384.5", lambda d: d["features"].update(dim=384.5)
    yield "an option too large", lambda d: d["architecture"].update(name="mlp5", width=2**40)
    yield "another architecture", lambda d: d["architecture"].update(name="mlp5")
    yield "no architecture", lambda d: d.pop("architecture")
    yield "no features", lambda d: d.pop("features")
    yield "far nan", lambda d: d.update(far=float("nan"))
    yield "prior text", lambda d: d.update(prior={"scale": "x", "shift": 1, "correlation": 0})
    yield "a style with control characters", lambda d: d["features"].update(style="\x1b[31m\x07")
    yield "an encoder with control characters", lambda d: d["features"].update(encoder="\x1b[2J")
    yield "an encoder that runs", lambda d: d["features"].update(encoder="os:system")
    yield "an encoder of a folder", lambda d: d["features"].update(encoder="hf:../../evil")


def _exported() -> Iterator[tuple[str, Callable[[Path], object]]]:
    """Changes of a file of export-head; see `_tensors` for others."""

    def header(change: Callable[[dict[str, Any]], object]) -> Callable[[Path], object]:
        """Changes what the metadata says of the head."""

        def write(path: Path) -> None:
            data = path.read_bytes()
            size = struct.unpack("<Q", data[:8])[0]
            content = json.loads(data[8 : 8 + size])
            about = json.loads(content["__metadata__"]["head.json"])
            change(about)
            content["__metadata__"]["head.json"] = json.dumps(about)
            text = json.dumps(content).encode()
            path.write_bytes(struct.pack("<Q", len(text)) + text + data[8 + size :])

        return write

    def whole(text: str) -> Callable[[Path], object]:
        def write(path: Path) -> None:
            data = path.read_bytes()
            size = struct.unpack("<Q", data[:8])[0]
            content = json.loads(data[8 : 8 + size])
            content["__metadata__"]["head.json"] = text
            made = json.dumps(content).encode()
            path.write_bytes(struct.pack("<Q", len(made)) + made + data[8 + size :])

        return write

    for name, change in _descriptions():
        yield name, header(change)
    yield "nested deep", whole("[" * 100_000)
    yield "nothing", whole("")
    yield "control characters", whole('{"\x1b[31m": "\\u001b[2J"}')
    yield "5,000 digits", whole('{"format": ' + "9" * 5000 + "}")
    yield "a pipe", lambda p: (p.unlink(), os.mkfifo(p))
    yield "sparse, 20 GB", lambda p: os.truncate(p, 20 << 30)
    yield "sparse, 300 MB", lambda p: os.truncate(p, 300 << 20)
    yield "cut", lambda p: p.write_bytes(p.read_bytes()[:-100])
    yield "a folder", lambda p: (p.unlink(), p.mkdir())
    # Not at the very front: there stands the model card, whose words nothing depends on.
    for share in (0.3, 0.5, 0.7, 0.99):
        yield f"bit at {share}", lambda p, s=share: flip(p, s, 3)


def attacks(world: World) -> Iterator[Attack]:
    control = ("import-head", "head.pt", "--work", "work")
    yield Attack("control: predict", PREDICT, lambda box: world.copy(box), may=ACCEPTED)
    yield Attack(
        "control: import", control, lambda box: save(released(), box / "head.pt"), may=ACCEPTED
    )
    yield Attack(
        "control: import without ending",
        ("import-head", "dpt_lanscale", "--work", "work"),
        lambda box: save(released(), box / "dpt_lanscale"),
        may=ACCEPTED,
    )
    # Harmless where it is: the numbers it holds can be read all the same.
    fine = {
        "whole numbers",
        "truths",
        "step is text",
        "step is a tensor",
        "measures are nan",
        "measures by control characters",
        "sparse tensor",
    }
    for name, make in _imports():
        yield Attack(
            f"import: {name}",
            control,
            lambda box, m=make: m(box / "head.pt"),
            may=REFUSED | ACCEPTED if name in fine else REFUSED,
            check=lambda box, said: "it ran code" if (box / "owned").exists() else None,
        )
    for name, change in _tensors():
        yield Attack(
            f"weights: {name}",
            PREDICT,
            lambda box, c=change: c(world.copy(box) / "heads/head/head.safetensors"),
        )
    for name, change in _descriptions():
        yield Attack(
            f"head.json: {name}",
            PREDICT,
            lambda box, c=change: (
                edit(world.copy(box) / "heads/head/head.json", c),
                (box / "evil.py").write_text("open('owned', 'w')\nEvil = 1\n"),
            ),
            check=lambda box, said: "it ran code" if (box / "owned").exists() else None,
        )
    head = ("predict", "--work", "none", "--head", "h.safetensors", "--caption", "a bed")

    def exported(box: Path) -> Path:
        return Path(shutil.copy(world.base / "exported.safetensors", box / "h.safetensors"))

    yield Attack("control: exported", head, exported, may=ACCEPTED)
    for name, make in _exported():
        yield Attack(
            f"exported: {name}",
            head,
            lambda box, m=make: (
                m(exported(box)),
                (box / "evil.py").write_text("open('owned', 'w')\nEvil = 1\n"),
            ),
            check=lambda box, said: "it ran code" if (box / "owned").exists() else None,
        )
    for name, data in JUNK.items():
        yield Attack(
            f"head.json: {name}",
            PREDICT,
            lambda box, b=data: (world.copy(box) / "heads/head/head.json").write_bytes(b),
        )
    for name in (
        "../work/heads/head/../../..",
        "head\x1b[31m",
        "",
        "a" * 5000,
        "no/such",
        "head\n",
    ):
        yield Attack(
            f"name: {name[:20]!r}",
            ("predict", "--work", "work", "--head", name, "--caption", "a bed"),
            lambda box: world.copy(box),
            mistakes=True,
        )

"""The work dir: damage of every kind, then commands that read it."""

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from .harness import ANY, REFUSED, Attack
from .world import World

DATASET = "synthetic-indoor"
TABLES = (
    "samples",
    "segments/coco-panoptic",
    "captions/occupancy",
    "embeddings/occupancy/minilm",
    "depth/files",
)
# Names of helper files have an underscore before them, or had none.
RECEIPT, TABLE, MANIFEST, DATA = "*part-00001.json", "*table.json", "*manifest.json", "part-00001-*"


def one(folder: Path, pattern: str) -> Path:
    """The file of that pattern, which must be there."""
    return sorted(folder.glob(pattern))[0]


def edit(path: Path, change: Callable[[dict[str, Any]], object]) -> None:
    """Changes a JSON file."""
    content = json.loads(path.read_bytes())
    change(content)
    path.write_text(json.dumps(content))


def flip(path: Path, share: float = 0.5, bit: int = 4) -> None:
    """Flips one bit of a file, so far into it."""
    data = bytearray(path.read_bytes())
    data[int(len(data) * share)] ^= 1 << bit
    path.write_bytes(data)


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def _damages() -> Iterator[tuple[str, Callable[[Path], object]]]:
    """(name, what is done to a work dir) that verify must notice."""
    for table in TABLES:

        def place(work: Path, table: str = table) -> Path:
            return work / DATASET / table

        yield f"{table}: receipt deleted", lambda w, p=place: one(p(w), RECEIPT).unlink()
        yield (
            f"{table}: receipt and data deleted",
            lambda w, p=place: (one(p(w), RECEIPT).unlink(), one(p(w), DATA).unlink()),
        )
        yield f"{table}: data deleted", lambda w, p=place: one(p(w), DATA).unlink()
        yield f"{table}: description deleted", lambda w, p=place: one(p(w), TABLE).unlink()
        yield f"{table}: one bit of data", lambda w, p=place: flip(one(p(w), DATA))
        yield f"{table}: data cut", lambda w, p=place: cut(one(p(w), DATA))
        yield (
            f"{table}: schema version 99",
            lambda w, p=place: edit(one(p(w), TABLE), lambda d: d.update(schema_version=99)),
        )
        yield (
            f"{table}: fingerprint edited",
            lambda w, p=place: edit(one(p(w), RECEIPT), lambda d: d.update(fingerprint="0" * 64)),
        )
        yield (
            f"{table}: data of another part",
            lambda w, p=place: shutil.copy(one(p(w), "part-00000-*"), one(p(w), DATA)),
        )
    captions, embeddings = TABLES[2], TABLES[3]
    yield (
        "captions: options edited",
        lambda w: edit(
            one(w / DATASET / captions, TABLE),
            lambda d: d["options"].update(seed=d["options"]["seed"] + 1),
        ),
    )
    yield (
        "embeddings: model's digest edited",
        lambda w: edit(
            one(w / DATASET / embeddings, TABLE),
            lambda d: d.update(files=dict.fromkeys(d["files"], "f" * 64)),
        ),
    )
    yield (
        "samples: split edited",
        lambda w: edit(one(w / DATASET / "samples", RECEIPT), lambda d: d.update(split="test")),
    )
    yield "dataset: samples deleted", lambda w: shutil.rmtree(w / DATASET / "samples")
    for name in ("head.safetensors", "history.parquet"):
        yield f"head: one bit of {name}", lambda w, n=name: flip(w / "heads/head" / n)
        yield f"head: {name} cut", lambda w, n=name: cut(w / "heads/head" / n)
        yield f"head: {name} deleted", lambda w, n=name: (w / "heads/head" / n).unlink()
    yield (
        "head: one bit of metrics",
        lambda w: flip(one(w / "heads/head", "**/*metrics.parquet")),
    )
    yield (
        "head: metrics deleted",
        lambda w: one(w / "heads/head", "**/*metrics.parquet").unlink(),
    )
    yield (
        "head: head.json edited",
        lambda w: edit(w / "heads/head/head.json", lambda d: d.update(far=0.123)),
    )


# What a JSON file of the work dir may become.
JUNK: dict[str, bytes] = {
    "empty": b"",
    "null": b"null",
    "a list": b"[]",
    "an empty object": b"{}",
    "not UTF-8": b"\xff\xfe{}",
    "cut": b'{"stage": "capt',
    "nested 200,000 deep": b"[" * 200_000,
    "objects 100,000 deep": b'{"a":' * 100_000,
    "a number of 5,000 digits": b'{"part": ' + b"9" * 5000 + b', "rows": 1}',
    "infinity": b'{"part": Infinity, "rows": NaN}',
    "control characters": b'{"\\u001b[31mpart": "\\u001b]0;owned\\u0007", "file": "\\u001b[2J"}',
    "lone surrogates": b'{"stage": "\\ud800", "file": "\\udfff"}',
    "doubled keys": b'{"part": 1, "part": 2, "rows": 1}',
}


def _junk(world: World) -> Iterator[tuple[str, Callable[[Path], object]]]:
    for file, folder in (
        (TABLE, TABLES[2]),
        (RECEIPT, TABLES[2]),
        (MANIFEST, TABLES[2]),
        (TABLE, "samples"),
        (RECEIPT, "samples"),
        ("head.json", "../heads/head"),
    ):
        for name, data in JUNK.items():
            if name == "doubled keys" and file == "head.json":
                continue
            yield (
                f"{folder.rpartition('/')[2]} {file.strip('*')}: {name}",
                lambda w, f=file, d=folder, b=data: one(w / DATASET / d, f).write_bytes(b),
            )


def _receipts() -> Iterator[tuple[str, Callable[[Path], object]]]:
    """Receipts that say what cannot be."""
    lies: dict[str, Any] = {
        "file": "../../../../etc/passwd",
        "rows": -1,
        "bytes": 2**70,
        "sha256": "0" * 64,
        "digest": "f" * 64,
        "part": 7,
        "ok": "3",
        "failed": 10**30,
        "skipped": None,
    }
    for key, value in lies.items():
        yield (
            f"receipt: {key} is {str(value)[:20]}",
            lambda w, k=key, v=value: edit(
                one(w / DATASET / TABLES[2], RECEIPT), lambda d: d.update({k: v})
            ),
        )


def attacks(world: World) -> Iterator[Attack]:
    work = ("--work", "work")

    def copied(damage: Callable[[Path], object] | None) -> Callable[[Path], object]:
        return lambda box: (lambda w: damage(w) if damage else None)(world.copy(box))

    yield Attack("control: whole", ("verify", *work), copied(None), may=frozenset({"accepted"}))
    for name, damage in (*_damages(), *_receipts()):
        yield Attack(f"verify: {name}", ("verify", *work), copied(damage))
    for name, damage in _junk(world):
        yield Attack(f"verify: {name}", ("verify", *work), copied(damage))
    # Other readers: nothing that somebody did may end them otherwise than by their own error.
    for number, (name, damage) in enumerate((*_damages(), *_junk(world))):
        reader = (
            ("status", *work),
            ("train-head", *work, "--name", "other", "--head", "linear", "--epochs", "1"),
            ("export", *work, "--out", "out"),
            ("retry-failed", *work),
            ("evaluate", *work, "--head", "head", "--draws", "10"),
        )[number % 5]
        yield Attack(f"{reader[0]}: {name}", reader, copied(damage), may=ANY)
    yield from _places(world)


def _places(world: World) -> Iterator[Attack]:
    """Work dirs that are none, and names in them that lead elsewhere."""
    for command in ("verify", "status", "report", "export --out x", "train-head", "evaluate"):
        words = tuple(command.split())
        yield Attack(f"{words[0]}: no work dir", (*words, "--work", "nowhere"))
        yield Attack(
            f"{words[0]}: the work dir is a file",
            (*words, "--work", "file"),
            lambda box: (box / "file").write_text("x"),
        )
    yield Attack(
        "status: dataset named by control characters",
        ("status", "--work", "work"),
        lambda box: shutil.copytree(world.copy(box) / DATASET, box / "work" / "a\x1b[31mb\nc"),
        may=ANY,
    )
    for name, text in {
        "control characters": b"/x\x1b[31m\x07\n/y",
        "NUL": b"/tmp/\0x",
        "1 MB": b"/a" * 500_000,
        "not UTF-8": b"/\xff\xfe",
        "another scheme": b"gopher://127.0.0.1/",
        "empty": b"",
    }.items():
        yield Attack(
            f"root.txt: {name}",
            ("embed-images", "--work", "work", "--dataset", DATASET, "--encoder", "thumbnail"),
            lambda box, t=text: (world.copy(box) / DATASET / "root.txt").write_bytes(t),
            may=frozenset({"refused", "failed"}),
        )
    yield Attack(
        "status: a log of garbage",
        ("status", "--work", "work"),
        lambda box: [
            p.write_bytes(b"\xff\0[[[[" * 10000 + b"\n" + b'{"event": "part"}\n"x"\n[]\n')
            for p in (world.copy(box) / "logs").glob("*")
        ],
        may=ANY,
    )
    yield Attack(
        "status: links in a ring",
        ("status", "--work", "work"),
        lambda box: (world.copy(box) / "ring").symlink_to("."),
        may=ANY,
    )
    yield Attack(
        "status: a link to a pipe",
        ("status", "--work", "work"),
        lambda box: __import__("os").mkfifo(
            one(world.copy(box) / DATASET / TABLES[2], TABLE).with_name("pipe.json")
        ),
        may=ANY,
    )
    yield Attack(
        "status: table.json is a pipe",
        ("status", "--work", "work"),
        lambda box: (lambda p: (p.unlink(), __import__("os").mkfifo(p)))(
            one(world.copy(box) / DATASET / TABLES[2], TABLE)
        ),
        may=REFUSED,
        deadline=20,
    )
    yield Attack(
        "verify: a receipt of 20 GB",
        ("verify", "--work", "work"),
        lambda box: __import__("os").truncate(
            one(world.copy(box) / DATASET / TABLES[2], RECEIPT), 20 << 30
        ),
    )
    yield Attack(
        "verify: head.safetensors of 20 GB",
        ("verify", "--work", "work"),
        lambda box: __import__("os").truncate(
            world.copy(box) / "heads/head/head.safetensors", 20 << 30
        ),
    )

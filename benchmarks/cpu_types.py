"""How far the outputs of models differ on another type of CPU: where verify's tolerance is from.

    python benchmarks/cpu_types.py [--shared DIR] [--emulate CPU ...] [--only NAME ...]

Text features, image features, relative depth and detections are made on this CPU, with torch,
oneDNN and MKL told to leave out AVX-512 and AVX2, and on CPUs that QEMU emulates (Debian's package
qemu-user; left out where it is not installed), where ONNX Runtime, OpenCV, NumPy and Arrow choose
other code as well: by QEMU's names Haswell has AVX2, SandyBridge AVX alone. Printed for each: the
largest difference of a row as a share of its norm (what `rsa-data verify --recompute` holds against
its tolerance), the largest difference of a value, the first over the tolerance, and what verify
would say.

CLIP's weights are random here, as the real ones are a download; MiniLM's and all others are real.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "helpers"))

from rsa_data import registry
from rsa_data.embeddings.encoder import Encoder
from rsa_data.runner import recompute
from rsa_data.store import schemas

SHARED = Path(__file__).parents[2] / "shared" / "data"
TEXTS = [
    "An image.",
    "An image with two sinks, a mirror, and a towel.",
    "a bed occupies 31.2% of the image, a wall occupies 40.1% of the image",
]
IMAGES = ("nyuv2/rgb_00000.jpg", "kitti/0000000005.png", "sunrgbd/000017.jpg")
# Refused by the audit of the stage that makes it; measured, and held against nothing.
REFUSED = ("minilm int8",)
LEVELS = {
    "avx2": {
        "ATEN_CPU_CAPABILITY": "avx2",
        "ONEDNN_MAX_CPU_ISA": "AVX2",
        "MKL_ENABLE_INSTRUCTIONS": "AVX2",
    },
    "sse4": {
        "ATEN_CPU_CAPABILITY": "default",
        "ONEDNN_MAX_CPU_ISA": "SSE41",
        "MKL_ENABLE_INSTRUCTIONS": "SSE4_2",
    },
}


def _text_tower(files: object) -> object:
    import torch

    from rsa_data.common.tokenizers import clip
    from rsa_data.embeddings.batches import PREFIX_AXES, by_prefix
    from rsa_data.embeddings.clip_text import TextTower
    from rsa_data.embeddings.encoder import TextModel

    torch.manual_seed(0)
    tower = TextTower().eval()
    with torch.no_grad():  # as OpenAI's code begins its training
        for name, parameter in tower.named_parameters():
            if "ln_" not in name:
                parameter.normal_(0, 0.02 if "embedding" in name else 512**-0.5)
    return TextModel(lambda: tower, clip().encode, by_prefix, 512, PREFIX_AXES, 1024, False)


def _image_tower(files: object) -> object:
    import torch

    from rsa_data.embeddings.clip_image import ImageTower
    from rsa_data.embeddings.encoder import ImageModel
    from rsa_data.embeddings.prepare import CLIP_RN50, preparer

    torch.manual_seed(0)
    tower = ImageTower().eval()
    with torch.no_grad():
        for parameter in tower.attnpool.parameters():
            parameter.normal_(0, 0.02)
    return ImageModel(tower, preparer(CLIP_RN50, "clip-rn50"), 1024)


RANDOM_TEXT = Encoder("", lambda argument, weights: {}, _text_tower)  # type: ignore[arg-type]
RANDOM_IMAGE = Encoder("", lambda argument, weights: {}, _image_tower)  # type: ignore[arg-type]


def texts(encoder: str, **options: str) -> pa.Table:
    """Features as the stage makes them, without its audit, which refuses MiniLM in int8."""
    from embeddings.test_embed import captions

    from rsa_data.embeddings import embed

    with patch.object(embed.audit, "compare", lambda *_: {}):
        return embed.build(encoder=encoder, store="float32", **options)(  # type: ignore[arg-type]
            captions(TEXTS)
        )


def samples(names: tuple[str, ...], depth: str | None = None) -> pa.Table:
    blank = dict.fromkeys(schemas.schema("samples").names)
    about = {"dataset": "folder", "split": "test", "scene": ".", "depth": depth}
    rows = [{**blank, **about, "sample_id": f"folder/test/{n}", "image": n} for n in names]
    return pa.Table.from_pylist(rows, schemas.schema("samples"))


def images() -> pa.Table:
    from rsa_data.embeddings.embed_images import build

    root = SHARED / "rgbd"
    return build(root=root, encoder="random", store="float32")(samples(IMAGES))


def depth() -> pa.Table:
    from rsa_data.datasets.folder import folder
    from rsa_data.depth.measure import build

    weights = SHARED / "models" / "tu2020_mbv2_blconv7dw_nyu_224.onnx"
    data = folder(depth="x", depth_unit="mm")
    step = build(dataset=data, root=SHARED / "rgbd", depth_model="tu2020", depth_weights=weights)
    return step(samples(IMAGES[:1], depth="nyuv2/sync_depth_00000.png"))


def segments(source: str, file: str) -> pa.Table:
    from rsa_data.datasets.folder import folder
    from rsa_data.segments.detect import build

    model = SHARED / "models" / file
    step = build(dataset=folder(), root=SHARED / "rgbd", segments=source, segmenter_weights=model)
    return step(samples(IMAGES))


WHAT: dict[str, Callable[[], pa.Table]] = {
    "minilm float32 torch": partial(texts, "minilm", runtime="torch"),
    "minilm float32 onnx": partial(texts, "minilm", runtime="onnx"),
    "minilm bfloat16": partial(texts, "minilm", precision="bfloat16"),
    "minilm int8": partial(texts, "minilm", precision="int8"),
    "clip text float32 torch": partial(texts, "random", runtime="torch"),
    "clip text float32 onnx": partial(texts, "random", runtime="onnx"),
    "clip text bfloat16": partial(texts, "random", precision="bfloat16"),
    "clip text int8": partial(texts, "random", precision="int8"),
    "clip image float32": images,
    "depth tu2020": depth,
    "detect nanodet-m": partial(segments, "nanodet-m", "nanodet_m.onnx"),
    "detect yolox-nano": partial(segments, "yolox-nano", "yolox_nano.onnx"),
    "detect fastestdet": partial(segments, "fastestdet", "FastestDet.onnx"),
    "segment deeplab-v3-voc": partial(segments, "deeplab-v3-voc", "deeplab_v3_1_default_1.onnx"),
}


def child(names: list[str], out: Path) -> None:
    """Makes the tables in this process, whatever CPU it believes to be on."""
    registry.ENCODERS["random"] = "cpu_types:RANDOM_TEXT"
    registry.IMAGE_ENCODERS["random"] = "cpu_types:RANDOM_IMAGE"
    for name in names:
        begun = time.monotonic()
        try:
            pq.write_table(WHAT[name](), out / f"{name}.parquet")
        except Exception as error:  # the others may work there
            print(f"{name}: {type(error).__name__}: {error}", file=sys.stderr, flush=True)
        print(f"{name}: {time.monotonic() - begun:.0f} s", file=sys.stderr, flush=True)


def differences(there: pa.Table, again: pa.Table) -> tuple[float, str]:
    """(largest difference of a value of any column of floats, its column)."""
    found = [(0.0, "-")]
    for name in there.schema.names:
        one, two = (recompute.floats(table, name) for table in (there, again))
        for a, b in zip(one or (), two or (), strict=True):
            if a.shape == b.shape and a.size and not np.isnan(a - b).all():
                found.append((float(np.nanmax(np.abs(a - b))), name))
    return max(found)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--shared", type=Path, default=SHARED)
    parser.add_argument("--emulate", nargs="*", default=["Haswell", "SandyBridge"], metavar="CPU")
    parser.add_argument("--only", nargs="+", default=list(WHAT), metavar="NAME")
    parser.add_argument("--child", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.child:
        child(given.only, given.child)
        return 0
    emulator = shutil.which("qemu-x86_64")
    runs: dict[str, tuple[list[str], dict[str, str]]] = {"this": ([], {})}
    runs |= {name: ([], switches) for name, switches in LEVELS.items()}
    for cpu in given.emulate if emulator else ():
        runs[f"emulated {cpu}"] = ([str(emulator), "-cpu", cpu], {})
    worst = 0.0
    with tempfile.TemporaryDirectory(prefix="rsa-data-cpu-") as place:
        for run, (before, switches) in runs.items():
            out = Path(place) / run
            out.mkdir()
            words = [*before, sys.executable, __file__, "--child", str(out), "--only", *given.only]
            environment = os.environ | switches | {"XDG_CACHE_HOME": f"{place}/cache"}
            ended = subprocess.run(words, env=environment)
            if ended.returncode:
                print(f"{run}: ended with {ended.returncode}", flush=True)
            for name in given.only if run != "this" else ():
                there, again = (Path(place) / r / f"{name}.parquet" for r in ("this", run))
                if not again.exists():
                    print(f"{name:26} {run:18} not made", flush=True)
                    continue
                one, two = pq.read_table(there), pq.read_table(again)
                precision = next((p for p in recompute.TOLERANCES if p in name.split()), "float32")
                tolerance = recompute.TOLERANCES[precision]
                wrong, share = recompute.compare(one, two, tolerance)
                value, column = differences(one, two)
                worst = max(worst, share / tolerance if name not in REFUSED else 0.0)
                said = "; ".join(wrong) or ("within the tolerance" if share else "the same")
                print(
                    f"{name:26} {run:18} row {share:.2e}, value {value:.2e} ({column}), "
                    f"{share / tolerance:.3f} of the tolerance; verify: {said}",
                    flush=True,
                )
    print(f"largest share of a tolerance: {worst:.3f}; verify's are {recompute.TOLERANCES}")
    return 0 if worst <= 1 else 1


if __name__ == "__main__":
    sys.exit(main())

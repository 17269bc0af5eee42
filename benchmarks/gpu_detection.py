"""Detection and depth in ONNX Runtime on a GPU: that they run there, what they find, how fast.

    python benchmarks/gpu_detection.py PHOTOS --yolox yolox_nano.onnx [--images 480]
        [--device cuda] [--folder DIR]

PHOTOS is a folder of pictures, taken again until there are enough. YOLOX nano has its real weights,
so what it finds on the GPU is compared with the CPU; DETR (ResNet-50, 800 px) has random ones, made
by transformers and exported here, and shows what a network of a usual size takes. Whole commands,
and the same sessions alone on tensors that lie ready. --device cpu tries the script without a GPU.
"""

import argparse
import shutil
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import recording
import torch
from torch.utils.flop_counter import FlopCounterMode

from rsa_data.common.onnx_sessions import open_session
from rsa_data.store.tables import WorkDir

SIDES = (800, 1056)


def detr(path: Path) -> float:
    """Exports DETR with random weights; returns the operations of one image."""
    from transformers import DetrConfig, DetrForObjectDetection, ResNetConfig

    torch.manual_seed(0)
    config = DetrConfig(
        use_timm_backbone=False,
        use_pretrained_backbone=False,
        backbone=None,
        backbone_config=ResNetConfig(out_features=["stage4"]),
        num_labels=80,
    )
    model = DetrForObjectDetection(config).eval()

    class Answers(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.model = model

        def forward(self, pixel_values: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
            found = self.model(pixel_values=pixel_values)
            return found.logits, found.pred_boxes

    example = torch.rand(1, 3, *SIDES)
    with FlopCounterMode(display=False) as counter, torch.no_grad():
        Answers()(example)
    torch.onnx.export(
        Answers(), (example,), dynamo=True, input_names=["pixel_values"],
        output_names=["logits", "pred_boxes"], verbose=False,
    ).save(path, external_data=False)  # fmt: skip
    return float(counter.get_total_flops())


def alone(path: Path, device: str, threads: int, rounds: int) -> float:
    """Images a second of a session on one random tensor, from the host and back."""
    session = open_session(path, threads, device)  # type: ignore[arg-type]
    print(path.name, session.get_providers(), flush=True)
    given = session.get_inputs()[0]
    feed = {given.name: np.random.default_rng(0).random(given.shape, np.float32)}
    for _ in range(3):
        session.run(None, feed)
    seconds = []
    for _ in range(rounds):
        begun = time.perf_counter()
        session.run(None, feed)
        seconds.append(time.perf_counter() - begun)
    return 1 / float(np.median(seconds))


def command(work: Path, *words: str) -> float:
    """Wall seconds of a command, which must succeed."""
    more = ("--work", str(work), "--start-over")
    _, wall, _, said = recording.spent([sys.executable, "-m", "rsa_data", *words, *more])
    print(said[-400:], flush=True)
    return wall


def objects(work: Path, name: str) -> list[Any]:
    """Labels and boxes of each image."""
    table = WorkDir(str(work)).table("photos", f"segments/{name}")
    rows = [row for n in table.parts() for row in table.read(n).to_pylist()]
    return [list(zip(row["label"], row["box"], strict=True)) for row in rows]


def agreeing(one: list[Any], other: list[Any]) -> tuple[int, int]:
    """How many objects of `one` the other has too, within 2 px a side; how many `one` has."""
    same = sum(
        any(a[0] == b[0] and np.abs(np.subtract(a[1], b[1])).max() <= 2 for b in theirs)
        for mine, theirs in zip(one, other, strict=True)
        for a in mine
    )
    return same, sum(map(len, one))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("photos", type=Path)
    parser.add_argument("--yolox", type=Path, required=True)
    parser.add_argument("--images", type=int, default=480)
    parser.add_argument("--device", choices=("cuda", "cpu"), default="cuda")
    parser.add_argument("--folder", type=Path)
    given = parser.parse_args()
    folder = given.folder or Path(tempfile.mkdtemp(prefix="rsa-data-gpu-"))
    photos = folder / "photos"
    photos.mkdir(parents=True)
    there = sorted(p for p in given.photos.iterdir() if p.suffix in (".jpg", ".png"))
    for number in range(given.images):
        path = there[number % len(there)]
        shutil.copy(path, photos / f"{number:05d}{path.suffix}")
    begun = time.perf_counter()
    operations = detr(folder / "detr.onnx")
    print(f"DETR: {operations / 1e9:.0f} GFLOP an image, "
          f"exported in {time.perf_counter() - begun:.0f} s", flush=True)  # fmt: skip
    rows = []
    common = ("detect", "--dataset", "folder:photos", "--root", str(photos))
    for title, name, path, options in (
        ("YOLOX nano", "yolox-nano", given.yolox, ()),
        ("DETR, random", "onnx", folder / "detr.onnx", ("--names", "coco")),
    ):
        model = ("--segments", name, "--segmenter-weights", str(path), *options)
        found = {}
        for device, threads in ((given.device, 1), (given.device, 4), ("cpu", 16)):
            if device == "cpu" and name == "onnx" and given.device == "cuda":
                continue
            work = folder / f"{name}-{device}-{threads}"
            seconds = command(work, *common, *model, "--device", device, "--threads", str(threads))
            found[device] = objects(work, name)
            rate = alone(path, device, 1, 30) if threads in (1, 16) else None
            share = rate and operations * rate / 1e12 if name == "onnx" else None
            whole = round(given.images / seconds, 1)
            alone_ = [rate and round(rate, 1), share and round(share, 2)]
            rows.append([f"{title}, {device}, {threads} at a time", whole, *alone_])
            print(*rows[-1], flush=True)
        if name != "onnx":
            same, of = agreeing(found["cpu"], found[given.device])
            print(f"{same} of {of} objects of the CPU's agree", flush=True)
            rows[0].append(f"{same} of {of}")
    if given.device == "cpu":
        return
    rows = [[*row, None][:5] for row in rows]
    recording.table(
        "gpu_detection",
        "Detection on a GPU",
        ("model", "images/s, whole command", "images/s of one session alone", "its TFLOP/s",
         "objects of the CPU's that agree"),
        rows,
        note=f"{given.images} images. float32 without TF32, so that the same image gives the same "
        "objects; DETR's weights are random.",
    )  # fmt: skip


if __name__ == "__main__":
    main()

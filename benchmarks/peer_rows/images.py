"""Images: their features by CLIP RN50, and their objects by YOLOX nano."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from rsa_data.common import class_names
from rsa_data.store import schemas
from rsa_data.store.tables import WorkDir

from .texts import random_clip
from .ways import Given, Row, Run, Way, cosines, peer, stage

# Relative depth, labels and ground truth among the shared pictures.
_NO_PHOTO = ("depth", "label", "groundtruth")


def embedding(given: Given) -> Row:
    """CLIP RN50's image tower with random weights."""
    photos = gather(given, 4 if given.small else 48)
    weights = random_clip(given)
    work = given.folder / "image-embedding"

    def read() -> np.ndarray:
        rows = in_order(work, "embeddings/images/clip-rn50", photos)
        return schemas.embedding_array(rows).astype(np.float32)

    def own() -> Run:
        words: tuple[Any, ...] = ("embed-images", "--dataset", "folder:photos")
        words += ("--root", photos[0].parent, "--encoder-weights", weights)
        words += ("--store", "float32", "--threads", given.threads, "--start-over")
        return stage(given, work, "embeddings/images/clip-rn50", "photos", read, *words)

    words = {"way": "open_clip", "weights": weights, "images": [*map(str, photos)]}
    ways = (
        Way("open_clip", lambda: peer(given, "clip", **words)),
        Way("rsa-data", own, ours=True),
    )
    note = "Random weights; rooms and streets from 320 to 1,300 px wide; batches of 16."
    return Row("Image embedding, CLIP RN50", len(photos), "images", ways, cosines, note)


def detection(given: Given) -> Row:
    """YOLOX nano, from files to boxes with class names."""
    photos = gather(given, 4 if given.small else 654)
    model = given.shared / "models" / "yolox_nano.onnx"
    work = given.folder / "detection"

    def read() -> list[list[list[float]]]:
        rows = in_order(work, "segments/yolox-nano", photos)
        return [sorted(box) for box in boxes(rows)]

    def own() -> Run:
        words: tuple[Any, ...] = ("detect", "--dataset", "folder:photos", "--root")
        words += (photos[0].parent, "--segments", "yolox-nano", "--segmenter-weights", model)
        words += ("--threads", given.threads, "--start-over")
        return stage(given, work, "segments/yolox-nano", "photos", read, *words)

    def theirs(way: str, name: str) -> Way:
        words = {"way": way, "model": model, "images": [*map(str, photos)]}
        read_json = lambda path: json.loads(path.read_text())  # noqa: E731
        return Way(name, lambda: peer(given, "detection", read=read_json, **words))

    ways = (
        theirs("loop", "ONNX Runtime, a loop"),
        theirs("supervision", "ONNX Runtime and supervision"),
        Way("rsa-data", own, ours=True),
    )
    note = (
        "As many as NYUv2 has test images. Objects that agree have the same class and boxes within "
        "2 px on each side. rsa-data reads and decodes images beside the network, on another core "
        "where there is one: less time for more CPU. The network takes 15 ms of the 18 to 20 of an "
        "image on both sides; of the rest 0.8 ms go to Pillow, which refuses cut files, where the "
        "loop has OpenCV."
    )
    return Row("Detection, YOLOX nano", len(photos), "images", ways, agreement, note)


def gather(given: Given, count: int) -> list[Path]:
    """Photos of rooms and streets as one flat folder, in the order of their names."""
    folder = given.folder / f"photos-{count}"
    if not folder.is_dir():
        folder.mkdir()
        found = sorted((given.shared / "rgbd").rglob("*.jpg"))
        found += sorted((given.shared / "rgbd").rglob("*.png"))
        photos = [p for p in found if not any(word in str(p).lower() for word in _NO_PHOTO)]
        photos = [p for p in photos if Image.open(p).mode == "RGB"]
        # Fewer photos than wanted are taken again: every one is read and computed anew.
        for number in range(count):
            path = photos[number % len(photos)]
            shutil.copy(path, folder / f"{number:04d}{path.suffix}")
    return sorted(folder.iterdir())


def in_order(work: Path, name: str, photos: list[Path]) -> Any:
    """Rows of a table in the order of the photos."""
    table = WorkDir(str(work)).table("photos", name)
    samples = WorkDir(str(work)).table("photos", "samples")
    assert table.parts() == samples.parts() == [0], "expected one part"
    images = samples.read(0, ["image"])["image"].to_pylist()
    places = {Path(image).name: row for row, image in enumerate(images)}
    return table.read(0).take([places[photo.name] for photo in photos])


def boxes(rows: Any) -> list[list[list[float]]]:
    """[class number by order of names, x0, y0, x1, y1] of each object of each image."""
    names = list(class_names.table("coco").names.values())
    return [
        [[names.index(label), *box] for label, box in zip(labels, found, strict=True)]
        for labels, found in zip(rows["label"].to_pylist(), rows["box"].to_pylist(), strict=True)
    ]


def agreement(found: Any) -> dict[str, str]:
    """Share of the first one's objects that the others have, and how many they have in all."""
    first = next(iter(found.values()))
    wanted = sum(map(len, first))

    def matched(other: Any) -> int:
        return sum(
            any(a[0] == b[0] and np.abs(np.subtract(a[1:], b[1:])).max() <= 2 for b in one)
            for mine, one in zip(first, other, strict=True)
            for a in mine
        )

    return {
        name: f"{matched(one)} of {wanted} objects, {sum(map(len, one))} in all"
        for name, one in found.items()
    }

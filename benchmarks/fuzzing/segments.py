"""Importers of segments: released text, COCO panoptic and results, class tables, model cards."""

import json
import tarfile
from functools import partial
from pathlib import Path

import numpy as np
from PIL import Image

from rsa_data.captions import natural
from rsa_data.common import cards, model_files, names_files, tokenizers
from rsa_data.common.errors import RsaDataError
from rsa_data.datasets.folder import folder
from rsa_data.datasets.nyuv2 import nyuv2
from rsa_data.segments import coco_detections, coco_panoptic, graph, rsa_release

from .forms import (
    SHARED,
    Importer,
    One,
    accounted,
    cut,
    js,
    put,
    samples,
    shared,
)


def released_seeds() -> list[bytes]:
    found = [b"bed 0.25\ntraffic light 0.01\n", b"wall-other 1e-3\n\nperson 1.0", b"a nan\n"]
    archive = SHARED / "rsa_release" / "nyu-test.tar.xz"
    if archive.is_file():
        with tarfile.open(archive) as file:
            for member in file:
                if member.name.endswith(".txt") and (content := file.extractfile(member)):
                    found.append(content.read())
                if len(found) > 30:
                    break
    return found


def released(here: Path) -> One:
    place = here / "seg_txt_panoptic" / "nyu" / "train"
    texts = here / "text_all" / "nyu" / "train"
    place.mkdir(parents=True), texts.mkdir(parents=True)
    step = rsa_release.build(argument=str(here), dataset=nyuv2())
    read = natural.release_text(str(here))
    rows = samples("nyuv2/train/a")

    def one(data: bytes) -> None:
        (place / "a.txt").write_bytes(data)
        (texts / "a.txt").write_bytes(data)
        accounted(step(rows), here)
        natural.step("release-text", read, tokenizers.clip(), None)(rows)

    return one


IMAGE = {"id": 1, "file_name": "a.jpg", "width": 4, "height": 3}
CATEGORY = {"id": 1, "name": "wall-brick", "isthing": 1, "supercategory": "x"}
SEGMENT = {"id": 7, "category_id": 1, "area": 12, "bbox": [0, 0, 4, 3], "iscrowd": 0}
PANOPTIC = {
    "images": [IMAGE],
    "annotations": [{"image_id": 1, "file_name": "a.png", "segments_info": [SEGMENT]}],
    "categories": [CATEGORY],
}
RLE = {"size": [3, 4], "counts": "0<"}
RESULTS = [
    {"image_id": 1, "category_id": 1, "score": 0.5, "bbox": [0, 0, 2, 2]},
    {"image_id": 1, "category_id": 1, "score": 0.5, "segmentation": {**RLE, "counts": [0, 12]}},
    {"image_id": 1, "category_id": 1, "segmentation": RLE},
    {"image_id": 1, "category_id": 1, "segmentation": [[0, 0, 3, 0, 3, 2, 0, 2]]},
]


def panoptic_seeds() -> list[bytes]:
    real = [cut(json.loads(data)) for data in shared("panoptic_coco/*.json", most=200_000)]
    for content in real:  # the picture here is another one
        content["images"][0] |= IMAGE
        content["annotations"][0] |= {"image_id": 1, "file_name": "a.png"}
    return [js(content) for content in [PANOPTIC, *real]]


def panoptic(here: Path) -> One:
    ids = np.zeros((3, 4, 3), np.uint8)
    ids[..., 0] = 7
    Image.fromarray(ids).save(here / "a.png")

    def one(data: bytes) -> None:
        (here / "a.json").write_bytes(data)
        build = partial(coco_panoptic.build, argument=str(here / "a.json"), dataset=folder())
        accounted(build(root=None, masks=True)(samples()), here)

    return one


def detection_seeds() -> list[bytes]:
    images = {"images": [IMAGE], "categories": [CATEGORY]}
    seeds = [{"a.json": RESULTS[:1], "b.json": images}]
    seeds += [{"a.json": {**images, "annotations": [result]}} for result in RESULTS]
    return [*map(js, seeds), js({"a.json": RESULTS[1:], "b.json": images})]


def detections(here: Path) -> One:
    def one(data: bytes) -> None:
        put(here, data, ("a.json", "b.json"))
        both = [str(here / name) for name in ("a.json", "b.json") if (here / name).is_file()]
        build = partial(coco_detections.build, argument=":".join(both), dataset=folder())
        accounted(build(root=None, masks=True)(samples()), here)

    return one


def class_table(here: Path) -> One:
    def one(data: bytes) -> None:
        for suffix in (".toml", ".txt"):
            (here / f"names{suffix}").write_bytes(data)
            try:
                table = names_files.read(here / f"names{suffix}")
            except RsaDataError:
                continue
            assert all(isinstance(table.label(n), str) for n in table.names)

    return one


def card_seeds() -> list[bytes]:
    folder = Path(cards.__file__).parent / "model_cards"
    return [path.read_bytes() for path in sorted(folder.glob("*.toml"))]


def card(here: Path) -> One:
    """A card of the user's own, with a graph that answers nothing it may ask for."""
    import onnx as onnx_format
    from onnx import TensorProto, helper

    names = {"images": "output", "input.1": "758", "pixel_values": "logits"}
    shape = [1, 3, "h", "w"]
    nodes = [helper.make_node("Identity", [a], [b]) for a, b in names.items()]
    ends = [[helper.make_tensor_value_info(n, TensorProto.FLOAT, shape) for n in side]
            for side in (names.keys(), names.values())]  # fmt: skip
    for k, (given, answered) in enumerate(zip(*ends, strict=True)):
        made = helper.make_model(
            helper.make_graph([nodes[k]], "g", [given], [answered]),
            opset_imports=[helper.make_opsetid("", 17)],
            ir_version=8,
        )
        onnx_format.save(made, here / f"{k}.onnx")

    def one(data: bytes) -> None:
        (here / "card.toml").write_bytes(data)
        found = cards.read_card(here / "card.toml")
        model_files.cached_path(found)
        table = graph.class_table(found)
        for k in range(len(names)):
            try:
                detector = graph.load(found, here / f"{k}.onnx", table=table)
                image = np.zeros((30, 40, 3), np.uint8)
                geometry = (prepared := detector.prepare(image))[1]
                detector.finish(detector.run([prepared])[0], geometry)
            except RsaDataError:
                continue

    return one


IMPORTERS = {
    "rsa-release": Importer(released_seeds, released, "text"),
    "coco-panoptic": Importer(panoptic_seeds, panoptic),
    "coco-detections": Importer(detection_seeds, detections),
    "class-table": Importer(
        lambda: [
            b'names = ["bed", "chair"]\nthings = ["bed"]\n',
            b"bed\nchair\n",
            b'first = 1\nthings = "none"\ncount = 9\n[names]\n3 = "a_b"\n',
            *shared("categories/*.txt", "categories/*.names"),
        ],
        class_table,
        "text",
    ),
    "model-card": Importer(card_seeds, card, "text"),
}

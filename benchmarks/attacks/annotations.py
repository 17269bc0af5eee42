"""Annotations of others: COCO files, panoptic and label maps, released texts, class names."""

import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from .harness import ACCEPTED, ANY, CONTAINED, FAILED, REFUSED, Attack
from .images import encoded, folder, picture, png, sparse
from .workdir import JUNK
from .world import World

DETECT = (
    "detect",
    "--work",
    "work",
    "--dataset",
    "folder:own",
    "--root",
    "in",
)
OTHERS = r"\b2 samples ok"
NAMES = (
    "a",
    "bad",
    "z",
)


def results(change: Callable[[dict[str, Any]], object] | None = None) -> dict[str, Any]:
    """Annotations of three images; the one in the middle is changed."""
    images = [
        {"id": n, "file_name": f"{name}.png", "width": 40, "height": 30}
        for n, name in enumerate(NAMES)
    ]
    made = [
        {"id": n, "image_id": n, "category_id": 1, "bbox": [1, 1, 20, 20], "score": 0.9}
        for n in range(3)
    ]
    content = {"images": images, "annotations": made, "categories": [{"id": 1, "name": "bed"}]}
    if change:
        change(content)
    return content


def panoptic(change: Callable[[dict[str, Any]], object] | None = None) -> dict[str, Any]:
    content = results()
    for image in content["annotations"]:
        image |= {
            "file_name": f"{NAMES[image['image_id']]}.png",
            "segments_info": [{"id": 7, "category_id": 1, "area": 1200}],
        }
    if change:
        change(content)
    return content


def coco(box: Path, content: Any) -> None:
    folder(box, lambda p: picture().save(p))
    (box / "a.json").write_bytes(
        content if isinstance(content, bytes) else json.dumps(content).encode()
    )


def maps(box: Path, content: Any, change: Callable[[Path], object] | None = None) -> None:
    """Panoptic annotations with their maps of one segment; the middle map may be changed."""
    coco(box, content)
    (box / "a").mkdir()
    ids = np.zeros((30, 40, 3), np.uint8)
    ids[..., 0] = 7
    for name in NAMES:
        Image.fromarray(ids).save(box / "a" / f"{name}.png")
    if change:
        (box / "a/bad.png").unlink()
        change(box / "a/bad.png")


def labels(box: Path, change: Callable[[Path], object]) -> None:
    folder(box, lambda p: picture().save(p))
    (box / "maps").mkdir()
    for name in ("a", "z"):
        Image.fromarray(np.ones((30, 40), np.uint8)).save(box / "maps" / f"{name}.png")
    change(box / "maps/bad.png")


# Changes of one annotation: a bad row where the rest of the file can be used, else a refusal.
_ONE: dict[str, Any] = {
    "box of text": {"bbox": ["x", 1, 2, 3]},
    "box of 3": {"bbox": [1, 2, 3]},
    "box null": {"bbox": None},
    "box nan": {"bbox": [float("nan"), 1, 2, 3]},
    "box of 1e300": {"bbox": [1e300, 1, 2, 3]},
    "box negative": {"bbox": [5, 5, -3, -3]},
    "class text": {"category_id": "x"},
    "class 2^70": {"category_id": 2**70},
    "class unknown": {"category_id": 99},
    "image 2^70": {"image_id": 2**70},
    "image list": {"image_id": [1]},
    "score text": {"score": "high"},
    "score nan": {"score": float("nan")},
    "score list": {"score": []},
    "polygon of 1e9": {"segmentation": [[0, 0, 1e9, 0, 1e9, 1e9]]},
    "polygon of text": {"segmentation": [["a"] * 6]},
    "polygon of one point": {"segmentation": [[1, 1]]},
    "polygon nan": {"segmentation": [[float("nan")] * 6]},
    "run lengths of 2^40": {"segmentation": {"size": [2**20, 2**20], "counts": [0, 2**40]}},
    "run lengths short": {"segmentation": {"size": [30, 40], "counts": [0, 5]}},
    "run lengths negative": {"segmentation": {"size": [30, 40], "counts": [-5, 1205]}},
    "run lengths of text": {"segmentation": {"size": [30, 40], "counts": "\u00ff\u0001nonsense"}},
    "run lengths of others": {"segmentation": {"size": [3, 4], "counts": [0, 12]}},
    "run lengths nested": {"segmentation": {"size": [30, 40], "counts": [[0, 1200]]}},
    "mask null in size": {"segmentation": {"size": None, "counts": "0"}},
}

_WHOLE: dict[str, Callable[[dict[str, Any]], object]] = {
    "no categories' names": lambda c: c["categories"][0].pop("name"),
    "a category of control characters": lambda c: c["categories"][0].update(name="\x1b[31mbed\x07"),
    "a category of 10,000 letters": lambda c: c["categories"][0].update(name="b" * 10_000),
    "a category twice": lambda c: c["categories"].append({"id": 1, "name": "chair"}),
    "images text": lambda c: c.update(images="x"),
    "an image out of the folder": lambda c: c["images"][1].update(file_name="../../etc/passwd"),
    "an image of 2^40 px": lambda c: c["images"][1].update(width=2**20, height=2**20),
    "an image of -1 px": lambda c: c["images"][1].update(width=-1),
    "an image twice": lambda c: c["images"].append({**c["images"][1], "id": 1}),
    "annotations an object": lambda c: c.update(annotations={"0": 1}),
    "an annotation a number": lambda c: c["annotations"].append(3),
}


def attacks(world: World) -> Iterator[Attack]:
    found, whole = (
        (*DETECT, "--segments", "coco-detections:a.json"),
        (*DETECT, "--segments", "coco-panoptic:a.json:a"),
    )
    yield Attack(
        "control: detections",
        found,
        lambda b: coco(b, results()),
        may=ACCEPTED,
        says="3 samples ok",
    )
    yield Attack(
        "control: panoptic", whole, lambda b: maps(b, panoptic()), may=ACCEPTED, says="3 samples ok"
    )
    for name, data in {**JUNK, "deep images": b'{"images": ' + b"[" * 100_000}.items():
        if name == "doubled keys":
            continue
        # An empty list is that of a detector that found nothing.
        may = ANY if name == "a list" else REFUSED
        yield Attack(f"detections: {name}", found, lambda b, d=data: coco(b, d), may=may)
        yield Attack(f"panoptic: {name}", whole, lambda b, d=data: maps(b, d))
    # Others may stand: an unknown class is a row of that image; a box outside shows nothing.
    for name, value in _ONE.items():
        fine = {"box negative", "polygon of one point", "image 2^70", "class unknown"}
        yield Attack(
            f"detection: {name}",
            found,
            lambda b, v=value: coco(b, results(lambda c: c["annotations"][1].update(v))),
            may=CONTAINED | ACCEPTED if name in fine else CONTAINED,
        )
    for name, change in _WHOLE.items():
        fine = {"an image twice", "a category of control characters"}
        may = CONTAINED | ACCEPTED if name in fine else CONTAINED
        yield Attack(f"detections: {name}", found, lambda b, c=change: coco(b, results(c)), may=may)
        yield Attack(f"panoptic: {name}", whole, lambda b, c=change: maps(b, panoptic(c)), may=may)
    yield from _large(found, whole)
    yield from _panoptic(whole)
    yield from _label_maps()


def _large(found: tuple[str, ...], whole: tuple[str, ...]) -> Iterator[Attack]:
    def tall(box: Path, start: bytes, unit: bytes, times: int, end: bytes) -> None:
        coco(box, b"")
        with (box / "a.json").open("wb") as file:
            file.write(start)
            for _ in range(64):
                file.write(unit * (times // 64))
            file.write(end)

    for words, kind in ((found, "detections"), (whole, "panoptic")):
        yield Attack(
            f"{kind}: sparse file of 30 GB",
            words,
            lambda b: (maps(b, b""), sparse(b / "a.json", 30 << 30, b'{"images": [')),
        )
        yield Attack(
            f"{kind}: 300 MB of lists",
            words,
            lambda b: tall(b, b'{"images": [', b"[],", 100 << 20, b"[]]}"),
        )
        yield Attack(
            f"{kind}: 300 MB of one text",
            words,
            lambda b: tall(b, b'{"images": "', b"xyz", 100 << 20, b'"}'),
        )
        yield Attack(
            f"{kind}: 200 MB of spaces",
            words,
            lambda b: tall(b, b"", b"  ", 100 << 20, b"x"),
        )
        yield Attack(
            f"{kind}: a pipe",
            words,
            lambda b: (coco(b, b""), (b / "a.json").unlink(), os.mkfifo(b / "a.json")),
        )
        yield Attack(
            f"{kind}: a folder",
            words,
            lambda b: (coco(b, b""), (b / "a.json").unlink(), (b / "a.json").mkdir()),
        )
        yield Attack(
            f"{kind}: /dev/zero",
            words,
            lambda b: (
                coco(b, b""),
                (b / "a.json").unlink(),
                (b / "a.json").symlink_to("/dev/zero"),
            ),
        )


def _panoptic(words: tuple[str, ...]) -> Iterator[Attack]:
    files: dict[str, Callable[[Path], object]] = {
        "no map": lambda p: None,
        "an empty map": lambda p: p.write_bytes(b""),
        "a map of 20 GB": lambda p: sparse(p, 20 << 30, encoded(picture(), "PNG")[:40]),
        "a map of 60,000 x 60,000": lambda p: p.write_bytes(png(60_000, 60_000)),
        "a map of another size": lambda p: picture(41, 30).save(p),
        "a map of other ids": lambda p: picture().save(p),
        "a map with transparency": lambda p: picture(mode="RGBA").save(p),
        "a map that is a pipe": lambda p: os.mkfifo(p),
        "a JPEG map": lambda p: p.write_bytes(encoded(picture(), "JPEG")),
    }
    for name, change in files.items():
        yield Attack(
            f"panoptic: {name}",
            words,
            lambda b, c=change: maps(b, panoptic(), c),
            may=FAILED,
            says=OTHERS,
        )
    lies: dict[str, Any] = {
        "area wrong": {"area": 3},
        "area 2^70": {"area": 2**70},
        "id 2^70": {"id": 2**70},
        "id -1": {"id": -1},
        "class unknown": {"category_id": 99},
        "id text": {"id": "x"},
        "area nan": {"area": float("nan")},
    }
    for name, value in lies.items():
        yield Attack(
            f"panoptic: {name}",
            words,
            lambda b, v=value: maps(
                b, panoptic(lambda c: c["annotations"][1]["segments_info"][0].update(v))
            ),
            may=CONTAINED,
        )
    for name in ("../secret.png", "/etc/passwd", "a\0b.png", "x" * 5000):
        yield Attack(
            f"panoptic: file name {ascii(name)[:20]}",
            words,
            lambda b, n=name: maps(b, panoptic(lambda c: c["annotations"][1].update(file_name=n))),
            may=CONTAINED,
        )


def _label_maps() -> Iterator[Attack]:
    words = (*DETECT, "--segments", "labels:maps", "--names", "names.txt")
    good = "wall\nbed\nchair\n"
    yield Attack(
        "control: label maps",
        words,
        lambda b: (
            labels(b, lambda p: picture(mode="L").point(lambda v: v % 3).save(p)),
            (b / "names.txt").write_text(good),
        ),
        may=ACCEPTED,
    )
    files: dict[str, Callable[[Path], object]] = {
        "no map": lambda p: None,
        "in colour": lambda p: picture().save(p),
        "numbers without names": lambda p: Image.fromarray(np.full((30, 40), 77, np.uint8)).save(p),
        "another size": lambda p: Image.fromarray(np.ones((31, 40), np.uint8)).save(p),
        "20 GB": lambda p: sparse(p, 20 << 30, encoded(picture(mode="L"), "PNG")[:40]),
        "60,000 x 60,000": lambda p: p.write_bytes(png(60_000, 60_000, 8, 0)),
        "cut": lambda p: p.write_bytes(encoded(picture(mode="L"), "PNG")[:60]),
        "a pipe": lambda p: os.mkfifo(p),
        "a folder": lambda p: p.mkdir(),
    }
    for name, change in files.items():
        yield Attack(
            f"label map: {name}",
            words,
            lambda b, c=change: (labels(b, c), (b / "names.txt").write_text(good)),
            may=FAILED,
            says=OTHERS,
        )
    names: dict[str, bytes] = {
        "not UTF-8": b"\xff\xfe\xff",
        "empty": b"",
        "control characters": b"wall\n\x1b[31mbed\nchair",
        "one of 10,000 letters": b"x" * 10_000,
        "NUL": b"wall\n\0\nbed",
    }
    tomls: dict[str, bytes] = {
        "not TOML": b"[[[",
        "nested": b"a = " + b"[" * 100_000,
        "5,000 digits": b"first = " + b"9" * 5000,
        "tables nested": b"".join(b"[" + b".".join([b"a"] * 5000) + b"]\n" for _ in range(3)),
        "first -1": b'names = ["a"]\nfirst = -1',
        "names 3": b"names = 3",
        "no names": b"x = 1",
        "a name 3": b"names = [3]",
        "a date": b"names = 1979-05-27",
        "numbers of 9 digits": b'[names]\n999999999 = "a"',
        "things unknown": b'names = ["a"]\nthings = ["b"]',
        "infinite": b"names = [inf]",
    }
    for file, cases in (("names.txt", names), ("names.toml", tomls)):
        for name, data in cases.items():
            fine = name in ("control characters", "NUL")
            yield Attack(
                f"{file}: {name}",
                (*words[:-1], file),
                lambda b, d=data, f=file: (
                    labels(b, lambda p: picture(mode="L").point(lambda v: v % 3).save(p)),
                    (b / f).write_bytes(d),
                ),
                may=CONTAINED | ACCEPTED if fine else CONTAINED,
            )
        yield Attack(
            f"{file}: 20 GB",
            (*words[:-1], file),
            lambda b, f=file: (labels(b, lambda p: None), sparse(b / f, 20 << 30, b"a\n")),
            may=REFUSED,
        )
        yield Attack(
            f"{file}: a pipe",
            (*words[:-1], file),
            lambda b, f=file: (labels(b, lambda p: None), os.mkfifo(b / f)),
            may=REFUSED,
        )
    release = (*DETECT, "--segments", "rsa-release:texts")
    texts = {
        "nan": "bed nan\n",
        "inf": "bed inf\n",
        "no number": "bed\n",
        "negative": "bed -0.5\n",
        "over 1": "bed 3.5\n",
        "a long name": "x" * 10_000 + " 0.5\n",
        "control characters": "\x1b[31mbed 0.5\n",
        "sum of 90": "bed 0.9\n" * 100,
    }
    for name, text in texts.items():

        def write(box: Path, t: str = text) -> None:
            folder(box, lambda p: picture().save(p))
            place = box / "texts/seg_txt_panoptic/own/train"
            place.mkdir(parents=True)
            for stem in NAMES:
                (place / f"{stem}.txt").write_text(t if stem == "bad" else "bed 0.5\n")

        fine = {"control characters", "sum of 90"}
        yield Attack(
            f"released text: {name}",
            release,
            write,
            may=CONTAINED | ACCEPTED if name in fine else CONTAINED,
        )

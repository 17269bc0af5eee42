"""What predict needs of images: their captions through a detector, and their relative depth."""

import random
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...common.errors import RowError, RsaDataError, UsageError

if TYPE_CHECKING:
    import pyarrow as pa

_PARAPHRASES = 8


def paraphrases(caption: str) -> list[str]:
    """The caption with its objects in other orders: up to 8 texts, the same every time.

    What stands after the first "with" and between commas and "and" counts as an object; a caption
    of one object has none.
    """
    match = re.fullmatch(r"(.*?\bwith )(.+?)(\.?)", caption, re.DOTALL)
    if not match:
        return []
    objects = re.split(r", and |, | and ", match[2])
    if len(objects) < 2:
        return []
    found: list[str] = []
    for seed in range(3 * _PARAPHRASES):
        random.Random(seed).shuffle(objects)
        text = f"{match[1]}{', '.join(objects)}{match[3]}"
        if text != caption and text not in found:
            found.append(text)
    return found[:_PARAPHRASES]


def images_below(place: Path) -> list[str]:
    """Names of the images: of the one at `place`, or of all below it, relative to it, sorted."""
    from ...datasets.images import SUFFIXES

    if place.is_file():
        return [place.name]
    if not place.is_dir():
        raise UsageError(f"--image {place}: expected an image or a folder; there is none")
    files = (p for p in place.rglob("*") if p.suffix.lower() in SUFFIXES and p.is_file())
    names = sorted(p.relative_to(place).as_posix() for p in files)
    if not names:
        raise RsaDataError(f"--image {place}: expected images in this folder; found none")
    return names


def tell(
    about: dict[str, Any],
    place: Path,
    names: list[str],
    segments: str | None = None,
    weights: Path | None = None,
    card: Path | None = None,
) -> list[str]:
    """A caption of each image in the style that the head was trained on.

    about : head.json. Raises RsaDataError for an image that cannot be read.
    """
    _, captions = look(about, place, names, segments, weights, card)
    texts = dict(zip(captions["sample_id"].to_pylist(), captions["text"].to_pylist(), strict=True))
    return [texts[name] for name in names]


def look(
    about: dict[str, Any],
    place: Path,
    names: list[str],
    segments: str | None = None,
    weights: Path | None = None,
    card: Path | None = None,
) -> "tuple[pa.Table, pa.Table]":
    """Segments and plain captions of each image, as the head's tables have them; see `tell`."""
    import pyarrow as pa

    from ...captions import write
    from ...datasets.folder import folder
    from ...segments import detect
    from ...store import schemas

    options: dict[str, Any] = next(iter(about.get("captions", {}).values()), {})
    root = place.parent if place.is_file() else place
    blank = dict.fromkeys(schemas.schema("samples").names)
    rows = [
        blank | {"sample_id": n, "dataset": "folder", "split": "test", "scene": ".", "image": n}
        for n in names
    ]
    samples = pa.Table.from_pylist(rows, schemas.schema("samples"))
    found = detect.build(
        dataset=folder(),
        root=root,
        segments=segments or _segmenter_of(about),
        segmenter_weights=weights,
        card=card,
    )(samples)
    for row in found.select(["status", "error"]).to_pylist():
        if row["status"] != "ok":
            raise RsaDataError(f"--image: {row['error']}")
    return found, write.build(**{**options, "variants": 1})(found, samples)


def _segmenter_of(about: dict[str, Any]) -> str:
    """The model that described the images a head was trained on, if it was one; or the default."""
    from ... import registry
    from ...segments import detect

    used = {table.partition("/")[2] for table in about.get("segments", {}).values()}
    known = [n for n in used if registry.SEGMENTERS.get(n) == registry.SEGMENTERS[detect.DEFAULT]]
    return known[0] if len(known) == 1 else detect.DEFAULT


def relative_of(
    about: dict[str, Any],
    place: Path | None,
    name: str | None,
    relative: Path | None,
    weights: Path | None,
) -> tuple[np.ndarray, np.ndarray | None]:
    """y, float32 (h, w), of one image or map, and the image's colours, uint8 (h, w, 3), or None.

    From `relative`, a file or a folder of maps, or by the head's own depth model at the geometry
    it was trained for, resized to the image.
    """
    from ...datasets import images
    from ...depth.files import read
    from ...depth.measure import at_size

    colours = None
    try:
        if place is not None and name is not None:
            colours = images.read_image(place if place.is_file() else place / name)
        if relative is not None:
            file = (
                relative / str(Path(name).with_suffix(""))
                if name and relative.is_dir()
                else relative
            )
            found = read(file.parent, file.stem if relative.is_file() else file.name)
        else:
            assert place is not None and name is not None
            found = _source(about, place.parent if place.is_file() else place, weights)(name)
    except RowError as error:
        raise RsaDataError(f"predict: {error}") from error
    if colours is None:
        return found.y, None
    return at_size(found, *colours.shape[:2]), colours


def _source(about: dict[str, Any], root: Path, weights: Path | None) -> Any:
    from ... import registry
    from ...datasets.folder import folder

    model = about["depth_model"]
    if model["model"] in (None, "files"):
        raise UsageError(
            "predict: the head's relative depth came from files: give the images' own with "
            "--relative, from the same model at the same geometry"
        )
    ways = {str(g): g for g in model["geometry"].values()}
    if len(ways) > 1:
        raise UsageError(
            "predict: the head was trained on several geometries of its depth model "
            f"({'; '.join(ways)}): give --relative, made in one of these ways"
        )
    geometry: dict[str, Any] = next(iter(ways.values()), {})
    return registry.resolve("depth model", registry.DEPTH_MODELS, model["model"])(
        name=model["model"],
        argument="",
        dataset=folder(),
        root=root,
        weights=weights,
        geometry=geometry.get("geometry"),
        crop=geometry.get("crop") or "none",
        holds=(model["options"] or {}).get("files_hold", "relative"),
        threads=1,
    )

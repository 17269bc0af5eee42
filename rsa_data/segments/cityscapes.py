"""Segments of Cityscapes' instance maps: gtFine/SPLIT/CITY/*_gtFine_instanceIds.png."""

import contextlib
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any, Literal

import numpy as np
import pyarrow as pa

from ..common import class_names
from ..common.errors import RowError, RsaDataError
from ..common.prefetch import each
from ..datasets.dataset import Dataset
from ..datasets.roots import readers
from ..datasets.shards import name_of
from . import crowds, maps
from .found import Found, to_segments
from .segments import Segments, to_table

_WHERE = "segments/cityscapes"
_IMAGE, _MAP = "_leftImg8bit", "_gtFine_instanceIds.png"


def build(
    *,
    argument: str | None,
    dataset: Dataset,
    root: Path | None,
    images: Sequence[str] | None = None,
    masks: bool = False,
    crowd: Literal["omit", "stuff"] = "omit",
    **_: Any,
) -> Callable[[pa.Table], pa.Table]:
    """cityscapes:DIR: Cityscapes' instance maps, DIR being its folder gtFine.

    argument : the folder gtFine; the map of .../val/city/x_leftImg8bit.png is there at
        val/city/x_gtFine_instanceIds.png.
    images : the images of the whole dataset, so that no map belongs to two.
    """
    if not argument or not Path(argument).is_dir():
        raise RsaDataError(
            f"{_WHERE}: expected the folder gtFine; found none at {argument!r}. "
            "Write cityscapes:DIR/gtFine"
        )
    folder = Path(argument)

    whole = None if images is None else _owners(images)

    def one(image: str | None, owners: Mapping[str, int]) -> Segments:
        below = map_path(image)
        try:
            if owners[below] > 1:
                raise RowError(f"expected one image of this map, found {owners[below]}")
            ids = maps.fitted(maps.read_numbers(folder / below), root, image, "instance map")
            return segments(ids, masks, crowd=crowd)
        except RowError as error:
            raise RowError(f"{_WHERE}: {below}: {error}") from error

    def step(samples: pa.Table) -> pa.Table:
        names = samples["image"].to_pylist()
        owners = _owners(names) if whole is None else whole
        found = each(lambda image: one(image, owners), names, readers(root))
        return to_table(samples["sample_id"].to_pylist(), found)

    return step


def _owners(images: Iterable[str | None]) -> Counter[str]:
    """How many images each instance map would belong to."""
    owners: Counter[str] = Counter()
    for image in dict.fromkeys(images):
        with contextlib.suppress(RowError):
            owners[map_path(image)] += 1
    return owners


def map_path(image: str | None) -> str:
    """Where an image's instance map lies below gtFine: its last three parts, renamed."""
    path = PurePosixPath(name_of(image or ""))
    if len(path.parts) < 3 or not path.stem.endswith(_IMAGE):
        raise RowError(f"{_WHERE}: expected an image .../SPLIT/CITY/x{_IMAGE}.png, found {image}")
    split, city = path.parts[-3:-1]
    return f"{split}/{city}/{path.stem.removesuffix(_IMAGE)}{_MAP}"


def segments(ids: np.ndarray, with_masks: bool = False, *, crowd: str = "omit") -> Segments:
    """Segments of an instance map by id; the void classes (ground, ego vehicle, ...) are left out.

    ids : int (height, width): label id, or 1000 * label id + instance (cityscapesscripts,
    json2instanceImg); the label id alone of a class that has instances is a group of them, see
    crowds.sort_out. Raises RowError for a label id that Cityscapes does not have.
    """
    table = class_names.table("cityscapes-ids")
    height, width = ids.shape
    there = np.flatnonzero(np.bincount(ids.ravel()))
    number = np.where(there >= 1000, there // 1000, there)
    if strange := sorted(set(number[number > 33].tolist())):
        raise RowError(f"expected label ids up to 33, found {strange[:5]}")
    entries = [
        {"category_id": n, "iscrowd": i < 1000 and n in table.things, "place": k}
        for k, (i, n) in enumerate(zip(there.tolist(), number.tolist(), strict=True))
        if n in table.names
    ]
    kept, labels, things = crowds.sort_out(entries, table, crowd)
    chosen = np.array([entry["place"] for entry in kept], np.int64)
    place = np.full(int(ids.max()) + 1, -1)
    place[there[chosen]] = np.arange(len(chosen))
    score = np.ones(len(chosen))
    found = Found(number[chosen], score, index=place[ids], is_thing=things, label=labels)
    return to_segments(found, width, height, table, with_masks=with_masks)

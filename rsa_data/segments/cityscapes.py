"""Segments of Cityscapes' instance maps: gtFine/SPLIT/CITY/*_gtFine_instanceIds.png."""

from collections.abc import Callable
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import pyarrow as pa

from ..common import class_names
from ..common.errors import RowError, RsaDataError
from ..common.prefetch import each
from ..datasets.dataset import Dataset
from ..datasets.roots import readers
from . import maps
from .found import Found, to_segments
from .segments import Segments, to_table

_WHERE = "segments/cityscapes"
_IMAGE, _MAP = "_leftImg8bit", "_gtFine_instanceIds.png"


def build(
    *,
    argument: str | None,
    dataset: Dataset,
    root: Path | None,
    masks: bool = False,
    **_: Any,
) -> Callable[[pa.Table], pa.Table]:
    """cityscapes:DIR: Cityscapes' instance maps, DIR being its folder gtFine.

    argument : the folder gtFine; the map of .../val/city/x_leftImg8bit.png is there at
        val/city/x_gtFine_instanceIds.png.
    """
    if not argument or not Path(argument).is_dir():
        raise RsaDataError(
            f"{_WHERE}: expected the folder gtFine; found none at {argument!r}. "
            "Write cityscapes:DIR/gtFine"
        )
    folder = Path(argument)

    def one(image: str | None) -> Segments:
        below = map_path(image)
        try:
            ids = maps.read_numbers(folder / below)
            maps.check_size(ids, root, image, "instance map")
            return segments(ids, masks)
        except RowError as error:
            raise RowError(f"{_WHERE}: {below}: {error}") from error

    def step(samples: pa.Table) -> pa.Table:
        found = each(one, samples["image"].to_pylist(), readers(root))
        return to_table(samples["sample_id"].to_pylist(), found)

    return step


def map_path(image: str | None) -> str:
    """Where an image's instance map lies below gtFine: its last three parts, renamed."""
    path = PurePosixPath(image or "")
    if len(path.parts) < 3 or not path.stem.endswith(_IMAGE):
        raise RowError(f"{_WHERE}: expected an image .../SPLIT/CITY/x{_IMAGE}.png, found {image}")
    split, city = path.parts[-3:-1]
    return f"{split}/{city}/{path.stem.removesuffix(_IMAGE)}{_MAP}"


def segments(ids: np.ndarray, with_masks: bool = False) -> Segments:
    """Segments of an instance map by id; the void classes (ground, ego vehicle, ...) are left out.

    ids : int (height, width): label id, or 1000 * label id + instance (cityscapesscripts,
    json2instanceImg). Raises RowError for a label id that Cityscapes does not have.
    """
    table = class_names.table("cityscapes-ids")
    height, width = ids.shape
    there = np.flatnonzero(np.bincount(ids.ravel()))
    number = np.where(there >= 1000, there // 1000, there)
    if strange := sorted(set(number[number > 33].tolist())):
        raise RowError(f"expected label ids up to 33, found {strange[:5]}")
    named = np.array([n in table.names for n in number.tolist()], bool)
    place = np.full(int(ids.max()) + 1, -1)
    place[there[named]] = np.arange(named.sum())
    found = Found(number[named], np.ones(int(named.sum())), index=place[ids])
    return to_segments(found, width, height, table, with_masks=with_masks)

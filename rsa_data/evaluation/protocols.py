"""Which pixels count and in what range: the protocols of the codebases that tables come from."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from .. import registry
from ..common.errors import RowError, UsageError
from ..datasets import index
from ..datasets.dataset import Dataset
from ..datasets.kitti import CROP

# (height, width) -> bool array of that shape, True where pixels count.
Region = Callable[[int, int], np.ndarray]


@dataclass(frozen=True)
class Rules:
    """How one dataset is evaluated under a protocol.

    region : the crop. min_depth, max_depth : m; ground truth strictly between them counts, and
        predictions are clipped to them.
    median_scaled : each prediction is first multiplied by the median of the ground truth over its
        own median, so that only its shape is judged. Always before clipping.
    beyond : the depth where scale * y + shift is negative: far, the maximum, as a point beyond
        everything; near, the minimum, as the released code of RSA has it by its clipping.
    """

    region: Region
    min_depth: float
    max_depth: float
    median_scaled: bool = False
    beyond: Literal["far", "near"] = "far"


def whole(height: int, width: int) -> np.ndarray:
    """No crop."""
    return np.ones((height, width), bool)


def eigen(height: int, width: int) -> np.ndarray:
    """The crop of NYU frames of 640x480 px, rows 45 to 471 and columns 41 to 601 (BTS)."""
    if (height, width) != (480, 640):
        raise RowError(f"the Eigen crop is defined on 640x480 px, found {width}x{height}")
    return _rectangle(height, width, 45, 471, 41, 601)


def eigen_numbers(height: int, width: int) -> np.ndarray:
    """Rows 45 to 471 and columns 41 to 601 of a map of any size, as far as it reaches.

    What Depth Anything's code does with SUN RGB-D, whose images have many sizes.
    """
    return _rectangle(height, width, 45, 471, 41, 601)


def garg(height: int, width: int) -> np.ndarray:
    """Garg's crop of KITTI as fractions of the map (Garg et al. 2016; numbers of Monodepth)."""
    rows = int(0.40810811 * height), int(0.99189189 * height)
    columns = int(0.03594771 * width), int(0.96405229 * width)
    return _rectangle(height, width, *rows, *columns)


def kb_garg(height: int, width: int) -> np.ndarray:
    """KITTI's benchmark crop, 352 rows at the bottom and 1216 columns, then Garg's of that."""
    if height < CROP[0] or width < CROP[1]:
        raise RowError(f"the KB crop needs at least {CROP[1]}x{CROP[0]} px, found {width}x{height}")
    top, left = height - CROP[0], (width - CROP[1]) // 2
    region = np.zeros((height, width), bool)
    region[top:, left : left + CROP[1]] = garg(*CROP)
    return region


def _rectangle(height: int, width: int, y0: int, y1: int, x0: int, x1: int) -> np.ndarray:
    region = np.zeros((height, width), bool)
    region[y0:y1, x0:x1] = True
    return region


# Minimum depth of every protocol. The code of RSA takes VOID's 0.2 m for NYU and KITTI too, by
# accident; this product does not.
_MIN = 1e-3

_RSA = {
    "nyuv2": Rules(whole, _MIN, 10.0),
    "kitti": Rules(kb_garg, _MIN, 80.0),
    "void": Rules(whole, 0.2, 5.0),
}
_BTS = _RSA | {"nyuv2": Rules(eigen, _MIN, 10.0)}


@dataclass(frozen=True)
class Protocol:
    """What is measured on every dataset.

    about : a sentence for lists, with where it comes from.
    rules : by the dataset's name in the registry. Datasets without rules are evaluated whole, in
        their own range.
    median_scaled : whether these are scaled by the median, see Rules.
    """

    about: str
    rules: Mapping[str, Rules]
    median_scaled: bool = False

    @property
    def __doc__(self) -> str | None:  # type: ignore[override]
        return self.about

    def of(self, dataset: Dataset, kind: str) -> Rules:
        """The rules for a dataset.

        kind : the dataset's name in the registry, where `dataset.name` may be a user's own.
        """
        own = Rules(whole, dataset.min_depth, dataset.max_depth, median_scaled=self.median_scaled)
        return self.rules.get(kind, own)


RSA = Protocol(
    "Whole NYUv2 and VOID, KITTI in the KB crop and Garg's of that, as RSA has it.", _RSA
)
BTS = Protocol("As rsa, with Eigen's crop on NYUv2, as BTS and Depth Anything have it.", _BTS)
MONODEPTH2 = Protocol(
    "Eigen's and Garg's crops, each prediction scaled by the ground truth's median (Monodepth2).",
    {
        "nyuv2": Rules(eigen, _MIN, 10.0, median_scaled=True),
        "kitti": Rules(garg, _MIN, 80.0, median_scaled=True),
    },
    median_scaled=True,
)
DEPTH_ANYTHING = Protocol(
    "As bts, with the ranges and crops that Depth Anything's code takes for SUN RGB-D and DDAD.",
    {**_BTS, "sunrgbd": Rules(eigen_numbers, _MIN, 8.0), "ddad": Rules(garg, _MIN, 80.0)},
)


def protocol(name: str) -> Protocol:
    """A protocol by its name; raises UsageError for an unknown one."""
    found: Protocol = registry.resolve("protocol", registry.PROTOCOLS, name)
    return found


def of_names(name: str | None, dataset: str | None) -> Rules:
    """The rules of a protocol for a dataset of the registry, both by name."""
    if name is None or dataset is None:
        raise UsageError("depth_errors: expected protocol and dataset together")
    found = protocol(name)
    if dataset in found.rules:
        return found.rules[dataset]
    return found.of(index.open_dataset(dataset, {})[0], dataset)

"""Options that evaluate, robustness and compare share."""

from dataclasses import dataclass
from typing import Literal

from ..common.errors import unknown
from ..common.ranges import Count
from .protocols import PROTOCOLS


@dataclass(frozen=True)
class Measuring:
    """How it is measured.

    protocol : crops, depth range and scaling; rsa, bts, monodepth2 or depth-anything.
    split : what to measure on; its depth must be stored as whole maps. Another one for single
        datasets as test,ddad=val.
    beyond : depth where scale * y + shift is negative: far, the maximum, or near, the minimum, as
        the released code has it.
    draws : resamplings of scenes for the confidence intervals; 0 for none.
    """

    protocol: str = "rsa"
    split: str = "test"
    beyond: Literal["far", "near"] = "far"
    draws: Count = 1000

    def __post_init__(self) -> None:
        if self.protocol not in PROTOCOLS:
            raise unknown("protocol", self.protocol, PROTOCOLS)

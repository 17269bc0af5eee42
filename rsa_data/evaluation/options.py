"""Options that evaluate, robustness and compare share."""

from dataclasses import dataclass
from typing import Literal

from .. import registry
from ..common.ranges import Count


@dataclass(frozen=True)
class Measuring:
    """How it is measured.

    protocol : crops, depth range and scaling; one of `rsa-data list protocols`.
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
        registry.check("protocol", registry.PROTOCOLS, self.protocol)

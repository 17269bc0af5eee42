"""Options of the stage captions, in groups."""

from dataclasses import dataclass
from typing import Annotated

import msgspec

from ..common.ranges import Amount, Count, Share
from .augment import Domain
from .objects import Which


@dataclass(frozen=True, kw_only=True)
class Contents:
    """What a caption says.

    objects : which objects a caption names: all, things (countable) or background.
    group : equal classes become one object, as in "3 chairs occupy 8.00% of the image".
    digits : decimals of a percentage, 0 to 3.
    tokenizer : what counts the tokens of a text; see `rsa-data list tokenizers`.
    max_tokens : the most tokens of a text, start and end tokens included. Not given: the
        tokenizer's own limit; 0: no limit.
    """

    objects: Which = "all"
    group: bool = False
    digits: Annotated[int, msgspec.Meta(ge=0, le=3)] = 2
    tokenizer: str = "clip"
    max_tokens: Annotated[int, msgspec.Meta(ge=0, le=2**30)] | None = None


@dataclass(frozen=True, kw_only=True)
class Augmentation:
    """How the captions of an image differ: swap and delete.

    variants : captions an image, of which variant 0 is the plain one, largest object first.
    seed : of swap and delete.
    delete : probability that an object is left out of an augmented caption, 0 to 1.
    delete_by_area : delete with probability 1 - sigmoid(this x share of the image) instead: the
        rule of older versions of the released code (100 or 10). At its last commit the rule stands
        in a comment, with 1, and nothing is deleted: the texts come ready from files.
    """

    variants: Annotated[int, msgspec.Meta(ge=1, lt=2**15)] = 5
    seed: Count = 0
    delete: Share = 0.2
    delete_by_area: Amount | None = None


@dataclass(frozen=True, kw_only=True)
class WrongObjects:
    """Objects that do not belong, for robustness tests.

    replace : probability that an object of an augmented caption becomes one of another domain.
    insert : objects of another domain added to each augmented caption.
    domain : where replaced and inserted objects come from, street or indoor.
    """

    replace: Share = 0.0
    insert: Annotated[int, msgspec.Meta(ge=0, le=1000)] = 0
    domain: Domain = "street"

"""Options of the stage captions, in groups."""

from dataclasses import dataclass

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
    digits: int = 2
    tokenizer: str = "clip"
    max_tokens: int | None = None


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

    variants: int = 5
    seed: int = 0
    delete: float = 0.2
    delete_by_area: float | None = None


@dataclass(frozen=True, kw_only=True)
class WrongObjects:
    """Objects that do not belong, for robustness tests.

    replace : probability that an object of an augmented caption becomes one of another domain.
    insert : objects of another domain added to each augmented caption.
    domain : where replaced and inserted objects come from, street or indoor.
    """

    replace: float = 0.0
    insert: int = 0
    domain: Domain = "street"

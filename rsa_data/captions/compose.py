"""Captions of one block of images: objects, their cost in tokens, choice, text."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache, partial
from itertools import count

import numpy as np
import pyarrow as pa

from ..common.tokenizers import Tokenizer
from . import augment, chance
from .assemble import Column, texts
from .caption_table import Columns
from .choose import Chosen, choose
from .objects import Objects, from_segments
from .options import Augmentation, Contents, WrongObjects
from .wordings.wording import NOTHING, Wording
from .words import Word, word


@dataclass(frozen=True)
class Recipe:
    """How captions are written: the options of the stage, names resolved.

    limit : the most tokens of a text.
    """

    wording: Wording
    tokenizer: Tokenizer
    limit: int
    augmentation: Augmentation
    contents: Contents
    wrong: WrongObjects


# Times that a budget is widened where the tables overestimate.
_LOOSENED = 8


def compose(
    recipe: Recipe, segments: pa.Table, samples: pa.Table, label: np.ndarray, names: list[str]
) -> Columns:
    """The columns of the captions of a block that `measured` names.

    The images of a block times the variants are at most choose.CAPTIONS_A_BLOCK; all rows are ok.

    samples : of the same images. label : int32 of shape (segments,), indices into `names`.
    """
    wording, contents = recipe.wording, recipe.contents
    variants = recipe.augmentation.variants
    found, keys, plain, names = altered(
        segments, samples, label, names, recipe.augmentation, contents, recipe.wrong
    )
    opening, of_image = _openings(wording, samples)
    if len(keys) != variants:  # each caption has become an image of its own
        of_image = np.repeat(of_image, variants)
    words = [word(name) for name in names]
    phrase = wording.phrase(found, words, contents.digits)
    tokens = partial(_tokens, recipe.tokenizer)
    between, last, closing = tokens((wording.between, wording.last, wording.closing))
    cost = np.full(len(found.label), between, np.int32)
    for column in phrase:
        counts = tokens(tuple(column.strings))
        cost += counts[0] if column.codes is None else counts[column.codes]
    around = recipe.tokenizer.specials + tokens(opening)[of_image] + closing - between
    before = Column(opening, of_image[found.image])
    delete = deletion(found, recipe.augmentation)

    def attempt(budget: np.ndarray) -> tuple[Chosen, pa.Array]:
        chosen = choose(found.first, cost, around, budget, keys, plain, delete, int(last - between))
        signs = (wording.between, wording.last, wording.closing)
        return chosen, texts(chosen, phrase, before, *signs, NOTHING)

    budget = np.full(keys.shape, recipe.limit, np.int32)
    if recipe.tokenizer.additive and all(_adds_up(recipe.tokenizer, w) for w in words):
        chosen, text = attempt(budget)
        nothing = recipe.tokenizer.specials + tokens((NOTHING,))[0]
        n_tokens = np.where(_empty(chosen), nothing, chosen.n_tokens)
    else:
        chosen, text, n_tokens = _counted(recipe, attempt, budget)
    return {"text": text, "n_tokens": n_tokens, **_kept(found, chosen, len(keys))}


def _counted(
    recipe: Recipe, attempt: Callable[[np.ndarray], tuple[Chosen, pa.Array]], budget: np.ndarray
) -> tuple[Chosen, pa.Array, np.ndarray]:
    """Texts within the limit for tokenizers whose pieces do not add up: tables only estimate.

    The texts are counted, and each caption's budget is corrected by what its estimate was off.
    """
    passed = np.zeros(budget.size, bool)
    for round_number in count():
        chosen, text = attempt(budget)
        n_tokens = recipe.tokenizer.count(text.to_pylist())
        over = (n_tokens > recipe.limit) & ~_empty(chosen)
        passed |= over
        now = budget.T.ravel()  # (captions,)
        better = recipe.limit + chosen.n_tokens - n_tokens
        tighter = np.where(over, np.minimum(better, now - 1), now)
        looser = ~passed & (better > now) & (round_number < _LOOSENED)
        after = np.where(looser, better, tighter)
        if (after == now).all():
            break
        budget = np.ascontiguousarray(after.reshape(budget.shape[::-1]).T)
    return chosen, text, n_tokens


@lru_cache(maxsize=256)
def _tokens(tokenizer: Tokenizer, strings: tuple[str, ...]) -> np.ndarray:
    """int32: tokens of each string by itself, without start and end tokens."""
    return tokenizer.count(strings) - tokenizer.specials


@cache
def _adds_up(tokenizer: Tokenizer, word: Word) -> bool:
    # A name may end in what the tokenizer joins with the comma that follows.
    names = (word.name, word.plural)
    strings = [*names, *(f"{name}, {name} x" for name in names), ",", "x"]
    *once, first, second, comma, end = (tokenizer.count(strings) - tokenizer.specials).tolist()
    return [first, second] == [2 * n + comma + end for n in once]


def _openings(wording: Wording, samples: pa.Table) -> tuple[tuple[str, ...], np.ndarray]:
    """The distinct openings, and which one each image has."""
    if isinstance(wording.opening, str):
        return (wording.opening,), np.zeros(len(samples), np.int64)
    distinct: dict[str, int] = {}
    codes = [distinct.setdefault(text, len(distinct)) for text in wording.opening(samples)]
    return tuple(distinct), np.array(codes, np.int64)


def altered(
    segments: pa.Table,
    samples: pa.Table,
    label: np.ndarray,
    names: list[str],
    augmentation: Augmentation,
    contents: Contents,
    wrong: WrongObjects,
) -> tuple[Objects, np.ndarray, np.ndarray, list[str]]:
    """The objects of a block of images before any is deleted, wrong ones among them.

    Returns the objects; the keys of their captions, uint64, and which captions are plain, bool,
    both of shape (variants, images); and the names of the classes. Where wrong objects are asked
    for, each caption is an image of its own, and both have the shape (1, captions).
    """
    found = from_segments(segments, samples, label, contents.objects, contents.group)
    ids = segments["sample_id"].to_pylist()
    keys = chance.caption_keys(augmentation.seed, ids, augmentation.variants)
    plain: np.ndarray = np.zeros(keys.shape, bool)  # (variants, images)
    plain[0] = True
    if not wrong.replace and not wrong.insert:
        return found, keys, plain, names
    numbers = {name: number for number, name in enumerate(names)}
    classes = augment.CLASSES[wrong.domain]
    others = np.array([numbers.setdefault(name, len(numbers)) for name in classes])
    found = augment.with_wrong_objects(found, keys, plain, others, wrong.replace, wrong.insert)
    keys, plain = keys.T.reshape(1, -1), plain.T.reshape(1, -1)  # (1, captions)
    return found, keys, plain, list(numbers)


def deletion(found: Objects, augmentation: Augmentation) -> np.ndarray:
    """The probability that each object is deleted from an augmented caption, float64 (objects,)."""
    if augmentation.delete_by_area is None:
        return np.full(len(found.label), augmentation.delete)
    # 1 - sigmoid(lambda * area): RSA's utils.py, get_text.
    return 1 / (1 + np.exp(augmentation.delete_by_area * found.area))


def _empty(chosen: Chosen) -> np.ndarray:
    """bool of shape (captions,): those without objects."""
    empty = np.ones(len(chosen.n_tokens), bool)
    empty[chosen.caption[chosen.object >= 0]] = False
    return empty


def _kept(found: Objects, chosen: Chosen, variants: int) -> Columns:
    """What is counted of each caption's objects; schemas/captions.toml declares the columns."""
    some = chosen.object >= 0
    caption, area = chosen.caption[some], found.area[chosen.object[some]]
    images, captions = len(found.first) - 1, len(chosen.n_tokens)
    return {
        "n_objects": np.repeat(np.diff(found.first), variants),
        "n_kept": np.bincount(caption, minlength=captions),
        "area": np.repeat(np.bincount(found.image, found.area, images), variants),
        "area_kept": np.bincount(caption, area, captions),
    }

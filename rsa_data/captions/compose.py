"""Captions of one block of images: objects, their cost in tokens, choice, text."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache, partial
from itertools import count

import numpy as np
import pyarrow as pa

from ..encoders.tokenizers import Tokenizer
from . import augment, chance
from .assemble import Column, texts
from .choose import Chosen, choose
from .objects import Objects, Which, from_segments
from .styles import NOTHING, Wording
from .words import word


@dataclass(frozen=True)
class Recipe:
    """How captions are written: the options of the stage, names resolved.

    limit : the most tokens of a text. delete_by_area : None for the same probability for all.
    The others are as in `write.build`.
    """

    wording: Wording
    tokenizer: Tokenizer
    limit: int
    variants: int
    seed: int
    delete: float
    delete_by_area: float | None
    objects: Which
    group: bool
    digits: int
    replace: float
    insert: int
    domain: augment.Domain


# Times that a budget is widened where the tables overestimate.
_LOOSENED = 8

Columns = dict[str, pa.Array | np.ndarray]


def composer(recipe: Recipe) -> Callable[[pa.Table, pa.Table, np.ndarray, list[str]], Columns]:
    """(segments, their samples, label of each segment, names of the labels) -> caption columns.

    The images of a block times the variants are at most choose.CAPTIONS_A_BLOCK; all rows are ok.
    """
    tokenizer, wording = recipe.tokenizer, recipe.wording
    tokens = partial(_tokens, tokenizer)

    @cache
    def adds_up(name: str) -> bool:
        # A name may end in what the tokenizer joins with the comma that follows.
        once, comma, end, twice = tokens((name, ",", "x", f"{name}, {name} x")).tolist()
        return bool(twice == 2 * once + comma + end)

    def block(
        segments: pa.Table, samples: pa.Table, label: np.ndarray, names: list[str]
    ) -> Columns:
        found = from_segments(segments, samples, label, recipe.objects, recipe.group)
        keys = chance.caption_keys(
            recipe.seed, segments["sample_id"].to_pylist(), recipe.variants
        )  # (variants, images)
        plain: np.ndarray = np.zeros(keys.shape, bool)
        plain[0] = True
        opening, of_image = _openings(wording, samples)
        if recipe.replace or recipe.insert:
            numbers = {name: number for number, name in enumerate(names)}
            classes = augment.CLASSES[recipe.domain]
            wrong = np.array([numbers.setdefault(name, len(numbers)) for name in classes])
            names = list(numbers)
            found = augment.with_wrong_objects(
                found, keys, plain, wrong, recipe.replace, recipe.insert
            )
            of_image = np.repeat(of_image, recipe.variants)
            keys, plain = keys.T.reshape(1, -1), plain.T.reshape(1, -1)  # (1, captions)
        words = [word(name) for name in names]
        phrase = wording.phrase(found, words, recipe.digits)
        opening_column = Column(opening, of_image[found.image])
        comma, last, closing, nothing = tokens(
            (wording.between, wording.last, wording.closing, NOTHING)
        )
        cost = np.full(len(found.label), comma, np.int32)
        for column in phrase:
            counts = tokens(tuple(column.strings))
            cost += counts[0] if column.codes is None else counts[column.codes]
        around = tokens(opening)[of_image] + closing - comma + tokenizer.specials
        budget = np.full(keys.shape, recipe.limit, np.int32)
        delete = _delete(found, recipe)

        def attempt(budget: np.ndarray) -> tuple[Chosen, pa.Array]:
            chosen = choose(
                found.first, cost, around, budget, keys, plain, delete, int(last - comma)
            )
            return chosen, texts(
                chosen,
                phrase,
                opening_column,
                wording.between,
                wording.last,
                wording.closing,
                NOTHING,
            )

        chosen, text = attempt(budget)
        none = np.ones(len(text), bool)
        none[chosen.caption[chosen.object >= 0]] = False
        if tokenizer.additive and all(adds_up(w.name) and adds_up(w.plural) for w in words):
            n_tokens = np.where(none, nothing + tokenizer.specials, chosen.n_tokens)
        else:
            # Tables only estimate: count the texts, and correct the budget by what they were off.
            passed = np.zeros(len(text), bool)
            for attempts in count():
                n_tokens = tokenizer.count(text.to_pylist())
                over = (n_tokens > recipe.limit) & ~none
                passed |= over
                better = recipe.limit + chosen.n_tokens - n_tokens
                now = budget.T.ravel()
                tighter = np.where(over, np.minimum(better, now - 1), now)
                looser = ~passed & (better > now) & (attempts < _LOOSENED)
                after = np.where(looser, better, tighter)
                if (after == now).all():
                    break
                budget = np.ascontiguousarray(after.reshape(budget.shape[::-1]).T)
                chosen, text = attempt(budget)
                none[:] = True
                none[chosen.caption[chosen.object >= 0]] = False
        return {"text": text, "n_tokens": n_tokens, **_kept(found, chosen, len(text), len(keys))}

    return block


@lru_cache(maxsize=256)
def _tokens(tokenizer: Tokenizer, strings: tuple[str, ...]) -> np.ndarray:
    """int32: tokens of each string by itself, without start and end tokens."""
    return tokenizer.count(strings) - tokenizer.specials


def _openings(wording: Wording, samples: pa.Table) -> tuple[tuple[str, ...], np.ndarray]:
    """The distinct openings, and which one each image has."""
    if isinstance(wording.opening, str):
        return (wording.opening,), np.zeros(len(samples), np.int64)
    distinct: dict[str, int] = {}
    codes = [distinct.setdefault(text, len(distinct)) for text in wording.opening(samples)]
    return tuple(distinct), np.array(codes, np.int64)


def _delete(found: Objects, recipe: Recipe) -> np.ndarray:
    if recipe.delete_by_area is None:
        return np.full(len(found.label), recipe.delete)
    # 1 - sigmoid(lambda * area): RSA's utils.py, get_text.
    return 1 / (1 + np.exp(recipe.delete_by_area * found.area))


def _kept(found: Objects, chosen: Chosen, captions: int, variants: int) -> Columns:
    """n_objects, n_kept, area and area_kept of each caption."""
    some = chosen.object >= 0
    caption, area = chosen.caption[some], found.area[chosen.object[some]]
    images = len(found.first) - 1
    return {
        "n_objects": np.repeat(np.diff(found.first), variants),
        "n_kept": np.bincount(caption, minlength=captions),
        "area": np.repeat(np.bincount(found.image, found.area, images), variants),
        "area_kept": np.bincount(caption, area, captions),
    }


def empty_columns(names: Sequence[str]) -> Columns:
    """What a block gives when there is no image."""
    return {name: pa.array([], pa.string()) if name == "text" else np.zeros(0) for name in names}

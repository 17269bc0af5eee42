"""Which objects stand in each caption, and in which order: swap, delete and the token budget."""

from dataclasses import dataclass

import numpy as np

from . import chance

# A sorting key is the caption's place in its block (16 bits), 32 random bits, the object's rank
# in its image (16 bits): unique, so that any sorting method gives the same order.
CAPTIONS_A_BLOCK = 65_536
_NOTHING = 0xFFFF
_CAPTION, _RANK = np.uint64(48), np.uint64(16)
# What a plain caption draws instead of random bits: never deleted, no shuffling.
_PLAIN = np.uint64(0xFFFFFFFF00000000)


@dataclass(frozen=True)
class Chosen:
    """The objects of each caption of a block, captions in order of image, then variant.

    caption : int64 of shape (k,), ascending: which caption an entry belongs to. Every caption has
        at least one entry.
    object : int64 of shape (k,), its object, in the order of the text; -1 where the caption is
        left with none.
    n_tokens : int32 of shape (captions,): the opening and the cost of what was chosen.
    """

    caption: np.ndarray
    object: np.ndarray
    n_tokens: np.ndarray


def choose(
    first: np.ndarray,
    cost: np.ndarray,
    opening: np.ndarray,
    budget: np.ndarray,
    keys: np.ndarray,
    plain: np.ndarray,
    delete: np.ndarray,
    last: int = 0,
) -> Chosen:
    """Keeps the largest objects that fit and were not deleted, then shuffles them.

    An object that does not fit is skipped and the next one is tried. Where delete would leave
    nothing, the largest object that fits stays. A plain caption deletes nothing and keeps the
    largest object first.

    first : int64 of shape (images + 1,), where each image's objects begin, largest first.
    cost : int32 of shape (objects,), tokens that an object adds to a text.
    opening : int32 of shape (images,), tokens of a text apart from its objects.
    budget : int32 of shape (variants, images), the most tokens of each caption.
    keys : uint64 of shape (variants, images), as `chance.caption_keys` gives.
    plain : bool of shape (variants, images).
    delete : float64 of shape (objects,), the probability that an object is deleted, 0 to 1.
    last : tokens that a text of several objects has beside theirs ("and").
    """
    variants, images = keys.shape
    order = np.argsort(first[:-1] - first[1:], kind="stable")  # most objects first
    start, sizes = first[order], first[order + 1] - first[order]
    keys, budget, plain = keys[:, order], budget[:, order], plain[:, order]
    caption = order * variants + np.arange(variants)[:, None]
    place = caption.astype(np.uint64) << _CAPTION
    empty = np.repeat(opening[order].astype(np.int32)[None], variants, 0)
    used, bits = empty.copy(), np.empty_like(keys)
    below = np.minimum(np.rint(delete * 2.0**32), 2.0**32 - 1).astype(np.uint64)
    found = []
    for rank in range(int(sizes[0]) if images else 0):
        # Images with more than `rank` objects stand at the front: whole columns without gaps.
        m = int(np.searchsorted(-sizes, -rank))
        rows = start[:m] + rank
        key = chance.object_bits(keys[:, :m], rank, bits[:, :m])
        np.copyto(key, _PLAIN, where=plain[:, :m])
        total = used[:, :m] + cost[rows]
        spent = total + last * (used[:, :m] > empty[:, :m]) if last else total
        keep = spent <= budget[:, :m]
        keep &= (key >> np.uint64(32)) >= below[rows]
        np.copyto(used[:, :m], total, where=keep)
        key <<= np.uint64(32)
        key >>= _RANK
        key |= place[:, :m]
        key |= np.uint64(rank)
        found.append(key[keep])
    found.append(_spared(used, place, start, sizes, cost, empty, budget))
    entries = np.concatenate(found)
    entries.sort()
    chosen = (entries >> _CAPTION).astype(np.int64)
    ranks = (entries & np.uint64(_NOTHING)).astype(np.int64)
    objects = np.where(ranks == _NOTHING, -1, first[chosen // variants] + ranks)
    n_tokens = np.empty(variants * images, np.int32)
    n_tokens[caption] = used
    if last:
        n_tokens += last * (np.bincount(chosen, minlength=len(n_tokens)) > 1)
    return Chosen(chosen, objects, n_tokens)


def _spared(
    used: np.ndarray,
    place: np.ndarray,
    start: np.ndarray,
    sizes: np.ndarray,
    cost: np.ndarray,
    empty: np.ndarray,
    budget: np.ndarray,
) -> np.ndarray:
    """Keys for the captions that were left with nothing; adds their cost to `used`."""
    variant, image = np.nonzero(used == empty)
    found = []
    for rank in range(int(sizes[image].max(initial=0))):
        there = sizes[image] > rank
        spent = used[variant, image] + cost[np.where(there, start[image] + rank, 0)]
        fits = there & (spent <= budget[variant, image])
        used[variant[fits], image[fits]] = spent[fits]
        found.append(place[variant[fits], image[fits]] | np.uint64(rank))
        variant, image = variant[~fits], image[~fits]
    found.append(place[variant, image] | np.uint64(_NOTHING))
    return np.concatenate(found)

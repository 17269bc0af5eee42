"""Wrong objects for robustness tests: classes of another domain replace objects or join them."""

from dataclasses import replace as changed
from typing import Literal

import numpy as np

from ..common.splitmix import mix
from .noun_exceptions import names
from .objects import Objects, largest_first

Domain = Literal["street", "indoor"]

# Classes of COCO panoptic that belong to one domain and hardly to the other.
CLASSES: dict[Domain, tuple[str, ...]] = {
    "street": names(
        """car bus train truck boat motorcycle bicycle bridge road house river mountain railroad
        tree traffic-light fire-hydrant stop-sign parking-meter"""
    ),
    "indoor": names(
        """bed couch toilet tv laptop microwave oven toaster sink refrigerator book clock vase
        pillow blanket curtain towel cabinet shelf rug ceiling counter dining-table teddy-bear"""
    ),
}

# Shares of the image that inserted objects have, log-uniform: from a cup to a cupboard.
_SMALLEST, _LARGEST = 0.002, 0.2
# Streams of random bits that shuffling and deleting do not use.
_REPLACE, _INSERT = np.uint64(0x5245504C414345), np.uint64(0x494E53455254)


def with_wrong_objects(
    found: Objects,
    keys: np.ndarray,
    plain: np.ndarray,
    wrong: np.ndarray,
    replace: float,
    insert: int,
) -> Objects:
    """The objects of every caption as if it were an image of its own, some of them wrong.

    keys : uint64 of shape (variants, images); plain : bool of the same shape, captions to leave
        as they are.
    wrong : integer array, labels of the classes that do not belong.
    replace : probability that an object's class becomes a wrong one, 0 to 1; its share stays.
    insert : wrong objects to add to each caption.
    Returns objects whose images are captions, in order of image, then variant.
    """
    variants = len(keys)
    keys, plain = keys.T.ravel(), plain.T.ravel()  # (captions,)
    per_image = np.diff(found.first)
    sizes = np.repeat(per_image, variants)
    caption = np.repeat(np.arange(len(keys)), sizes)
    rank = np.arange(len(caption)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    copy = found.take(found.first[caption // variants] + rank)
    bits = _bits(keys[caption] ^ _REPLACE, rank)
    label = np.where(
        _uniform(bits) < replace * ~plain[caption], _pick(bits, wrong, copy.label), copy.label
    )
    more = np.repeat(np.flatnonzero(~plain), insert)
    bits = _bits(keys[more] ^ _INSERT, np.tile(np.arange(insert), int((~plain).sum())))
    area = _SMALLEST * (_LARGEST / _SMALLEST) ** _uniform(bits)
    within = mix(bits + np.uint64(1))
    xy = np.stack([_uniform(within), _uniform(within << np.uint64(32))], 1)  # shares of the image
    center, cell = copy.center, copy.cell
    if center is not None:
        spot = np.zeros(xy.shape) if found.size is None else xy * found.size[more // variants]
        center = np.concatenate([center, spot.astype(np.float32)])
    if cell is not None:
        third = (3 * xy).astype(np.int8)
        cell = np.concatenate([cell, 3 * third[:, 1] + third[:, 0]])
    image = np.concatenate([caption, more])
    order = np.argsort(image, kind="stable")
    everything = changed(
        copy,
        label=np.concatenate([label, _pick(bits, wrong, None)]).astype(np.int32),
        count=np.concatenate([copy.count, np.ones(len(more), np.int32)]),
        area=np.concatenate([copy.area, area]),
        center=center,
        cell=cell,
        size=None if found.size is None else np.repeat(found.size, variants, 0),
        image=image,
    ).take(order)
    order, first = largest_first(everything.area, everything.image, len(keys))
    return changed(everything.take(order), first=first)


def _bits(keys: np.ndarray, index: np.ndarray) -> np.ndarray:
    return mix(mix(keys) + index.astype(np.uint64))


def _uniform(bits: np.ndarray) -> np.ndarray:
    return (bits >> np.uint64(32)) / 2.0**32


def _pick(bits: np.ndarray, wrong: np.ndarray, label: np.ndarray | None) -> np.ndarray:
    """A wrong class by the lower bits; the next one where it would be the object's own."""
    place = ((bits & np.uint64(0xFFFFFFFF)) % np.uint64(len(wrong))).astype(np.int64)
    if label is not None:
        place = (place + (wrong[place] == label)) % len(wrong)
    return wrong[place]

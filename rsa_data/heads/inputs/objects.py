"""The input `objects`: what stands in an image, any number of things, none included."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from ...store.tables import WorkDir
from .kinds import Feed, Kind, find, ranges
from .scene import Live, Maker, Scene, text_encoder, text_files

# What stands behind the feature of an object's name: logarithm of its share of the image, the
# share, whether they are known; x and y of its centre from the middle of the image in shares of
# width and height, whether they are known; whether it is a countable thing; and 1, as an object.
NUMBERS = ("log share", "share", "share known", "x", "y", "place known", "thing", "there")
_SMALLEST = 1e-4  # share of the image: what is smaller counts as this large


@dataclass(frozen=True)
class Objects:
    """Objects of n images.

    names : float32 (v, d), the feature of each distinct name. name : int64 (o,), which of them
    each object has: those of image 0, then of image 1 ... numbers : float32 (o, 8), see NUMBERS.
    first : int64 (n + 1,), where each image's objects begin, and their end.
    there : bool (n,), images whose objects are known, be it that there are none.
    """

    names: np.ndarray
    name: np.ndarray
    numbers: np.ndarray
    first: np.ndarray
    there: np.ndarray
    objects: int = 1

    @property
    def width(self) -> int:
        return int(self.names.shape[1]) + len(NUMBERS)

    @property
    def nbytes(self) -> int:
        arrays = (self.names, self.name, self.numbers, self.first, self.there)
        return sum(array.nbytes for array in arrays)

    def take(self, images: np.ndarray, variants: int | None = None) -> Self:
        counts = np.diff(self.first)[images]
        rows = ranges(self.first[images], counts)
        used, name = np.unique(self.name[rows], return_inverse=True)
        first = np.concatenate([[0], np.cumsum(counts)])
        return type(self)(self.names[used], name, self.numbers[rows], first, self.there[images])

    def joined(self, others: Sequence[Self]) -> Self:
        several = [self, *others]
        names = np.cumsum([0] + [len(o.names) for o in several])
        starts = np.cumsum([0] + [len(o.name) for o in several])
        first = [o.first[:-1] + n for o, n in zip(several, starts, strict=False)]
        return type(self)(
            np.concatenate([o.names for o in several]),
            np.concatenate([o.name + n for o, n in zip(several, names, strict=False)]),
            np.concatenate([o.numbers for o in several]),
            np.concatenate([*first, starts[-1:]]),
            np.concatenate([o.there for o in several]),
        )

    def rows(self, images: np.ndarray, drawn: np.ndarray) -> np.ndarray:
        """Objects side by side, float32 (b, m * width), 0 where an image has fewer than m."""
        counts = np.diff(self.first)[images]
        found = ranges(self.first[images], counts)
        most = int(counts.max(initial=0))
        rows = np.zeros((len(images), most, self.width), np.float32)
        place = ranges(np.zeros(len(counts), np.int64), counts)
        image = np.repeat(np.arange(len(images)), counts)
        rows[image, place, : -len(NUMBERS)] = self.names[self.name[found]]
        rows[image, place, -len(NUMBERS) :] = self.numbers[found]
        return rows.reshape(len(images), -1)

    def distinct(self) -> np.ndarray:
        return self.names

    def named(self) -> np.ndarray:
        """An object of each distinct name, without its numbers: float32 (v, width)."""
        return np.pad(self.names, ((0, 0), (0, len(NUMBERS))))

    def hidden(self, *, shares: bool = False, places: bool = False) -> Self:
        """The same objects, as if their shares or their places were not known."""
        numbers = self.numbers.copy()
        if shares:
            numbers[:, 0:3] = 0
        if places:
            numbers[:, 3:6] = 0
        return replace(self, numbers=numbers)

    def once(self) -> Self:
        """The first object of each name in each image: a list that does not count."""
        image = np.repeat(np.arange(len(self.there)), np.diff(self.first))
        pairs = np.stack([image, self.name], 1)
        kept = np.sort(np.unique(pairs, axis=0, return_index=True)[1])
        first = np.searchsorted(image[kept], np.arange(len(self.there) + 1))
        return replace(self, name=self.name[kept], numbers=self.numbers[kept], first=first)


def numbers(
    share: np.ndarray | None, center: np.ndarray | None, is_thing: np.ndarray
) -> np.ndarray:
    """What a head reads of objects beside their names, float32 (o, 8), see NUMBERS.

    share : (o,), 0 to 1, nan or None where it is not known. center : (o, 2), x and y in shares of
    width and height, nan or None where it is not known. is_thing : bool (o,).
    """
    found = np.zeros((len(is_thing), len(NUMBERS)), np.float32)
    if share is not None:
        known = np.isfinite(share)
        found[known, 0] = np.log(np.maximum(share[known], _SMALLEST))
        found[known, 1], found[known, 2] = share[known], 1
    if center is not None:
        known = np.isfinite(center).all(1)
        found[known, 3:5] = center[known] - 0.5
        found[known, 5] = 1
    found[:, 6], found[:, 7] = is_thing, 1
    return found


def read(work: WorkDir, dataset: str, feed: Feed, number: int, variant: int | None) -> Objects:
    """The objects of each image of a part; variants of captions make no difference."""
    ids = work.table(dataset, "samples").read(number, ["sample_id"])["sample_id"]
    return of_table(ids, work.table(dataset, feed.table).read(number))


def of_table(ids: pa.ChunkedArray, table: pa.Table) -> Objects:
    """The objects of images from a table of schemas/objects.toml, in the order of their ids."""
    new = table["new_name"].combine_chunks().flatten()
    features = b"".join(table["new_feature"].combine_chunks().flatten().to_pylist())
    names = np.frombuffer(features, "<f4").reshape(len(new), -1 if len(new) else 0)

    order = find(ids, table["sample_id"])
    table = table.take(np.maximum(order, 0))
    ok = np.asarray(pc.equal(table["status"], "ok")) & (order >= 0)
    column = table["name"].combine_chunks()
    counts = np.asarray(pc.list_value_length(column)).astype(np.int64)
    center = table["center"].combine_chunks()
    places = np.full((int(counts.sum()), 2), np.nan)
    known = np.repeat(np.asarray(center.is_valid()), counts)
    places[known] = np.asarray(center.flatten().flatten()).reshape(-1, 2)
    things = np.asarray(table["is_thing"].combine_chunks().flatten()).astype(bool)
    return Objects(
        names,
        find(column.flatten(), new),
        numbers(np.asarray(table["share"].combine_chunks().flatten()), places, things),
        np.concatenate([[0], np.cumsum(counts)]),
        ok,
    )


def _of_scenes(options: dict[str, Any], weights: Path | None) -> Maker:
    """Objects of scenes -> their rows, as those of the tables."""
    encode = text_encoder(options, weights)
    known: dict[str, np.ndarray] = {}

    def make(scenes: Sequence[Scene]) -> np.ndarray:
        things = [thing for scene in scenes for thing in scene.things or ()]
        names = list(dict.fromkeys(thing.name for thing in things))
        for name in names:
            if name not in known:
                known[name] = encode([name])[0].astype(np.float32)  # alone, as embed-objects does
        features = [known[name] for name in names]
        counts = [len(scene.things or ()) for scene in scenes]
        shares = np.array([np.nan if t.share is None else t.share for t in things], np.float64)
        places = np.array([t.center or (np.nan, np.nan) for t in things], np.float64)
        about = numbers(shares, places.reshape(-1, 2), np.array([t.is_thing for t in things], bool))
        return Objects(
            np.stack(features) if names else np.zeros((0, 0), np.float32),
            np.array([names.index(thing.name) for thing in things], np.int64),
            about,
            np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
            np.ones(len(scenes), bool),
        ).rows(np.arange(len(scenes)), np.zeros(len(scenes)))

    return make


OBJECTS = Kind(read, "objects", made_by="rsa-data embed-objects", live=Live(text_files, _of_scenes))

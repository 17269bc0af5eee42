"""One scene and the pictures taken of it: what a dataset would have of a real one."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .builder import Builder
from .relative import relative_depth
from .render import View, cast
from .rooms import room
from .shading import shade
from .solids import Camera
from .streets import street


@dataclass(frozen=True)
class World:
    """A family of scenes.

    build : (number, generator, views) -> a scene and that many cameras.
    outdoors : lit by the sun, under a sky. stream : sets its random numbers apart.
    """

    build: Callable[[int, np.random.Generator, int], tuple[Builder, list[Camera]]]
    outdoors: bool
    stream: int


INDOOR = World(room, False, 0)
STREET = World(street, True, 1)

# A segment below this share of the image is annotated as nothing: detectors do not find it either.
_SMALLEST = 0.0025
# Views that nobody would take: against a wall, or with one thing in the way.
_FEWEST, _LARGEST_STUFF, _LARGEST_THING, _NEAREST = 4, 0.85, 0.40, 0.6
_TRIES = 20
_BACKGROUND = frozenset(
    ("wall", "floor", "ceiling", "playing field", "road", "pavement", "grass", "building", "sky")
)


@dataclass(frozen=True)
class Shot:
    """One picture of a scene.

    image : uint8 (h, w, 3), RGB. depth : float32 (h, w), m along the optical axis, inf for the
    sky. relative : float32 (h, w), the relative depth, larger is nearer. segments : int32 (h, w),
    0 for none, else 1 + index in labels. labels : class names.
    """

    image: np.ndarray
    depth: np.ndarray
    relative: np.ndarray
    segments: np.ndarray
    labels: list[str]
    camera: Camera


def shoot(world: World, key: tuple[int, ...], views: int) -> list[Shot]:
    """The pictures of scene `key` (seed, split, number): the same for the same key, on their own.

    A scene of which one picture shows nothing much is thrown away and built anew.
    """
    for attempt in range(_TRIES):
        rng = np.random.default_rng([world.stream, *key, attempt])
        scene, cameras = world.build(key[-1], rng, views)
        labels = [*scene.names, "sky"] if world.outdoors else scene.names
        seen = []
        for camera in cameras:
            view = cast(scene.solids, camera)
            segments, names = _segments(view, labels)
            if attempt < _TRIES - 1 and not _worth_it(view.depth, segments, names):
                break
            seen.append((view, segments, names))
        else:  # painted only now: what is thrown away needs no light
            return [
                Shot(
                    shade(view, world.outdoors, rng),
                    view.depth,
                    relative_depth(view.depth, rng),
                    segments,
                    names,
                    view.camera,
                )
                for view, segments, names in seen
            ]
    raise AssertionError("the last attempt is always taken")


def _segments(view: View, labels: list[str]) -> tuple[np.ndarray, list[str]]:
    """Segments and labels of a shot: numbered from 1, largest first, small ones left out."""
    found = view.segments
    ids = np.where((found == 0) & ("sky" in labels), len(labels), found)
    pixels = np.bincount(ids.ravel(), minlength=len(labels) + 1)[1:]
    kept = [k for k in np.argsort(-pixels, kind="stable") if pixels[k] >= _SMALLEST * ids.size]
    number = np.zeros(len(labels) + 1, np.int32)
    number[[k + 1 for k in kept]] = np.arange(1, len(kept) + 1)
    return number[ids], [labels[k] for k in kept]


def _worth_it(depth: np.ndarray, segments: np.ndarray, labels: list[str]) -> bool:
    if len(labels) < _FEWEST or np.percentile(depth, 2) < _NEAREST:
        return False
    pixels = np.bincount(segments.ravel(), minlength=len(labels) + 1)[1:]
    share = pixels / segments.size
    return all(
        part < (_LARGEST_STUFF if label in _BACKGROUND else _LARGEST_THING)
        for part, label in zip(share, labels, strict=True)
    )

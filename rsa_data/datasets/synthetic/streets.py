"""Streets from an alley to a highway: a straight road, what lines it, and who is on it."""

from dataclasses import dataclass
from functools import cache

import numpy as np

from .builder import Builder, read_kinds
from .sizes import draw_size
from .solids import BOX, Camera, Solid

Range = tuple[float, float]


@dataclass(frozen=True)
class Kind:
    """One kind of street, a table `streets.*` of kinds.toml."""

    ground: str
    eye: Range
    road: Range
    walk: Range
    garden: Range
    length: Range
    fronts: list[tuple[str, float]]
    storeys: tuple[int, int]
    on_road: list[tuple[str, int, int]]
    beside: list[tuple[str, int, int]]


@cache
def kinds() -> list[Kind]:
    """The kinds of street, in the order of the file."""
    return [Kind(**table) for table in read_kinds()["streets"].values()]


_GROUND = {
    "road": ((0.36, 0.36, 0.38), "asphalt"),
    "pavement": ((0.66, 0.65, 0.62), "large tiles"),
    "grass": ((0.36, 0.52, 0.24), "leaves"),
}


def street(number: int, rng: np.random.Generator, views: int) -> tuple[Builder, list[Camera]]:
    """A street along y of the number-th kind, and `views` cameras that look about along it."""
    kind = kinds()[number % len(kinds())]
    share = rng.beta(1.3, 1.3)
    road, walk, garden, length = (
        low + (high - low) * float(np.clip(share + rng.normal(0, 0.2), 0, 1))
        for low, high in (kind.road, kind.walk, kind.garden, kind.length)
    )
    b = Builder(rng, clearance=0.3)
    front = road / 2 + walk + garden
    end = min(length, 170.0)
    _ground(b, kind.ground, road, walk, front)
    cameras = [_camera(rng, road, kind.eye) for _ in range(views)]
    for camera in cameras:
        b.take(camera.position[0], camera.position[1] + 1.2, 2.2, 4.4)
    _fronts(b, kind, front, end)
    if length < 160:
        _closing(b, kind, front, length)
    for name, low, high in kind.on_road:
        for _ in range(rng.integers(low, high + 1)):
            _drive(b, name, road, end)
    for name, low, high in kind.beside:
        for _ in range(rng.integers(low, high + 1)):
            _beside(b, name, road, walk, front, end)
    return b, cameras


def _strip(b: Builder, name: str, x1: float, x2: float, top: float) -> None:
    colour, texture = _GROUND[name]
    centre, half = ((x1 + x2) / 2, 180.0, top - 0.1), (abs(x2 - x1) / 2, 220.0, 0.1)
    b.solids.append(Solid(BOX, centre, half, 0.0, colour, texture, b.segment(name)))


def _ground(b: Builder, name: str, road: float, walk: float, front: float) -> None:
    _strip(b, name, -road / 2, road / 2, 0.0)
    edge = road / 2 + walk
    for side in (-1, 1):
        if walk > 0.2:
            _strip(b, "pavement", side * road / 2, side * edge, 0.1)
        if walk > 0.2 or front - edge > 2:
            _strip(b, "grass", side * edge, side * 260.0, 0.04)
        else:
            _strip(b, "pavement", side * road / 2, side * 260.0, 0.02)
    # Marks belong to the road's segment: a broken line every 12 m between lanes of about 3.5 m.
    lanes = max(1, round(road / 3.5)) if road > 4.5 and name == "road" else 1
    for k in range(1, lanes):
        x = -road / 2 + k * road / lanes
        for y in np.arange(-6.0, 120.0, 12.0):
            mark = Solid(
                BOX, (x, float(y), 0.0), (0.07, 2.5, 0.012), 0.0, (0.92, 0.92, 0.88), "", 1
            )
            b.solids.append(mark._replace(segment=b.segment("road")))


def _camera(rng: np.random.Generator, road: float, eye: Range) -> Camera:
    """A camera on a car's roof or in a hand, somewhere on the right of the road."""
    x = float(rng.uniform(-0.1, 0.3) * road)
    position = (x, float(rng.uniform(-1.0, 1.0)), float(rng.uniform(*eye)))
    # The higher, the more it looks down.
    pitch = float(rng.uniform(-0.05, 0.04) - 0.02 * (position[2] - 1.4))
    yaw = float(rng.normal(0, 0.06))
    return Camera(position, yaw, pitch, 216.0, 288, 162)


def _fronts(b: Builder, kind: Kind, front: float, end: float) -> None:
    """Both sides of the street, from behind the camera to its end."""
    names, shares = zip(*kind.fronts, strict=True)
    for side in (-1, 1):
        y = -14.0
        while y < end:
            name = names[b.rng.choice(len(names), p=shares)]
            w, d, h = draw_size(name, b.rng)
            if name == "building":
                h = 3.0 * float(b.rng.integers(kind.storeys[0], kind.storeys[1] + 1)) + 0.5
            deep = w if name == "tree" else d
            x = side * (front + deep / 2 + b.rng.uniform(0, 0.4))
            # Fronts look to the street: the shapes' fronts look to -y.
            b.put(name, (w, d, h), x, y + w / 2, 0.0, -side * np.pi / 2)
            b.take(x, y + w / 2, deep, w)
            gap = {"house": (2.0, 7.0), "tree": (0.5, 9.0), "fence": (0.0, 0.5)}.get(name, (0, 0.3))
            y += w + b.rng.uniform(*gap)


def _closing(b: Builder, kind: Kind, front: float, length: float) -> None:
    """What stands across the end of the street."""
    name = "house" if kind.fronts[0][0] == "house" else "building"
    x = -front - 8.0
    while x < front + 8.0:
        w, d, h = draw_size(name, b.rng)
        if name == "building":
            h = 3.0 * float(b.rng.integers(kind.storeys[0], kind.storeys[1] + 1)) + 0.5
        b.put(name, (w, d, h), x + w / 2, length + d / 2, 0.0, 0.0)
        b.take(x + w / 2, length + d / 2, w, d)
        x += w + (b.rng.uniform(1.0, 4.0) if name == "house" else 0.2)


def _along(b: Builder, end: float) -> float:
    """m, a distance ahead: nearer places are likelier, as they show more."""
    start = min(3.5, 0.4 * end)
    return float(start + (min(end, 90.0) - start - 0.8) * b.rng.beta(1.0, 2.2))


def _drive(b: Builder, name: str, road: float, end: float) -> None:
    size = draw_size(name, b.rng)
    width = size[1] if name == "bicycle" else size[0]
    if width > road - 0.4:
        return
    for _ in range(10):
        if name in ("chair", "dining table"):
            x = float(b.rng.uniform(-1, 1) * (road - width) / 2)
        elif name in ("person", "bicycle") or road < 8 or b.rng.random() < 0.3:  # at the kerb
            x = float(b.rng.choice([-1, 1]) * (road - width - 0.2) / 2)
        else:
            lanes = max(2, round(road / 3.5))
            x = float(
                (b.rng.integers(lanes) + 0.5) / lanes * road - road / 2 + b.rng.normal(0, 0.15)
            )
        yaw = (np.pi if x < 0 else 0.0) + (np.pi / 2 if name == "bicycle" else 0.0)
        if b.stand(name, x, _along(b, end), yaw, size, name == "bicycle"):
            return


def _beside(b: Builder, name: str, road: float, walk: float, front: float, end: float) -> None:
    size = draw_size(name, b.rng)
    for _ in range(10):
        side = float(b.rng.choice([-1, 1]))
        across = name in ("fence", "bench", "bicycle")
        w = size[1] if across else size[0]
        low, high = road / 2 + w / 2 + 0.05, max(front - w / 2 - 0.05, road / 2 + w / 2 + 0.1)
        if name in ("traffic light", "stop sign"):
            high = low + 0.3
        if name == "fence":
            low = max(low, road / 2 + walk)
        x = side * float(b.rng.uniform(low, max(low, high)))
        yaw = -side * np.pi / 2 if across else 0.0
        if b.stand(name, x, _along(b, end), yaw, size, across):
            return

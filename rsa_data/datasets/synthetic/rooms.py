"""Rooms from a small bathroom to a sports hall: furniture along the walls and on the floor.

The kinds of room only say which objects are likely and how large such rooms tend to be; extents
vary continuously and overlap between kinds, and no kind's name is written anywhere.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

from .builder import Builder, read_kinds
from .parts import Colour
from .sizes import draw_size
from .solids import BOX, Camera, Solid

Range = tuple[float, float]
Place = tuple[float, float, float]


@dataclass(frozen=True)
class Kind:
    """One kind of room, a table `rooms.*` of kinds.toml."""

    width: Range
    depth: Range
    height: Range
    floor: list[tuple[str, str]]
    wall: list[str]
    along_walls: list[tuple[str, int, int]]
    inside: list[tuple[str, int, int]]
    hung: list[tuple[str, int, int, float]]


@cache
def kinds() -> list[Kind]:
    """The kinds of room, in the order of the file."""
    return [Kind(**table) for table in read_kinds()["rooms"].values()]


# What may stand on a table or counter.
_ON_TOP = ("laptop", "bottle", "cup", "book", "vase", "microwave", "keyboard")


def room(number: int, rng: np.random.Generator, views: int) -> tuple[Builder, list[Camera]]:
    """A furnished room of the number-th kind, round and round, and `views` cameras in it."""
    kind = kinds()[number % len(kinds())]
    # Width and depth of a room go together: one large, one small draw would be a corridor.
    share = rng.beta(1.3, 1.3)
    w, d, h = (
        low + (high - low) * float(np.clip(share + rng.normal(0, 0.15), 0, 1))
        for low, high in (kind.width, kind.depth, kind.height)
    )
    b = Builder(rng)
    _shell(b, kind, w, d, h)
    cameras = [_camera(rng, w, d, h) for _ in range(views)]
    for camera in cameras:
        b.take(*camera.position[:2], 0.5, 0.5)
    for name, low, high, z in kind.hung:
        for _ in range(rng.integers(low, high + 1)):
            _hang(b, name, w, d, h, z)
    for name, low, high in kind.along_walls:
        for _ in range(rng.integers(low, high + 1)):
            _along_wall(b, name, w, d)
    for name, low, high in kind.inside:
        for _ in range(rng.integers(low, high + 1)):
            _inside(b, name, w, d)
    for _ in range(max(1, round(w * d / 14))):
        size = draw_size("light", rng)
        x, y = rng.uniform(-w / 3, w / 3), rng.uniform(-d / 3, d / 3)
        b.put("light", size, x, y, h - size[2])
    return b, cameras


def _shell(b: Builder, kind: Kind, w: float, d: float, h: float) -> None:
    """Floor, ceiling and four walls, 0.2 m thick, around w by d by h, m."""
    floor, floor_texture = kind.floor[b.rng.integers(len(kind.floor))]
    wall_texture = kind.wall[b.rng.integers(len(kind.wall))]
    r, g, blue = (float(t) for t in 0.80 + 0.12 * b.rng.random(3))
    wood: dict[str, Colour] = {"planks": (0.66, 0.49, 0.33), "bricks": (0.62, 0.36, 0.28)}
    grey = float(0.55 + 0.25 * b.rng.random())
    shell: list[tuple[str, str, Colour, Place, Place]] = [
        (
            floor,
            floor_texture,
            wood.get(floor_texture, (grey, grey, grey)),
            (0, 0, -0.1),
            (w, d, 0.2),
        ),
        ("ceiling", "", (0.94, 0.94, 0.92), (0, 0, h + 0.1), (w, d, 0.2)),
    ]
    paint = wood.get(wall_texture, (r, g, blue))
    for side in (-1, 1):
        shell.append(("wall", wall_texture, paint, (side * (w / 2 + 0.1), 0, h / 2), (0.2, d, h)))
        shell.append(("wall", wall_texture, paint, (0, side * (d / 2 + 0.1), h / 2), (w, 0.2, h)))
    for name, texture, colour, centre, size in shell:
        half = (size[0] / 2, size[1] / 2, size[2] / 2)
        b.solids.append(Solid(BOX, centre, half, 0.0, colour, texture, b.segment(name)))


def _camera(rng: np.random.Generator, w: float, d: float, h: float) -> Camera:
    """A hand-held camera near one end of the room that looks about across it."""
    end = rng.choice([-1.0, 1.0])
    x = rng.uniform(-0.36, 0.36) * w
    y = end * (d / 2 - rng.uniform(0.25, 0.25 + 0.12 * d))
    aim_x, aim_y = rng.uniform(-0.3, 0.3) * w, -end * d * rng.uniform(0.0, 0.45)
    yaw = float(np.arctan2(-(aim_x - x), aim_y - y))
    position = (float(x), float(y), float(rng.uniform(1.25, min(1.75, h - 0.4))))
    return Camera(position, yaw, float(rng.uniform(-0.22, -0.02)), 208.0, 240, 180)


def _wall_place(
    rng: np.random.Generator, w: float, d: float, width: float, depth: float
) -> tuple[float, float, float, bool] | None:
    """A random place against a wall: x, y, yaw, lies across. None if the wall is too short."""
    side = int(rng.integers(4))
    across = side % 2 == 1
    length = d if across else w
    if width > length - 0.1:
        return None
    along = float(rng.uniform(-1, 1) * (length - width) / 2)
    gap = depth / 2 + 0.01
    x, y = [(along, d / 2 - gap), (w / 2 - gap, along), (along, gap - d / 2), (gap - w / 2, along)][
        side
    ]
    return x, y, [0.0, -np.pi / 2, np.pi, np.pi / 2][side], across


def _along_wall(b: Builder, name: str, w: float, d: float) -> None:
    size = draw_size(name, b.rng)
    # A bed's head, not its side, is against the wall; the shapes' backs look to +y.
    for _ in range(12):
        place = _wall_place(b.rng, w, d, size[0], size[1])
        if place and b.stand(name, place[0], place[1], place[2], size, place[3]):
            _on_top(b, name, size, place[0], place[1])
            return


def _inside(b: Builder, name: str, w: float, d: float) -> None:
    size = draw_size(name, b.rng)
    for _ in range(12):
        across = bool(b.rng.integers(2))
        yaw = float(b.rng.choice([-1, 1]) * np.pi / 2 if across else b.rng.choice([0, np.pi]))
        reach_x, reach_y = (size[1], size[0]) if across else size[:2]
        if reach_x > w - 0.3 or reach_y > d - 0.3:
            continue
        x = float(b.rng.uniform(-1, 1) * (w - reach_x - 0.2) / 2)
        y = float(b.rng.uniform(-1, 1) * (d - reach_y - 0.2) / 2)
        if name == "rug":
            return b.put(name, size, x, y, 0.0, yaw)
        if b.stand(name, x, y, yaw, size, across):
            return _on_top(b, name, size, x, y)


def _on_top(b: Builder, name: str, size: tuple[float, float, float], x: float, y: float) -> None:
    """Small things on a table or a counter, a pillow on a bed."""
    if name in ("dining table", "counter", "cabinet") and size[2] < 1.2:
        for _ in range(b.rng.integers(0, 3)):
            small = _ON_TOP[b.rng.integers(len(_ON_TOP))]
            dx, dy = b.rng.uniform(-0.25, 0.25, 2) * min(size[:2])
            b.put(small, draw_size(small, b.rng), x + dx, y + dy, size[2], b.rng.uniform(-3, 3))
    if name == "bed" and b.rng.random() < 0.8:
        b.put("pillow", draw_size("pillow", b.rng), x, y, 0.5, b.rng.uniform(-0.3, 0.3))


def _hang(b: Builder, name: str, w: float, d: float, h: float, z: float) -> None:
    size = draw_size(name, b.rng)
    place = _wall_place(b.rng, w, d, size[0], size[1])
    if place and z + size[2] < h - 0.05:
        x, y, yaw, across = place
        b.put(name, size, x, y, z, yaw)
        if name == "door":
            b.take(x, y, *((0.9, size[0]) if across else (size[0], 0.9)))

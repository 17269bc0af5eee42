"""Shapes of furniture and what lies on it."""

from .parts import DARK, LEAF, STEEL, WHITE, WOOD, Colour, Shape, block, legs, plain, tinted
from .sizes import Size
from .solids import ELLIPSOID, Solid


def _seat(size: Size, colour: Colour) -> list[Solid]:
    w, d, h = size
    seat = [
        block(0, 0, 0.42, w, d, 0.05, colour),
        block(0, d / 2 - 0.03, 0.5, w, 0.05, h - 0.5, colour),
    ]
    return seat + legs(w, d, 0.42, DARK, 0.04)


def _table(size: Size, colour: Colour) -> list[Solid]:
    w, d, h = size
    return [
        block(0, 0, h - 0.05, w, d, 0.05, WOOD, "planks"),
        *legs(w - 0.1, d - 0.1, h - 0.05, WOOD),
    ]


def _bench(size: Size, colour: Colour) -> list[Solid]:
    w, d, h = size
    return [
        block(0, 0, h - 0.06, w, d, 0.06, WOOD, "planks"),
        *(block(x, 0, 0, 0.08, d, h - 0.06, DARK) for x in (-w * 0.4, w * 0.4)),
    ]


def _bed(size: Size, colour: Colour) -> list[Solid]:
    w, d, h = size
    return [
        block(0, 0, 0, w, d, 0.28, WOOD),
        block(0, 0, 0.28, w - 0.04, d - 0.06, 0.2, WHITE),
        block(0, -d * 0.12, 0.30, w + 0.02, d * 0.72, 0.2, colour, "stripes"),
        block(0, d / 2, 0, w + 0.06, 0.06, h, WOOD),
    ]


def _couch(size: Size, colour: Colour) -> list[Solid]:
    w, d, h = size
    return [
        block(0, 0, 0.06, w, d, 0.36, colour),
        block(0, d / 2 - 0.12, 0.42, w, 0.24, h - 0.42, colour),
        *(block(x, 0, 0.06, 0.2, d, 0.56, colour) for x in (0.1 - w / 2, w / 2 - 0.1)),
    ]


def _toilet(size: Size, colour: Colour) -> list[Solid]:
    w, d, h = size
    return [
        block(0, -0.08, 0, w * 0.6, d * 0.6, 0.36, WHITE),
        block(0, -0.1, 0.34, w, d * 0.72, 0.08, WHITE, "", ELLIPSOID),
        block(0, d / 2 - 0.1, 0.3, w, 0.2, h - 0.3, WHITE),
    ]


def _sink(size: Size, colour: Colour) -> list[Solid]:
    w, d, h = size
    return [
        block(0, 0, h - 0.14, w, d, 0.14, WHITE),
        block(0, -0.02, h - 0.005, w * 0.75, d * 0.6, 0.01, STEEL),
        block(0, d * 0.38, h, 0.04, 0.04, 0.2, STEEL),
        block(0, d / 4, 0, 0.16, 0.16, h - 0.14, WHITE),
    ]


def _refrigerator(size: Size, colour: Colour) -> list[Solid]:
    w, d, h = size
    return [
        block(0, 0, 0, w, d, h, STEEL),
        block(0, -d / 2, h * 0.66, w, 0.02, 0.015, DARK),
        *(block(w * 0.38, -d / 2 - 0.02, z * h, 0.03, 0.04, 0.2 * h, DARK) for z in (0.4, 0.7)),
    ]


def _oven(size: Size, colour: Colour) -> list[Solid]:
    w, d, h = size
    return [
        block(0, 0, 0, w, d, h, WHITE),
        block(0, -d / 2, 0.16, w * 0.8, 0.02, h * 0.5, DARK),
        block(0, 0, h, w * 0.94, d * 0.9, 0.01, DARK),
    ]


def _microwave(size: Size, colour: Colour) -> list[Solid]:
    w, d, h = size
    return [
        block(0, 0, 0, w, d, h, STEEL),
        block(-w * 0.1, -d / 2, h * 0.12, w * 0.66, 0.02, h * 0.76, DARK),
    ]


def _cabinet(size: Size, colour: Colour) -> list[Solid]:
    w, d, h = size
    lines = [block(0, -d / 2, 0.03, 0.012, 0.012, h - 0.06, DARK)]
    return [
        block(0, 0, 0, w, d, h, colour),
        *lines,
        *(block(x, -d / 2 - 0.01, h * 0.45, 0.025, 0.03, 0.14, STEEL) for x in (-0.06, 0.06)),
    ]


def _counter(size: Size, colour: Colour) -> list[Solid]:
    w, d, h = size
    return [
        block(0, 0, 0, w, d - 0.04, h - 0.04, colour),
        block(0, -0.01, h - 0.04, w, d + 0.02, 0.04, DARK),
    ]


def _shelf(size: Size, colour: Colour) -> list[Solid]:
    w, d, h = size
    return [
        block(0, 0.02, 0, w, d - 0.04, h, WOOD),
        block(0, -0.01, 0.04, w - 0.08, d - 0.02, h - 0.1, (0.75, 0.6, 0.5), "books"),
    ]


def _rack(size: Size, colour: Colour) -> list[Solid]:
    w, d, h = size
    steel, crate = (0.20, 0.34, 0.56), (0.72, 0.56, 0.36)
    levels = int(h // 1.5)
    return [
        *legs(w, d, h, steel, 0.12),
        *(block(0, 0, 1.5 * k + 0.12, w, d, 0.1, (0.85, 0.45, 0.15)) for k in range(levels)),
        *(
            block(x, 0, 1.5 * k + 0.22, w * 0.38, d * 0.8, 0.9, crate)
            for k in range(levels)
            for x in (-w / 4, w / 4)
        ),
    ]


def _plant(size: Size, colour: Colour) -> list[Solid]:
    w, d, h = size
    return [
        block(0, 0, 0, w * 0.5, d * 0.5, h * 0.3, (0.62, 0.36, 0.24)),
        block(0, 0, h * 0.26, w, d, h * 0.74, LEAF, "leaves", ELLIPSOID),
    ]


def _window(size: Size, colour: Colour) -> list[Solid]:
    w, d, h = size
    return [
        block(0, 0, 0, w, d, h, WHITE),
        block(0, -0.01, 0.05, w - 0.1, d, h - 0.1, (0.66, 0.82, 0.95), "panes"),
    ]


def _door(size: Size, colour: Colour) -> list[Solid]:
    w, d, h = size
    return [
        block(0, 0, 0, w, d, h, (0.66, 0.50, 0.36)),
        block(w * 0.36, -0.05, 1.0, 0.1, 0.05, 0.04, STEEL),
    ]


def _screen(size: Size, colour: Colour) -> list[Solid]:
    w, d, h = size
    return [
        block(0, 0, 0, w, d, h, DARK),
        block(0, -0.01, 0.04, w - 0.08, d, h - 0.08, (0.10, 0.13, 0.22)),
    ]


def _laptop(size: Size, colour: Colour) -> list[Solid]:
    w, d, h = size
    return [
        block(0, 0, 0, w, d, 0.02, STEEL),
        block(0, d / 2, 0, w, 0.02, h, DARK),
    ]


SHAPES: dict[str, Shape] = {
    "banner": tinted(),
    "bed": _bed,
    "bench": _bench,
    "book": tinted(),
    "bottle": plain((0.20, 0.42, 0.30)),
    "cabinet": _cabinet,
    "cardboard": plain((0.72, 0.56, 0.38)),
    "chair": _seat,
    "clock": plain(WHITE),
    "couch": _couch,
    "counter": _counter,
    "cup": tinted(),
    "curtain": tinted("stripes"),
    "dining table": _table,
    "door": _door,
    "keyboard": plain(DARK),
    "laptop": _laptop,
    "light": plain((1.25, 1.22, 1.1)),
    "microwave": _microwave,
    "mirror": plain((0.78, 0.86, 0.90)),
    "net": plain((0.86, 0.86, 0.84), "tiles"),
    "oven": _oven,
    "pillow": plain(WHITE),
    "potted plant": _plant,
    "refrigerator": _refrigerator,
    "rug": tinted("stripes"),
    "shelf": _shelf,
    "sink": _sink,
    "sports ball": plain((0.90, 0.45, 0.15), "", ELLIPSOID),
    "storage rack": _rack,
    "suitcase": tinted(),
    "toilet": _toilet,
    "towel": tinted(),
    "tv": _screen,
    "vase": tinted("", ELLIPSOID),
    "window": _window,
}

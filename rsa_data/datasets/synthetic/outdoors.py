"""Shapes of vehicles, which drive to +y, buildings, plants and people."""

from .parts import DARK, SKIN, STEEL, WHITE, Colour, Shape, block, paler, plain
from .sizes import Size
from .solids import ELLIPSOID, GABLE, Solid


def _tree(size: Size, colour: Colour) -> list[Solid]:
    w, d, h = size
    green = (0.20 + 0.18 * colour[0], 0.40 + 0.12 * colour[1], 0.18)
    return [
        block(0, 0, 0, 0.09 * w, 0.09 * w, 0.5 * h, (0.36, 0.27, 0.19)),
        block(0, 0, 0.27 * h, w, d, 0.6 * h, green, "leaves", ELLIPSOID),
        block(0.12 * w, 0, 0.5 * h, w * 0.7, d * 0.7, 0.5 * h, green, "leaves", ELLIPSOID),
    ]


def _wheels(w: float, d: float, size: float) -> list[Solid]:
    return [
        block(x, y, 0, 0.2, size, size, DARK, "", ELLIPSOID)
        for x in (-w / 2, w / 2)
        for y in (-d * 0.32, d * 0.32)
    ]


def _car(size: Size, colour: Colour) -> list[Solid]:
    w, d, h = size
    lamps = [
        block(x, y, 0.62, 0.3, 0.03, 0.13, lamp)
        for x in (-w * 0.34, w * 0.34)
        for y, lamp in ((-d / 2, (0.75, 0.1, 0.1)), (d / 2, (1.0, 0.98, 0.85)))
    ]
    return [
        block(0, 0, 0.24, w, d, 0.58, colour),
        block(0, -d * 0.06, 0.82, w * 0.86, d * 0.52, h - 0.9, DARK),
        block(0, -d * 0.06, h - 0.1, w * 0.82, d * 0.44, 0.1, colour),
        *lamps,
        *_wheels(w, d, 0.64),
    ]


def _bus(size: Size, colour: Colour) -> list[Solid]:
    w, d, h = size
    return [
        block(0, 0, 0.35, w, d, h - 0.35, colour),
        block(0, 0, h * 0.46, w + 0.02, d * 0.94, h * 0.3, DARK),
        *(block(0, y, h * 0.4, w * 0.88, 0.03, h * 0.42, DARK) for y in (-d / 2, d / 2)),
        *_wheels(w, d, 0.95),
    ]


def _truck(size: Size, colour: Colour) -> list[Solid]:
    w, d, h = size
    return [
        block(0, -1.1, 0.9, w, d - 2.4, h - 0.9, WHITE, "siding"),
        block(0, d / 2 - 1.1, 0.5, w, 2.0, h * 0.72, colour),
        block(0, d / 2 - 0.1, 1.7, w * 0.9, 0.05, 0.8, DARK),
        block(0, -0.6, 0.5, 1.0, d - 1.2, 0.4, DARK),
        block(0, -d / 2 + 0.1, 0.9, w * 0.03, 0.04, h - 0.95, DARK),
        *_wheels(w, d, 1.0),
    ]


def _bicycle(size: Size, colour: Colour) -> list[Solid]:
    w, d, h = size
    return [
        *(block(x, 0, 0, 0.62, 0.06, 0.62, DARK, "", ELLIPSOID) for x in (-w * 0.32, w * 0.32)),
        block(0, 0, 0.55, w * 0.5, 0.06, 0.07, colour),
        block(-0.2, 0, 0.5, 0.05, 0.05, 0.42, colour),
        block(w * 0.22, 0, 0.5, 0.05, 0.05, h - 0.5, colour),
        block(w * 0.22, 0, h - 0.05, 0.05, d, 0.05, DARK),
    ]


def _motorcycle(size: Size, colour: Colour) -> list[Solid]:
    w, d, h = size
    return [
        *(block(0, y, 0, 0.16, 0.64, 0.64, DARK, "", ELLIPSOID) for y in (-d * 0.33, d * 0.33)),
        block(0, 0, 0.3, 0.35, d * 0.5, 0.5, colour),
        block(0, -0.2, 0.75, 0.3, 0.7, 0.12, DARK),
        block(0, d * 0.25, h - 0.2, w, 0.08, 0.08, STEEL),
    ]


def _traffic_light(size: Size, colour: Colour) -> list[Solid]:
    w, d, h = size
    lamps = ((0.85, 0.15, 0.1), (0.9, 0.65, 0.1), (0.15, 0.75, 0.3))
    return [
        block(0, 0, 0, 0.14, 0.14, h - 0.9, DARK),
        block(0, 0, h - 0.95, w, d, 0.95, (0.12, 0.13, 0.12)),
        *(
            block(0, -d / 2, h - 0.32 - 0.3 * k, 0.2, 0.08, 0.2, lamp, "", ELLIPSOID)
            for k, lamp in enumerate(lamps)
        ),
    ]


def _stop_sign(size: Size, colour: Colour) -> list[Solid]:
    w, d, h = size
    return [
        block(0, 0, 0, 0.08, 0.08, h - w, STEEL),
        block(0, 0, h - w, w, d, w, (0.80, 0.12, 0.12), "", ELLIPSOID),
    ]


def _house(size: Size, colour: Colour) -> list[Solid]:
    w, d, h = size
    wall = paler(colour, 0.62, 0.32)
    return [
        block(0, 0, 0, w, d, h * 0.68, wall, "house front"),
        block(0, 0, h * 0.68, w + 0.6, d + 0.7, h * 0.5, (0.50, 0.29, 0.23), "siding", GABLE),
        block(0.4, -d / 2, 0, 1.0, 0.08, 2.1, (0.34, 0.24, 0.2)),
    ]


def _building(size: Size, colour: Colour) -> list[Solid]:
    w, d, h = size
    wall = paler(colour, 0.45, 0.4)
    return [
        block(0, 0, 0, w, d, h, wall, "facade"),
        block(0, 0, h, w + 0.3, d + 0.3, 0.4, (0.5, 0.5, 0.52)),
    ]


def _umbrella(size: Size, colour: Colour) -> list[Solid]:
    w, d, h = size
    return [
        block(0, 0, 0, 0.06, 0.06, h, STEEL),
        block(0, 0, h - 0.5, w, d, 0.5, colour, "", GABLE),
    ]


def _person(size: Size, colour: Colour) -> list[Solid]:
    w, d, h = size
    leg, head = 0.47 * h, 0.13 * h
    return [
        *(block(x, 0, 0, w * 0.36, d * 0.7, leg, (0.22, 0.25, 0.36)) for x in (-w / 4, w / 4)),
        block(0, 0, leg, w * 0.82, d, h - leg - head - 0.04, colour),
        *(
            block(x, 0, leg, w * 0.15, d * 0.6, h - leg - head - 0.08, colour)
            for x in (-w / 2, w / 2)
        ),
        block(0, 0, h - head, 0.11 * h, 0.12 * h, head, SKIN, "", ELLIPSOID),
    ]


SHAPES: dict[str, Shape] = {
    "bicycle": _bicycle,
    "building": _building,
    "bus": _bus,
    "car": _car,
    "fence": plain((0.80, 0.78, 0.72), "stripes"),
    "house": _house,
    "motorcycle": _motorcycle,
    "person": _person,
    "stop sign": _stop_sign,
    "traffic light": _traffic_light,
    "tree": _tree,
    "truck": _truck,
    "umbrella": _umbrella,
}

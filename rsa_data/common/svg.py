"""What plots are drawn with: scales, ticks, labels, marks, the frame of an SVG.

Colours come from plot.css, by class, so that a plot suits light and dark pages alike.
"""

from collections.abc import Callable, Sequence
from importlib.resources import files
from itertools import count
from typing import Any

import numpy as np

from .html import Html, tag, text

WIDTH, HEIGHT = 640, 300
LEFT, RIGHT, TOP, BOTTOM = 62, 16, 14, 46
SERIES = 7
_numbers = count()
Scale = Callable[[float], float]


def svg(title: str, height: float, parts: Sequence[str]) -> Html:
    """The drawing in its frame, named for those who cannot see it."""
    name = f"plot-{next(_numbers)}"
    return Html(
        f'<svg viewBox="0 0 {WIDTH} {height:.0f}" role="img" aria-labelledby="{name}">'
        f'<title id="{name}">{text(title)}. The numbers stand below the plot.</title>'
        + "".join(parts)
        + "</svg>"
    )


def document(title: str, size: tuple[float, float], parts: Sequence[str]) -> str:
    """The drawing as a file of its own, with its title on top. size : width and height in px."""
    width, height = size
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" '
        f'viewBox="0 0 {width:.0f} {height:.0f}" role="img" font-family="sans-serif">\n'
        f"<style>{style()}</style>\n"
        '<rect width="100%" height="100%" style="fill: var(--paper)"/>\n'
        + "\n".join([label(10, 20, title, "start", strong=True), *parts])
        + "\n</svg>\n"
    )


def style() -> str:
    """The style sheet of plots: colours of series, axes and rules, for light and dark."""
    return files("rsa_data.common").joinpath("plot.css").read_text("utf-8")


def axes(
    xs: Sequence[float], ys: Sequence[float], x: Scale, y: Scale, x_label: str, y_label: str
) -> list[str]:
    """Grid, ticks and names of both axes. xs, ys : the ticks; x, y : from values to px."""
    parts = [rule(LEFT, y(t), WIDTH - RIGHT, y(t)) for t in ys]
    parts += [label(LEFT - 7, y(t) + 4, short(t), "end") for t in ys]
    parts += [rule(x(t), HEIGHT - BOTTOM, x(t), HEIGHT - BOTTOM + 4) for t in xs]
    parts += [label(x(t), HEIGHT - BOTTOM + 17, short(t)) for t in xs]
    parts.append(label((LEFT + WIDTH - RIGHT) / 2, HEIGHT - 8, x_label))
    middle = (TOP + HEIGHT - BOTTOM) / 2
    parts.append(
        f'<text class="axis" x="14" y="{middle}" text-anchor="middle" '
        f'transform="rotate(-90 14 {middle})">{text(y_label)}</text>'
    )
    return parts


def mark(x: float, y: float, series: int, inner: str = "") -> str:
    """A point of a series, in the series' colour and shape."""
    kind, shape = f'class="dot s{series % SERIES}"', series % 4
    if shape == 0:
        return f'<circle {kind} cx="{x:.1f}" cy="{y:.1f}" r="3.5">{inner}</circle>'
    if shape == 1:
        return f'<rect {kind} x="{x - 3:.1f}" y="{y - 3:.1f}" width="6" height="6">{inner}</rect>'
    if shape == 2:
        points = f"{x:.1f},{y - 4:.1f} {x + 4:.1f},{y + 3:.1f} {x - 4:.1f},{y + 3:.1f}"
    else:
        points = (
            f"{x:.1f},{y - 4.5:.1f} {x + 4.5:.1f},{y:.1f} {x:.1f},{y + 4.5:.1f} "
            f"{x - 4.5:.1f},{y:.1f}"
        )
    return f'<polygon {kind} points="{points}">{inner}</polygon>'


def path(points: Sequence[tuple[float, float]], series: int) -> str:
    """A line through points, in the colour of a series."""
    places = " ".join(f"{a:.1f},{b:.1f}" for a, b in points)
    return f'<polyline class="line s{series % SERIES}" points="{places}"/>'


def legend(names: Sequence[str]) -> Html:
    """Which mark belongs to which series."""
    items = [
        tag(
            "span",
            Html(
                f'<svg viewBox="0 0 14 14" width="14" height="14" aria-hidden="true">'
                f"{mark(7, 7, k)}</svg>"
            ),
            " ",
            name,
        )
        for k, name in enumerate(names)
    ]
    return tag("p", items, class_="legend")


def rule(x1: float, y1: float, x2: float, y2: float) -> str:
    """A thin line."""
    return f'<line class="rule" x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"/>'


def label(x: float, y: float, words: str, anchor: str = "middle", strong: bool = False) -> str:
    """Words at a place."""
    kind = "axis strong" if strong else "axis"
    where = f'x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"'
    return f'<text class="{kind}" {where}>{text(words)}</text>'


def ticks(low: float, high: float, whole: bool = False) -> list[float]:
    """About five round numbers from low to high; the outer ones may lie beyond them.

    whole : only whole numbers.
    """
    span = max(float(high) - float(low), 1e-9)
    power = 10.0 ** np.floor(np.log10(span / 4))
    steps: tuple[float, ...] = (1, 2, 5, 10) if whole else (1, 2, 2.5, 5, 10)
    step = next(float(power * m) for m in steps if power * m >= span / 5.01)
    step = max(float(step), 1.0) if whole else float(step)
    first, last = np.floor(low / step + 1e-9), np.ceil(high / step - 1e-9)
    return [float(step * k) for k in range(int(first), int(last) + 1)]


def span(ticks: Sequence[float], values: np.ndarray) -> tuple[float, float]:
    """The range that an axis covers."""
    return min(ticks[0], float(values.min())), max(ticks[-1], float(values.max()))


def scales(across: tuple[float, float], up: tuple[float, float]) -> tuple[Scale, Scale]:
    """Functions from values to px, across and up."""
    wide, high = max(across[1] - across[0], 1e-9), max(up[1] - up[0], 1e-9)
    return (
        lambda v: LEFT + (WIDTH - LEFT - RIGHT) * (float(v) - across[0]) / wide,
        lambda v: HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * (float(v) - up[0]) / high,
    )


def short(number: Any) -> str:
    """A number with the digits that a reader needs; other values as they are."""
    if isinstance(number, (int, np.integer)):
        return f"{number:,}"
    if not isinstance(number, (float, np.floating)):
        return str(number)
    number = float(number)
    if number == round(number) and abs(number) < 1e7:
        return f"{int(number):,}"
    return f"{number:.3g}"


def cut(words: str, letters: int) -> str:
    """Words, shortened where they are too long."""
    return words if len(words) <= letters else words[: letters - 1] + "…"

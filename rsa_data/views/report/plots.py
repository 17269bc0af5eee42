"""Plots as SVG inside the page: colours from its style sheet, so that they suit light and dark.

Each plot names both axes with their units and comes with its numbers as a table, which is its text
alternative. Series differ in colour (Okabe and Ito's) and in the shape of their marks.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...common.html import Html, table, tag, text
from ...common.svg import (
    BOTTOM,
    HEIGHT,
    TOP,
    WIDTH,
    axes,
    cut,
    label,
    legend,
    mark,
    path,
    rule,
    scales,
    short,
    span,
    svg,
    ticks,
)
from ..pictures.colours import depth_colours

_SHOWN = 60


def figure(title: str, drawing: Html, header: Sequence[str], rows: Sequence[Sequence[Any]]) -> Html:
    """A plot with its caption, and its numbers to unfold."""
    shown = [[short(c) for c in row] for row in rows[:_SHOWN]]
    if len(rows) > _SHOWN:
        shown.append([f"and {len(rows) - _SHOWN} more", *[""] * (len(header) - 1)])
    numbers = tag("details", tag("summary", "The numbers"), table(header, shown, title))
    return tag("figure", tag("figcaption", title), drawing, numbers, class_="plot")


def bars(title: str, names: Sequence[str], values: Sequence[float], unit: str) -> Html:
    """Horizontal bars, the first on top."""
    line, left = 22, 170
    height = line * len(names) + TOP + BOTTOM
    xs = ticks(0, max([*values, 1e-9]), whole=True)
    top = xs[-1]

    def x(value: float) -> float:
        return left + (WIDTH - left - 60) * value / top

    low = height - BOTTOM
    parts = [rule(x(t), TOP, x(t), low) + label(x(t), low + 16, short(t)) for t in xs]
    for k, (name, value) in enumerate(zip(names, values, strict=True)):
        y = TOP + line * k
        parts.append(label(left - 8, y + 15, cut(name, 24), "end"))
        parts.append(
            f'<rect class="bar" x="{left}" y="{y + 3}" width="{max(x(value) - left, 1):.1f}" '
            f'height="{line - 6}"/>'
        )
        parts.append(label(x(value) + 5, y + 15, short(value), "start"))
    parts.append(label((left + WIDTH - 60) / 2, height - 8, unit))
    return figure(
        title, svg(title, height, parts), ["", unit], list(zip(names, values, strict=True))
    )


def histogram(
    title: str,
    values: np.ndarray,
    x_label: str,
    y_label: str,
    limit: tuple[float, str] | None = None,
) -> Html:
    """How often each whole number occurs, grouped evenly where there are many.

    values : whole numbers, 0 and up. limit : a place on the x axis and what it is.
    """
    top = int(max(values.max(initial=0), limit[0] if limit else 0))
    step = max(1, -(-(top + 1) // 50))
    counts = np.bincount(values.astype(np.int64) // step, minlength=top // step + 1)
    xs = ticks(0, top + 1, whole=True)
    xs = [t for t in xs if t <= top + step]
    ys = ticks(0, float(counts.max(initial=1)), whole=True)
    x, y = scales((0, (top // step + 1) * step), (0, ys[-1]))
    parts = axes(xs, ys, x, y, x_label, y_label)
    for k, number in enumerate(counts):
        wide = max(x((k + 1) * step) - x(k * step) - 1, 0.6)
        parts.append(
            f'<rect class="bar" x="{x(k * step):.1f}" y="{y(number):.1f}" width="{wide:.1f}" '
            f'height="{HEIGHT - BOTTOM - y(number):.1f}"/>'
        )
    if limit:
        at = x(limit[0])
        parts.append(
            f'<line class="mark" x1="{at:.1f}" y1="{TOP}" x2="{at:.1f}" y2="{HEIGHT - BOTTOM}"/>'
        )
        parts.append(label(at - 6, TOP + 12, limit[1], "end"))
    edges = [
        f"{k * step}" if step == 1 else f"{k * step} to {(k + 1) * step - 1}"
        for k in range(len(counts))
    ]
    rows = [(e, int(c)) for e, c in zip(edges, counts, strict=True) if c]
    return figure(title, svg(title, HEIGHT, parts), [x_label, y_label], rows)


def lines(
    title: str,
    series: Mapping[str, Sequence[tuple[float, float]]],
    x_label: str,
    y_label: str,
) -> Html:
    """A line a series, with marks of its own shape and a legend."""
    points = np.array([p for line in series.values() for p in line], float)
    low, high = float(points[:, 1].min()), float(points[:, 1].max())
    xs, ys = ticks(points[:, 0].min(), points[:, 0].max()), ticks(low, high)
    x, y = scales(span(xs, points[:, 0]), span(ys, points[:, 1]))
    parts = axes(xs, ys, x, y, x_label, y_label)
    for k, line in enumerate(series.values()):
        parts.append(path([(x(a), y(b)) for a, b in line], k))
        every = max(1, len(line) // 25)
        parts += [mark(x(a), y(b), k) for a, b in line[::every]]
    rows = [(name, short(a), short(b)) for name, line in series.items() for a, b in line]
    drawing = tag("div", svg(title, HEIGHT, parts), legend(list(series)))
    return figure(title, drawing, ["", x_label, y_label], rows)


def scatter(
    title: str,
    points: np.ndarray,
    x_label: str,
    y_label: str,
    hints: Sequence[str],
    group: Sequence[str] | None = None,
    colour: tuple[np.ndarray, str] | None = None,
) -> Html:
    """Points (n, 2); by `group` in colours and shapes of their own, or by a number's logarithm.

    hints : what a point shows when pointed at. colour : positive numbers (n,), their name.
    """
    xs, ys = (ticks(float(v.min()), float(v.max())) for v in points.T)
    x, y = scales(span(xs, points[:, 0]), span(ys, points[:, 1]))
    parts = axes(xs, ys, x, y, x_label, y_label)
    names = list(dict.fromkeys(group or []))
    ramp = np.zeros(len(points))
    if colour is not None:
        logs = np.log(colour[0])
        low, high = np.quantile(logs, [0.02, 0.98])
        ramp = np.clip((logs - low) / max(high - low, 1e-9), 0, 1)
    for k, (a, b) in enumerate(points):
        hint = f"<title>{text(cut(hints[k], 140))}</title>"
        if group is not None:
            parts.append(mark(x(a), y(b), names.index(group[k]), hint))
        else:
            parts.append(
                f'<circle cx="{x(a):.1f}" cy="{y(b):.1f}" r="3.5" '
                f'fill="{viridis(ramp[k])}">{hint}</circle>'
            )
    if group is not None:
        rows = [(n, sum(g == n for g in group)) for n in names]
        return figure(
            title, tag("div", svg(title, HEIGHT, parts), legend(names)), ["", "points"], rows
        )
    assert colour is not None
    ends = [short(float(np.exp(v))) for v in (low, high)]
    bar = tag(
        "p", ends[0] + " ", tag("span", class_="ramp"), f" {ends[1]}  {colour[1]}", class_="legend"
    )
    spread = np.quantile(colour[0], [0.1, 0.5, 0.9])
    rows = [("10% below", spread[0]), ("median", spread[1]), ("10% above", spread[2])]
    return figure(title, tag("div", svg(title, HEIGHT, parts), bar), ["", colour[1]], rows)


def ranges(
    title: str, names: Sequence[str], spans: Sequence[tuple[float, float, float]], unit: str
) -> Html:
    """For each name the middle of its values and where most of them lie, on a log axis."""
    line, left = 22, 200
    height = line * len(names) + TOP + BOTTOM
    low = np.log10(max(min(s[0] for s in spans), 1e-6))
    high = np.log10(max(s[2] for s in spans))
    wide = max((0.45 - (high - low)) / 2, 0.05)
    low, high = low - wide, high + wide

    def x(value: float) -> float:
        place = (np.log10(max(value, 1e-6)) - low) / (high - low)
        return left + (WIDTH - left - 24) * float(place)

    bottom = height - BOTTOM
    places = [m * 10.0**e for e in range(-6, 6) for m in (1, 2, 3, 5)]
    shown = [m for m in places if low <= np.log10(m) <= high] or [10**low, 10**high]
    every = -(-len(shown) // 9)
    parts = [
        rule(x(t), TOP, x(t), bottom) + label(x(t), bottom + 16, short(t)) for t in shown[::every]
    ]
    for k, (name, (a, m, b)) in enumerate(zip(names, spans, strict=True)):
        y = TOP + line * k + 11
        parts.append(label(left - 8, y + 4, cut(name, 28), "end"))
        parts.append(f'<line class="line s0" x1="{x(a):.1f}" y1="{y}" x2="{x(b):.1f}" y2="{y}"/>')
        parts.append(mark(x(m), y, 0))
    parts.append(label((left + WIDTH) / 2, height - 8, unit))
    rows = [(n, *s) for n, s in zip(names, spans, strict=True)]
    header = ["", "10% are below", "median", "10% are above"]
    return figure(title, svg(title, height, parts), header, rows)


def viridis(share: float) -> str:
    """A colour for a share from 0 to 1."""
    r, g, b = depth_colours(np.array([[max(share, 1e-6)]]), 1.0)[0, 0]
    return f"#{r:02x}{g:02x}{b:02x}"

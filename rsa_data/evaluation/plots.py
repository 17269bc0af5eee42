"""Two plots as SVG, without a plotting library: intervals by method, and calibration."""

from collections.abc import Mapping, Sequence
from html import escape

from .summary import Row

_FONT = 'font-family="sans-serif" font-size="12"'
_COLOURS = ("#2b6cb0", "#c05621", "#2f855a", "#6b46c1", "#b83280", "#744210")


def intervals(rows: Sequence[Row], metric: str, title: str) -> str:
    """A dot for each method's mean and a line for its interval, a panel for each dataset."""
    names = list(dict.fromkeys(row.dataset for row in rows))
    rows = [row for row in rows if metric in row.mean]
    most = max([row.high.get(metric, row.mean[metric]) for row in rows], default=1.0) * 1.05
    left, wide, line = 260, 420, 18
    parts, y = [], 40
    for name in names:
        parts.append(_text(10, y, name, weight="bold"))
        y += line
        for row in (r for r in rows if r.dataset == name):
            x = left + wide * row.mean[metric] / most
            parts.append(_text(left - 8, y + 4, row.method, anchor="end"))
            if row.low:
                a, b = (left + wide * side[metric] / most for side in (row.low, row.high))
                parts.append(f'<line x1="{a:.1f}" y1="{y}" x2="{b:.1f}" y2="{y}" stroke="#888"/>')
            parts.append(f'<circle cx="{x:.1f}" cy="{y}" r="4" fill="{_COLOURS[0]}"/>')
            parts.append(_text(left + wide + 10, y + 4, f"{row.mean[metric]:.3f}"))
            y += line
        y += line // 2
    axis = f'<line x1="{left}" y1="{y}" x2="{left + wide}" y2="{y}" stroke="#333"/>'
    ticks = [
        _text(left + wide * t / 5, y + 16, f"{most * t / 5:.2f}", anchor="middle") for t in range(6)
    ]
    return _svg(left + wide + 70, y + 30, title, [*parts, axis, *ticks])


def calibration(groups: Mapping[str, Sequence[Mapping[str, float]]], title: str) -> str:
    """Root mean square error against error bar, a line for each dataset, and where both agree."""
    points = [p for line in groups.values() for p in line]
    most = max([max(p["bar"], p["error"]) for p in points], default=1.0) * 1.1 or 1.0
    left, top, size = 70, 40, 320

    def place(p: Mapping[str, float]) -> tuple[float, float]:
        return left + size * p["bar"] / most, top + size * (1 - p["error"] / most)

    parts = [
        f'<rect x="{left}" y="{top}" width="{size}" height="{size}" fill="none" stroke="#333"/>',
        f'<line x1="{left}" y1="{top + size}" x2="{left + size}" y2="{top}" stroke="#bbb" '
        'stroke-dasharray="4"/>',
        _text(left + size / 2, top + size + 34, "spread over captions (log depth)", "middle"),
        _text(left, top - 8, "error of log depth, root mean square"),
    ]
    for t in range(6):
        value = f"{most * t / 5:.2f}"
        parts.append(_text(left + size * t / 5, top + size + 16, value, "middle"))
        parts.append(_text(left - 6, top + size * (1 - t / 5) + 4, value, "end"))
    for number, (name, line) in enumerate(groups.items()):
        colour = _COLOURS[number % len(_COLOURS)]
        spots = [place(p) for p in line]
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in spots)
        parts.append(f'<polyline points="{path}" fill="none" stroke="{colour}"/>')
        parts += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="{colour}"/>' for x, y in spots]
        parts.append(_text(left + size + 16, top + 16 + 18 * number, name, colour=colour))
    return _svg(left + size + 220, top + size + 50, title, parts)


def _text(
    x: float,
    y: float,
    text: str,
    anchor: str = "start",
    weight: str = "normal",
    colour: str = "#222",
) -> str:
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" font-weight="{weight}" '
        f'fill="{colour}" {_FONT}>{escape(text)}</text>'
    )


def _svg(width: float, height: float, title: str, parts: Sequence[str]) -> str:
    size = f'width="{width:.0f}" height="{height:.0f}" viewBox="0 0 {width:.0f} {height:.0f}"'
    body = "\n".join([_text(10, 20, title, weight="bold"), *parts])
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" {size}>\n'
        f'<rect width="100%" height="100%" fill="white"/>\n{body}\n</svg>\n'
    )

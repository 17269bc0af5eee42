"""The plots of a comparison, as SVG files: intervals by method, and calibration."""

from collections.abc import Mapping, Sequence

from ..common import svg
from .summary import Row


def intervals(rows: Sequence[Row], metric: str, title: str) -> str:
    """A dot for each method's mean and a line for its interval, a panel for each dataset."""
    names = {row.dataset: row.shown for row in rows}
    rows = [row for row in rows if metric in row.mean]
    most = max([row.high.get(metric, row.mean[metric]) for row in rows], default=1.0) * 1.05
    left, wide, line = 260, 420, 18
    parts, y = [], 40

    def x(value: float) -> float:
        return left + wide * value / most

    for name, shown in names.items():
        parts.append(svg.label(10, y, shown, "start", strong=True))
        y += line
        for row in (r for r in rows if r.dataset == name):
            parts.append(svg.label(left - 8, y + 4, row.method, "end"))
            if row.low:
                a, b = x(row.low[metric]), x(row.high[metric])
                parts.append(svg.path([(a, y), (b, y)], 0))
            parts.append(svg.mark(x(row.mean[metric]), y, 0))
            parts.append(svg.label(left + wide + 10, y + 4, f"{row.mean[metric]:.3f}", "start"))
            y += line
        y += line // 2
    parts.append(svg.rule(left, y, left + wide, y))
    parts += [svg.label(x(t), y + 16, svg.short(t)) for t in svg.ticks(0, most) if t <= most]
    return svg.document(title, (left + wide + 70, y + 30), parts)


def calibration(groups: Mapping[str, Sequence[Mapping[str, float]]], title: str) -> str:
    """Root mean square error against error bar, a line for each dataset, and where both agree."""
    lines = {name: [(p["bar"], p["error"]) for p in line] for name, line in groups.items()}
    most = max([v for line in lines.values() for p in line for v in p], default=1.0) or 1.0
    ticks = svg.ticks(0, most)
    x, y = svg.scales((0, ticks[-1]), (0, ticks[-1]))
    across, up = "spread over captions (log depth)", "error of log depth, root mean square"
    parts = [*svg.axes(ticks, ticks, x, y, across, up)]
    parts.append(svg.rule(x(0), y(0), x(ticks[-1]), y(ticks[-1])))
    for k, (name, line) in enumerate(lines.items()):
        spots = [(x(a), y(b)) for a, b in line]
        parts += [svg.path(spots, k), *(svg.mark(*spot, k) for spot in spots)]
        right, down = svg.WIDTH + 8, svg.TOP + 18 * k
        parts += [svg.mark(right, down + 12, k), svg.label(right + 10, down + 16, name, "start")]
    moved = f'<g transform="translate(0 30)">{"".join(parts)}</g>'
    return svg.document(title, (svg.WIDTH + 220, svg.HEIGHT + 30), [moved])

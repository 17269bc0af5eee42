"""Figures of docs/evaluation.md from a work dir in which `rsa-data run comparison` has run.

    python benchmarks/figures.py WORK [--name comparison] [--out docs/img]

Writes inputs.svg (AbsRel less that of text on the same images, with 95% intervals by scene, of
WORK/comparisons/NAME/paired.csv) and descriptions.svg (AbsRel with wrong or poor descriptions, of
the first text and the first objects head of the comparison).
"""

import argparse
import math
from collections.abc import Callable
from pathlib import Path

import pandas as pd

from rsa_data.common import svg

ROWS = (
    "text, grouped",
    "objects",
    "objects without places",
    "objects, names only",
    "text and objects",
    "image (thumbnail)",
    "text and image (thumbnail)",
    "image (thumbnail) and objects",
    "text, image (thumbnail) and objects",
    "captions shuffled",
    "dataset name only",
    "constant",
    "linear fit",
    "linear fit, scale a region",
    "linear fit a region",
)
LEFT, WIDE, LINE = 250, 400, 18


Spot = tuple[float, float, float] | None


def dots(
    title: str,
    panels: dict[str, list[tuple[str, list[Spot]]]],
    names: list[str],
    ticks: list[float],
    of: Callable[[float], float] = float,
) -> str:
    """Panels of rows of (value, low, high) in as many series as there are names.

    of : what the axis is even in, such as math.log.
    """
    low, high = of(ticks[0]), of(ticks[-1])

    def x(value: float) -> float:
        return LEFT + WIDE * (of(value) - low) / (high - low)

    parts, y = [], 48.0
    for k, name in enumerate(names):
        parts += [svg.mark(LEFT + 110 * k, 36, k), svg.label(LEFT + 110 * k + 8, 40, name, "start")]
    y += 14 if names else 0
    for panel, rows in panels.items():
        parts.append(svg.label(10, y, panel, "start", strong=True))
        bottom = y + LINE * len(rows) + 4
        parts += [svg.rule(x(t), y + 6, x(t), bottom) for t in ticks]
        parts += [svg.label(x(t), bottom + 16, svg.short(t)) for t in ticks]
        y += LINE
        for label, spots in rows:
            parts.append(svg.label(LEFT - 8, y + 4, label, "end"))
            for k, spot in enumerate(spots):
                if spot is not None:
                    value, least, most = spot
                    parts.append(svg.path([(x(least), y), (x(most), y)], k))
                    parts.append(svg.mark(x(value), y, k))
            y += LINE
        y += 2 * LINE
    return svg.document(title, (LEFT + WIDE + 40, y - LINE), parts)


def inputs(folder: Path) -> str:
    """Each row's AbsRel less that of text."""
    table = pd.read_csv(folder / "paired.csv")
    panels: dict[str, list[tuple[str, list[Spot]]]] = {}
    for dataset, rows in table.groupby("dataset", sort=False):
        known = rows.set_index("method")
        panels[str(dataset)] = [
            (m, [tuple(known.loc[m, ["mean", "low", "high"]])]) for m in ROWS if m in known.index
        ]
    every = [v for rows in panels.values() for _, spots in rows for v in spots[0] or ()]
    title = "AbsRel less that of text, synthetic scenes, 95% intervals by scene"
    return dots(title, panels, [], svg.ticks(min(every), max(every)))


def descriptions(heads: list[Path]) -> str:
    """AbsRel by change, without intervals: one seed each."""
    tables = [pd.read_csv(folder / "summary.csv") for folder in heads]
    panels: dict[str, list[tuple[str, list[Spot]]]] = {}
    for dataset in tables[0]["dataset"].unique():
        own = [t[t["dataset"] == dataset].set_index("method")["abs_rel"] for t in tables]
        panels[str(dataset)] = [
            (m, [(float(t[m]),) * 3 if m in t.index else None for t in own]) for m in own[-1].index
        ]
    title = "AbsRel with wrong or poor descriptions, synthetic scenes, one seed"
    return dots(title, panels, ["text", "objects"], [0.1, 0.2, 0.5, 1, 2, 3], math.log)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("work", type=Path)
    parser.add_argument("--name", default="comparison")
    parser.add_argument("--out", type=Path, default=Path("docs/img"))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    folder = given.work / "comparisons" / given.name
    (given.out / "inputs.svg").write_text(inputs(folder), "utf-8")
    heads = [
        next((given.work / "heads" / f"{given.name}-{name}-0" / "robustness").iterdir())
        for name in ("text", "objects")
    ]
    (given.out / "descriptions.svg").write_text(descriptions(heads), "utf-8")


if __name__ == "__main__":
    main()

"""Figures of docs/evaluation.md from a work dir in which `rsa-data run comparison` has run.

    python benchmarks/figures.py WORK [--name comparison] [--out docs/img]

Writes inputs.svg (AbsRel less that of text on the same images, with 95% intervals by scene, of
WORK/comparisons/NAME/paired.csv) and descriptions.svg (AbsRel with wrong or poor descriptions over
that with plain ones, for the first text and the first objects head of the comparison).
"""

import argparse
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


def dots(title: str, panels: dict[str, list[tuple[str, list[tuple[float, float, float]]]]],
         names: list[str], zero: float) -> str:  # fmt: skip
    """Panels of rows of (value, low, high) in as many series as there are names."""
    every = [v for rows in panels.values() for _, spots in rows for spot in spots for v in spot]
    ticks = svg.ticks(min(*every, zero), max(*every, zero))
    low, high = min(ticks[0], *every), max(ticks[-1], *every)

    def x(value: float) -> float:
        return LEFT + WIDE * (value - low) / (high - low)

    parts, y = [], 48.0
    for k, name in enumerate(names):
        parts += [svg.mark(LEFT + 110 * k, 36, k), svg.label(LEFT + 110 * k + 8, 40, name, "start")]
    y += 14 if names else 0
    for panel, rows in panels.items():
        parts.append(svg.label(10, y, panel, "start", strong=True))
        top, y = y, y + LINE
        for label, spots in rows:
            parts.append(svg.label(LEFT - 8, y + 4, label, "end"))
            for k, (value, least, most) in enumerate(spots):
                place = y + 4 * (k - (len(spots) - 1) / 2)
                parts.append(svg.path([(x(least), place), (x(most), place)], k))
                parts.append(svg.mark(x(value), place, k))
            y += LINE
        parts.append(svg.rule(x(zero), top + 6, x(zero), y - 8))
        y += LINE / 2
    parts.append(svg.rule(LEFT, y, LEFT + WIDE, y))
    parts += [svg.label(x(t), y + 16, svg.short(t)) for t in ticks]
    return svg.document(title, (LEFT + WIDE + 40, y + 30), parts)


def inputs(folder: Path) -> str:
    """Each row's AbsRel less that of text."""
    table = pd.read_csv(folder / "paired.csv")
    panels = {}
    for dataset, rows in table.groupby("dataset", sort=False):
        known = rows.set_index("method")
        panels[str(dataset)] = [
            (m, [tuple(known.loc[m, ["mean", "low", "high"]])]) for m in ROWS if m in known.index
        ]
    return dots("AbsRel less that of text, synthetic scenes, 95% intervals by scene",
                panels, [], 0.0)  # fmt: skip


def descriptions(heads: list[Path]) -> str:
    """AbsRel by change over that of the plain description, without intervals: one seed each."""
    tables = [pd.read_csv(folder / "summary.csv") for folder in heads]
    panels: dict[str, list[tuple[str, list[tuple[float, float, float]]]]] = {}
    for dataset in tables[0]["dataset"].unique():
        own = [t[t["dataset"] == dataset].set_index("method")["abs_rel"] for t in tables]
        panels[str(dataset)] = [
            (m, [(float(t[m] / t["plain"]),) * 3 for t in own if m in t.index])
            for m in own[-1].index
            if m != "plain"
        ]
    return dots("AbsRel over that with plain descriptions, synthetic scenes",
                panels, ["text", "objects"], 1.0)  # fmt: skip


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

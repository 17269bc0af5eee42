"""What a scale for each region could gain over one for the image, at most, on test images.

    rsa-data detect --masks ... ; rsa-data depth ...
    python benchmarks/regions.py WORK [--depth-model tu2020]

For each dataset of WORK with whole maps of a test split and segments with masks: AbsRel of the
linear fit of each image, and of a fit of its own and of one factor in each segment, and in each of
2 x 2, 4 x 4 and 8 x 8 cells, as `evaluation.regions` has them. No head is needed.
"""

import argparse
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from rsa_data.evaluation.methods import oracle_methods
from rsa_data.evaluation.regions import by_regions, fitted, rescaled
from rsa_data.evaluation.rows import measure
from rsa_data.evaluation.setting import parts_of, rules_of
from rsa_data.evaluation.summary import summarise
from rsa_data.store.tables import WorkDir


def cells(count: int, row: Mapping[str, Any], shape: tuple[int, ...]) -> np.ndarray:
    """Number of the cell of each pixel of a map that is cut into count x count cells."""
    rows, columns = (np.arange(size) * count // size for size in shape)
    return np.asarray(rows[:, None] * count + columns[None])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("work")
    parser.add_argument("--depth-model", default="tu2020")
    given = parser.parse_args()
    work = WorkDir(given.work)
    print("| dataset | images | scenes | regions | linear fit | fit a region | scale a region |")
    print("|---|---:|---:|---|---:|---:|---:|")
    for name in work.datasets():
        rules = rules_of(work, name, "rsa")
        parts = parts_of(work, name, f"depth/{given.depth_model}", "test")
        for segments in (t for t in work.tables(name) if t.startswith("segments/")):
            ways = {segments: None} | {f"{n} x {n} cells": partial(cells, n) for n in (2, 4, 8)}
            for way, divide in ways.items():
                methods = {
                    "linear fit": oracle_methods(rules.max_depth)["linear fit"],
                    "fit": by_regions(segments, fitted, divide),
                    "scale": by_regions(segments, rescaled, divide),
                }
                rows = summarise(measure(parts, methods, rules))
                errors = " | ".join(f"{row.mean['abs_rel']:.3f}" for row in rows)
                print(f"| {name} | {rows[0].images} | {rows[0].scenes} | {way} | {errors} |")


if __name__ == "__main__":
    main()

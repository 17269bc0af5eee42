"""Errors of whole maps in a loop over images and methods, in NumPy and SciPy."""

import json
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
from scipy.optimize import least_squares

given = json.loads(sys.argv[1])
LOW, HIGH = given["limits"]
fixed = pd.DataFrame(json.loads(Path(given["scales"]).read_text()))
fixed = {name: rows.set_index("sample_id") for name, rows in fixed.groupby("method")}


def errors(gt, pred):
    ratio = np.maximum(gt / pred, pred / gt)
    difference, log = gt - pred, np.log(gt) - np.log(pred)
    return {
        **{f"delta{k}": (ratio < 1.25**k).mean() for k in (1, 2, 3)},
        "abs_rel": np.mean(np.abs(difference) / gt),
        "sq_rel": np.mean(difference**2 / gt),
        "rmse": np.sqrt((difference**2).mean()),
        "rmse_log": np.sqrt((log**2).mean()),
        "log10": np.mean(np.abs(np.log10(gt) - np.log10(pred))),
        "silog": np.sqrt(np.mean(log**2) - np.mean(log) ** 2) * 100,
    }


def fits(y, gt):
    design = np.stack([y, np.ones_like(y)], 1)
    scale, shift = np.linalg.lstsq(design, 1 / gt, rcond=None)[0]
    yield "linear fit", (scale, shift)
    # np.median of the ground truth over that of 1 / y, as Monodepth2 scales.
    yield "median", (1 / (np.median(gt) / np.median(1 / y[y > 0])), 0.0)
    found = least_squares(
        lambda p: 1 / np.maximum(p[0] * y + p[1], 1 / HIGH) - gt, [scale, shift], method="lm"
    )
    yield "linear fit in depth", found.x


begun = time.process_time()
rows = []
for file in given["files"]:
    table = pq.read_table(file)
    for sample, y, gt in zip(
        *(table[name].to_pylist() for name in ("sample_id", "relative", "metric")), strict=True
    ):
        y, gt = (np.frombuffer(values, "<f2").astype(np.float64) for values in (y, gt))
        valid = (gt > LOW) & (gt < HIGH)
        y, gt = y[valid], gt[valid]
        ready = {name: one.loc[sample, ["scale", "shift"]] for name, one in fixed.items()}
        for name, (scale, shift) in [*ready.items(), *fits(y, gt)]:
            inverse = scale * y + shift
            with np.errstate(divide="ignore"):
                pred = np.clip(np.where(inverse > 0, 1 / inverse, HIGH), LOW, HIGH)
            rows.append({"sample_id": sample, "method": name, **errors(gt, pred)})
steady = time.process_time() - begun
pd.DataFrame(rows).to_parquet(given["out"])
print(json.dumps({"steady": steady}))

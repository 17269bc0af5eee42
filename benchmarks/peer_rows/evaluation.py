"""Evaluation of whole maps: `rsa-data evaluate` against a loop as in the released code."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from made_tables import write

from rsa_data.store.tables import WorkDir

from .ways import Given, Row, Run, Way, ours, peer

_LIMITS = (1e-3, 10.0)  # m, of NYUv2


def row(given: Given) -> Row:
    """A head on test maps of NYUv2's size, with the same oracles and constants on both sides."""
    count, size = (12, (48, 64)) if given.small else (654, (480, 640))
    work = maps(given, count, size)
    location = Path(work.store.location)
    ours(given, location, "train-head", "--epochs", 1, "--threads", given.threads)

    def read() -> pd.DataFrame:
        folder = location / "heads" / "head" / "evaluation"
        found = pd.read_parquet(next(folder.rglob("metrics.parquet")))
        return found[found["status"] == "ok"]

    def own() -> Run:
        cpu, wall, megabytes = ours(given, location, "evaluate", "--head", "head")
        return Run(cpu, float("nan"), wall, megabytes, read())

    def theirs(way: str, name: str) -> Way:
        table = work.table("nyuv2", "depth/files")
        test = [n for n in table.parts() if table.receipt(n).split == "test"]
        words: dict[str, Any] = {
            "way": way,
            "files": [str(location / table.path / table.receipt(n).file) for n in test],
            "limits": _LIMITS,
        }
        fixed = read()
        fixed = fixed[fixed["method"].isin(["head", "constant", "constant (L1)"])]
        file = given.folder / "scales.json"
        fixed[["sample_id", "method", "scale", "shift"]].to_json(file, orient="records")
        return Way(
            name, lambda: peer(given, "evaluation", read=pd.read_parquet, scales=file, **words)
        )

    own()
    ways = (theirs("same", "NumPy and SciPy, a loop"), Way("rsa-data", own, ours=True))
    note = (
        "Synthetic maps with 5% noise. Both sides measure the head, two constants and three fits "
        "to the ground truth (median, linear, linear in depth: SciPy's least_squares in the loop) "
        "of each map, in float64. The loop gets the scales of head and constants ready."
    )
    return Row("Evaluation of whole maps", count, "maps", ways, agreement, note)


def maps(given: Given, count: int, size: tuple[int, int]) -> WorkDir:
    """A work dir with a few training images and whole maps of a test split."""
    work = WorkDir(str(given.folder / "evaluation"))
    if (given.folder / "evaluation").is_dir():
        return work
    rng = np.random.default_rng(0)
    pixels, a_part = size[0] * size[1], 100
    features = {str(k): rng.normal(size=384).astype(np.float16) for k in range(40)}

    def some(n: int, per_image: int, split: str, **more: Any) -> None:
        kind = np.arange(n) % 40
        y = rng.uniform(0, 10, (n, per_image)).astype(np.float32)
        inverse = 0.02 * (1 + kind[:, None] % 5) * y + 0.1 + 0.01 * (kind[:, None] % 7)
        depth = np.exp(0.05 * rng.standard_normal(y.shape, np.float32)) / inverse
        if split == "test":
            depth[:, ::50] = 0  # no ground truth there
        scenes = [f"scene {split} {i // 4}" for i in range(n)]
        texts = [[str(k)] for k in kind]
        arrays = {"relative": y, "metric": depth, "features": features}
        write(work, "nyuv2", scenes=scenes, texts=texts, split=split, **arrays, **more)

    some(400, 256, "train", part=400)
    # In one call, since it is what numbers the samples.
    some(count, pixels, "test", part=a_part, first_part=1, size=size)
    return work


def agreement(found: Any) -> dict[str, str]:
    """Largest relative difference of AbsRel and RMSE of a row that both have."""
    first = next(iter(found.values())).reset_index(drop=True)
    said = {}
    for name, table in found.items():
        keys = ["place", "method"]
        both = placed(first).merge(placed(table), on=keys, suffixes=("", "_other"))
        fixed = both[both["method"] != "linear fit in depth"]
        worst = {
            where: max(
                float((rows[f"{m}_other"] / rows[m] - 1).abs().max()) for m in ("abs_rel", "rmse")
            )
            for where, rows in (("", fixed), (" in all", both))
        }
        said[name] = (
            f"{len(both):,} rows, AbsRel and RMSE differ by at most {worst['']:.1e}, with the fit "
            f"in depth {worst[' in all']:.1e}"
        )
    return said


def placed(table: pd.DataFrame) -> pd.DataFrame:
    """Rows numbered within each method, in the order of images."""
    return table.assign(place=table.groupby("method").cumcount())

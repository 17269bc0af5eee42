"""Errors by what the description says: number of objects, share covered, class."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from ..store.tables import WorkDir
from .known_metrics import metrics as known


def described(work: WorkDir, dataset: str, captions: str, numbers: Sequence[int]) -> pd.DataFrame:
    """What the plain caption of each image holds: sample_id, n_objects, n_kept, area, area_kept."""
    columns = ["sample_id", "variant", "n_objects", "n_kept", "area", "area_kept"]
    parts = [work.table(dataset, captions).read(n, columns) for n in numbers]
    table = pa.concat_tables(parts)
    plain = table.filter(pc.equal(table["variant"], 0))
    return plain.drop_columns(["variant"]).to_pandas()


def groups(about: pd.DataFrame) -> dict[str, pd.Series]:
    """Named groups of images, as bool columns: the hard quarters and all others.

    few objects, little covered : the quarter of the images with the fewest objects, and with the
    smallest share described. Where many tie, all that tie belong, so it may be more than a quarter.
    """
    few = about["n_objects"] <= about["n_objects"].quantile(0.25)
    little = about["area_kept"] <= about["area_kept"].quantile(0.25)
    return {
        "few objects": few,
        "little covered": little,
        "neither": ~few & ~little,
    }


def by_group(metrics: pd.DataFrame, about: pd.DataFrame, metric: str = "abs_rel") -> pd.DataFrame:
    """Mean of a metric for each method (rows) and group of images (columns), of one dataset.

    metrics : the metrics table of one dataset; about : from `described`.
    """
    if metric not in known():
        raise ValueError(f"expected one of {', '.join(known())}, found {metric!r}")
    good = metrics[metrics["status"] == "ok"].merge(about, on="sample_id")
    order = list(dict.fromkeys(good["method"]))
    table = {}
    for name, rows in groups(about).items():
        ids = set(about.loc[rows, "sample_id"])
        inside = good[good["sample_id"].isin(ids)]
        table[f"{name} ({len(ids)})"] = inside.groupby("method")[metric].mean().reindex(order)
    return pd.DataFrame(table)


def by_description(
    work: WorkDir, dataset: str, captions: str, numbers: Sequence[int], metrics: pd.DataFrame
) -> pd.DataFrame:
    """Mean errors of each method by number of objects, by share covered and by class.

    metrics : the metrics table of one dataset. Columns: dataset, method, by, value, images, then
    the metrics. An image counts for every class in it; classes need segments.
    """
    about = described(work, dataset, captions, numbers)
    bins = {
        "objects": pd.cut(
            about["n_objects"],
            [-1, 0, 2, 5, 10, np.inf],
            labels=["0", "1 to 2", "3 to 5", "6 to 10", "11 and more"],
        ),
        "share covered": pd.cut(
            about["area_kept"],
            [-1, 0.25, 0.5, 0.75, np.inf],
            labels=["to 25%", "to 50%", "to 75%", "above"],
        ),
    }
    pairs = [
        pd.DataFrame({"sample_id": about["sample_id"], "by": by, "value": values.astype(str)})
        for by, values in bins.items()
    ]
    segments = [
        name
        for name in work.table(dataset, captions).description().inputs
        if name.startswith("segments/")
    ]
    pairs += [_classes(work, dataset, name, numbers) for name in segments]
    good = metrics[metrics["status"] == "ok"].merge(pd.concat(pairs), on="sample_id")
    grouped = good.groupby(["dataset", "method", "by", "value"], sort=False)
    found = grouped[list(known())].mean()
    found.insert(0, "images", grouped.size())
    return found.reset_index().sort_values(
        ["by", "images", "value"], ascending=[True, False, True], kind="stable"
    )


def _classes(work: WorkDir, dataset: str, segments: str, numbers: Sequence[int]) -> pd.DataFrame:
    """A row for each image and class in it."""
    shows = []
    for n in numbers:
        part = work.table(dataset, segments).read(n, ["sample_id", "label"])
        flat = pc.list_flatten(part["label"])
        ids = part["sample_id"].take(pc.list_parent_indices(part["label"]))
        shows.append(pd.DataFrame({"sample_id": ids.to_numpy(), "value": flat.to_numpy()}))
    return pd.concat(shows).drop_duplicates().assign(by="class")


def text(table: pd.DataFrame, digits: int = 3) -> str:
    """A frame as aligned text, nan as a dash."""
    return str(table.to_string(float_format=lambda v: "-" if np.isnan(v) else f"{v:.{digits}f}"))

"""Errors by what the description says: number of objects, share covered, class."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from ..parts import Work
from .metrics import METRICS


def described(work: Work, dataset: str, captions: str, numbers: Sequence[int]) -> pd.DataFrame:
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
    if metric not in METRICS:
        raise ValueError(f"expected one of {', '.join(METRICS)}, found {metric!r}")
    good = metrics[metrics["status"] == "ok"].merge(about, on="sample_id")
    order = list(dict.fromkeys(good["method"]))
    table = {}
    for name, rows in groups(about).items():
        ids = set(about.loc[rows, "sample_id"])
        inside = good[good["sample_id"].isin(ids)]
        table[f"{name} ({len(ids)})"] = inside.groupby("method")[metric].mean().reindex(order)
    return pd.DataFrame(table)


def by_class(
    work: Work, dataset: str, segments: str, numbers: Sequence[int], metrics: pd.DataFrame
) -> pd.DataFrame:
    """Mean errors of the images that show each class, with how many they are, commonest first.

    metrics : rows of one method of one dataset. An image counts for every class in it.
    """
    shows = []
    for n in numbers:
        part = work.table(dataset, segments).read(n, ["sample_id", "label"])
        flat = pc.list_flatten(part["label"])
        ids = part["sample_id"].take(pc.list_parent_indices(part["label"]))
        shows.append(pd.DataFrame({"sample_id": ids.to_numpy(), "class": flat.to_numpy()}))
    pairs = pd.concat(shows).drop_duplicates()
    joined = pairs.merge(metrics[metrics["status"] == "ok"], on="sample_id")
    found = joined.groupby("class")[list(METRICS)].mean()
    found.insert(0, "images", joined.groupby("class").size())
    return found.sort_values(["images"], ascending=False, kind="stable")


def text(table: pd.DataFrame, digits: int = 3) -> str:
    """A frame as aligned text, nan as a dash."""
    return table.to_string(float_format=lambda v: "-" if np.isnan(v) else f"{v:.{digits}f}")

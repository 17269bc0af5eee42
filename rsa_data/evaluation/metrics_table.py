"""The metrics table: one row for each image and method, one column for each metric."""

from collections.abc import Sequence
from typing import Any

import pyarrow as pa

from ..store import schemas
from .known_metrics import metrics


def to_table(rows: Sequence[dict[str, Any]]) -> pa.Table:
    """The metrics table: the columns of schemas/metrics.toml, then one for each metric.

    rows : a dict for each image and method; what is missing in one is null. Raises RsaDataError
    where a row lacks what may not be null.
    """
    names = schemas.schema("metrics").names
    table = schemas.from_columns("metrics", {n: [row.get(n) for row in rows] for n in names})
    schemas.check("metrics", table)
    for name, metric in metrics().items():
        about = {"formula": metric.formula, "unit": metric.unit, "source": metric.source}
        field = pa.field(name, pa.float64(), metadata=about)
        table = table.append_column(field, pa.array([row.get(name) for row in rows], pa.float64()))
    return table

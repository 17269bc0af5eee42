"""The stage embed-proposals: what the detector itself saw in each object, as one row an image."""

from collections.abc import Callable
from typing import Annotated, Literal

import msgspec
import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from ..common.errors import RsaDataError
from ..runner.stage import Reads, Stage
from ..store import schemas
from .embed_images import embedding_column_with_nulls

Step = Callable[[pa.Table, pa.Table], pa.Table]


def build(
    *,
    order: Literal["score", "area"] = "score",
    most: Annotated[int, msgspec.Meta(ge=1, le=1000)] = 20,
    store: Literal["float16", "float32"] = "float16",
) -> Step:
    """Lays the detector's features of each image's objects side by side, for the head `proposals`.

    Parameters
    ----------
    order : which objects stand first, and stay when there are too many: the surest or the largest.
    most : objects of an image. A row has this many times d + 1 numbers: the feature of an object
        (d numbers) and a 1; where there is no object all are 0.
    store : type of the stored features.
    """

    def step(segments: pa.Table, samples: pa.Table) -> pa.Table:
        """Segments with features, as `detect --features OUTPUT` keeps them -> image_embeddings."""
        ok = np.array(pc.equal(segments["status"], "ok").to_pylist(), bool)
        found = segments["feature"].to_pylist()
        rank = segments[order].to_pylist()
        width = next((len(f[0]) // 4 for f in found if f), None)
        if width is None or any(f is None for f, good in zip(found, ok, strict=True) if good):
            raise RsaDataError(
                "embed-proposals: expected the detector's features beside its segments; found "
                "none. Run `rsa-data detect --features OUTPUT`, OUTPUT being the graph's output "
                "with a row for each object"
            )
        rows = np.zeros((len(found), most, width + 1), np.float32)
        for row, (features, key) in enumerate(zip(found, rank, strict=True)):
            surest = np.argsort(-np.asarray(key, np.float64), kind="stable")[:most]
            for place, n in enumerate(surest if features else ()):
                rows[row, place, :width] = np.frombuffer(features[n], "<f4")
                rows[row, place, width] = 1
        stored = rows.reshape(len(found), -1).astype(store)
        return schemas.from_columns(
            "image_embeddings",
            {
                "sample_id": segments["sample_id"],
                "status": segments["status"],
                "error": segments["error"],
                "embedding": embedding_column_with_nulls(stored, ok),
            },
        )

    return step


STAGE = Stage(
    name="embed-proposals",
    version=1,
    build=build,
    help="""Gather the detector's features of each image's objects.

    The head `proposals` learns from them.

    \b
      rsa-data detect --dataset nyuv2 --features OUTPUT
      rsa-data embed-proposals
    """,
    next="train-head --style proposals --head proposals",
    schema="image_embeddings",
    folder="embeddings/proposals",
    selector=None,
    reads=Reads("segments", "segments"),
)

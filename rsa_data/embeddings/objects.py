"""The stage embed-objects: objects of each image, and each class name encoded once."""

from collections.abc import Callable, Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from .. import registry
from ..common.class_names import clean
from ..runner.stage import Reads, Stage
from ..store import schemas
from . import frozen

Step = Callable[[pa.Table, pa.Table], pa.Table]


def build(*, encoder: str = "clip-rn50", encoder_weights: Path | None = None) -> Step:
    """Lists the objects of each image for the head `objects`, which reads no sentence.

    Parameters
    ----------
    encoder : text encoder of the class names; see `rsa-data list encoders`.
    encoder_weights : file with the encoder's weights, or folder of a sentence encoder. Without it
        the registry's file is taken: from its package, the cache, or a download with its checksum.
    """
    features = frozen.loaded(encoder=encoder, encoder_weights=encoder_weights)

    @cache
    def feature(name: str) -> bytes:
        # Each alone: its place in a batch could change the last bits.
        found: np.ndarray = features([name])[0]
        return found.astype("<f4").tobytes()

    def step(segments: pa.Table, samples: pa.Table) -> pa.Table:
        """Segments -> a table of schemas/objects.toml, in the same order."""
        rows = segments.select(
            ["label", "area", "center", "is_thing", "width", "height"]
        ).to_pylist()
        names = [[clean(label) for label in row["label"]] for row in rows]
        new = list(_first_seen(names))
        return schemas.from_columns(
            "objects",
            {
                "sample_id": segments["sample_id"],
                "status": segments["status"],
                "error": segments["error"],
                "name": names,
                "share": [row["area"] for row in rows],
                "center": [_centers(row) for row in rows],
                "is_thing": [row["is_thing"] for row in rows],
                "new_name": new,
                "new_feature": [[feature(name) for name in found] for found in new],
            },
        )

    return step


def _first_seen(names: Sequence[Sequence[str]]) -> Iterable[list[str]]:
    """Of each row the names that no row before it has."""
    seen: set[str] = set()
    for row in names:
        found = [name for name in dict.fromkeys(row) if name not in seen]
        seen.update(found)
        yield found


def _centers(row: dict[str, Any]) -> list[list[float]] | None:
    """Centres as shares of width and height."""
    if row["center"] is None or not row["width"] or not row["height"]:
        return None
    return [[x / row["width"], y / row["height"]] for x, y in row["center"]]


STAGE = Stage(
    name="embed-objects",
    version=1,
    build=build,
    help="""List the objects of each image for heads that read them.

    Covers every dataset of the work dir unless --dataset is given. Each class name is encoded once:
    seconds, where captions take up to an hour.

    \b
      rsa-data embed-objects --encoder minilm
    """,
    next="train-head --head objects",
    schema="objects",
    folder="embeddings/objects",
    selector="encoder",
    choices=registry.ENCODERS,
    reads=Reads("segments", "segments"),
    local=("encoder_weights",),
    files=frozen.files,
)

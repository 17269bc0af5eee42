"""How a head's error moves when the description is wrong or poor: the captions are written anew."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from .. import tables
from ..errors import RowError, RsaDataError
from ..parts import Work
from .inputs import Image, TestPart, rows_of
from .methods import Method, Prediction, by_head, scaled

if TYPE_CHECKING:
    from ..heads.checkpoint import ScaleHead
    from ..heads.examples import Source

# Options of the captions stage, and which variant to take: 0 is the plain caption of these
# options, 1 an augmented one, whose objects always stand in another order.
_NONE = {"delete": 0.0, "delete_by_area": None, "replace": 0.0, "insert": 0}
CHANGES: dict[str, tuple[dict[str, Any], int]] = {
    "plain": ({}, 0),
    "order swapped": (_NONE, 1),
    "a fifth deleted": (_NONE | {"delete": 0.2}, 1),
    "half deleted": (_NONE | {"delete": 0.5}, 1),
    "a fifth replaced": (_NONE | {"replace": 0.2}, 1),
    "half replaced": (_NONE | {"replace": 0.5}, 1),
    "1 wrong added": (_NONE | {"insert": 1}, 1),
    "3 wrong added": (_NONE | {"insert": 3}, 1),
    "things only": ({"objects": "things"}, 0),
    "background only": ({"objects": "background"}, 0),
    "nothing found": ({}, 0),
}
# Datasets that reach farther than this are streets: what is wrong in them comes from rooms.
_INDOOR_METRES = 20.0


def robustness_methods(
    work: Work,
    head: "ScaleHead",
    source: "Source",
    *,
    max_depth: float,
    weights: Path | None,
    seed: int = 0,
) -> dict[str, Method]:
    """A method for each change to the descriptions of a dataset's test images.

    The head's own captions and embeddings tables say how captions are written and encoded;
    objects that replace others or are added come from the other domain: streets in rooms, rooms
    in streets. Also each other captions table of the dataset that was embedded by the same
    encoder, such as natural captions. Raises RsaDataError when the captions do not come from
    segments.
    """
    from ..captions import write
    from ..encoders import embed

    captions = work.table(source.dataset, source.captions).description()
    segments = next((n for n in captions["inputs"] if n.startswith("segments/")), None)
    if segments is None:
        raise RsaDataError(
            f"{source.dataset}/{source.captions}: expected captions written from segments, whose "
            "objects can be changed; these were imported"
        )
    encode = embed.build(
        **{**work.table(source.dataset, source.embeddings).description()["options"]},
        weights=weights,
    )
    wrong = "street" if max_depth <= _INDOOR_METRES else "indoor"
    methods = {}
    for name, (change, variant) in CHANGES.items():
        options = {**captions["options"], "domain": wrong, "seed": seed, **change}
        writer = write.build(**options | {"variants": variant + 1})
        edit = _nothing if name == "nothing found" else _as_found
        described = partial(_described, writer, edit, segments, variant)
        methods[name] = _by_texts(head, described, encode)
    return methods | other_captions(work, head, source)


def other_captions(work: Work, head: "ScaleHead", source: "Source") -> dict[str, Method]:
    """The head on the dataset's other captions that its encoder has embedded, by style."""
    encoder = source.embeddings.split("/")[-1]
    found = {}
    for name in work.tables(source.dataset):
        kind, _, style = name.partition("/")
        embeddings = f"embeddings/{style}/{encoder}"
        if kind == "captions" and name != source.captions and _has(work, source, embeddings):
            found[f"captions {style}"] = by_head(head, embeddings, name)
    return found


def _has(work: Work, source: "Source", embeddings: str) -> bool:
    """Whether a table is there and made as the head's own embeddings are."""
    table, own = (
        work.table(source.dataset, embeddings),
        work.table(source.dataset, source.embeddings),
    )
    if not table.exists():
        return False
    same = ("options", "files", "stage_version")
    return all(table.description()[key] == own.description()[key] for key in same)


def _as_found(segments: pa.Table) -> pa.Table:
    return segments


def _nothing(segments: pa.Table) -> pa.Table:
    """The same images with no segment in them."""
    columns: dict[str, Any] = {name: segments[name] for name in segments.column_names}
    for name in columns:
        if pa.types.is_list(segments.schema.field(name).type):
            empty: list[list[Any]] = [[]] * len(segments)
            columns[name] = pa.array(empty, segments.schema.field(name).type)
    return pa.table(columns, schema=segments.schema)


def _described(
    writer: Callable[..., pa.Table],
    edit: Callable[[pa.Table], pa.Table],
    segments: str,
    variant: int,
    part: TestPart,
) -> pa.Table:
    """The captions of a part's images, one row an image that has segments."""
    found = part.work.table(part.dataset, segments).read(part.number)
    samples = part.work.table(part.dataset, "samples").read(part.number)
    captions = writer(edit(found), samples)
    return captions.filter(np.asarray(captions["variant"]) == variant)


def _by_texts(
    head: Callable[[np.ndarray], tuple[Any, Any]],
    described: Callable[[TestPart], pa.Table],
    encode: Callable[[pa.Table], pa.Table],
) -> Method:
    """The scale and shift that a head gives for captions written and encoded on the spot."""

    def method(part: TestPart) -> Callable[[Image], Prediction]:
        captions = described(part)
        texts = encode(captions)
        features = tables.embedding_array(texts)[rows_of(captions["text_id"], texts["text_id"])]
        scales, shifts = head(features.astype(np.float32))
        ids = {name: row for row, name in enumerate(captions["sample_id"].to_pylist())}

        def predict(image: Image) -> Prediction:
            row = ids.get(image.sample["sample_id"])
            if row is None:
                raise RowError("no caption")
            return scaled(image, float(scales[row]), float(shifts[row]))

        return predict

    return method


def steps(rows: Mapping[str, float]) -> dict[str, float]:
    """Each change's AbsRel over that of the plain captions, minus 1."""
    return {name: value / rows["plain"] - 1 for name, value in rows.items()}

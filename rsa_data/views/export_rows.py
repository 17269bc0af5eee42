"""What an export holds of one part: a row a caption (or an image), everything as plain columns."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from ..common.errors import RowError, RsaDataError
from ..datasets import images, index
from ..runner.commands import again
from ..store import schemas
from ..store.tables import Table, WorkDir

_CAMERA = ("width", "height", "fx", "fy", "cx", "cy")
_FITS = ("fit_scale", "fit_shift")
_PIXELS = ("relative", "metric")


@dataclass(frozen=True)
class Chosen:
    """The tables of one dataset that are exported.

    embeddings : the features. depth : fits and pixels, or None. root : where pictures lie, or None
    to leave them out.
    """

    work: WorkDir
    embeddings: Table
    depth: Table | None
    root: Path | None

    @property
    def dataset(self) -> str:
        return self.embeddings.dataset

    @property
    def captions(self) -> str | None:
        """The table of captions; None for features of images."""
        style = self.embeddings.name.split("/")[1]
        return None if style in ("images", "proposals", "objects") else f"captions/{style}"


def parts(chosen: Chosen) -> dict[int, str]:
    """Number and split of every part, all of them done in every table; raises RsaDataError."""
    samples = chosen.work.table(chosen.dataset, "samples")
    found = {r.part: r.split for r in samples.receipts(samples.parts())}
    tables = [chosen.embeddings, *([chosen.depth] if chosen.depth else [])]
    if chosen.captions:
        tables.append(chosen.work.table(chosen.dataset, chosen.captions))
    for table in tables:
        if missing := table.missing():
            raise RsaDataError(
                f"{table}: {len(missing)} of {len(found)} parts are not done, and only whole "
                f"datasets are exported. Run `{again(chosen.work, table)}`, or leave this "
                "dataset out: --datasets NAME"
            )
    return found


def rows(chosen: Chosen, number: int) -> pa.Table:
    """One part: sample_id, variant and text, scene, image, camera, feature, fits, pixels, picture.

    embedding : list<float>, as long as the feature. relative, metric : list<float16>, the sampled
    pixels or the whole map row by row (map_height, map_width), null where depth failed.
    """
    work, table = chosen.work, chosen.embeddings
    features = table.read(number)
    samples = work.table(table.dataset, "samples").read(number)
    if chosen.captions is None:
        features = features.filter(pc.equal(features["status"], "ok"))
        found = features.select(["sample_id"])
        places = pa.array(range(len(features)))
    else:
        captions = work.table(table.dataset, chosen.captions).read(number)
        found = captions.select(["sample_id", "variant", "text"])
        places = pc.index_in(captions["text_id"], features["text_id"].combine_chunks())
        if places.null_count:
            raise RsaDataError(
                f"{table} part {number}: captions without a feature: they were made again since. "
                f"Run `{again(work, table)}` again"
            )
    whole = samples.take(pc.index_in(found["sample_id"], samples["sample_id"].combine_chunks()))
    for name in ("scene", "image", *_CAMERA):
        found = found.append_column(name, whole[name])
    dim = int(features.schema.field("embedding").metadata[b"shape"])
    values = schemas.embedding_array(features)[pc.cast(places, pa.int64()).to_numpy()]
    lists = pa.FixedSizeListArray.from_arrays(pa.array(values.reshape(-1)), dim)
    found = found.append_column("embedding", lists)
    if chosen.depth is not None:
        found = _with_depth(found, chosen.depth.read(number))
    return found if chosen.root is None else _with_pictures(found, chosen.root)


def _with_depth(found: pa.Table, depth: pa.Table) -> pa.Table:
    at = pc.index_in(found["sample_id"], depth["sample_id"].combine_chunks())
    beside = depth.take(at)
    for name in _FITS:
        found = found.append_column(name, beside[name])
    is_map = pc.equal(beside["kind"], "map")
    for name, side in (("map_height", "height"), ("map_width", "width")):
        found = found.append_column(name, pc.if_else(is_map, beside[side], None))
    for name in _PIXELS:
        column = beside[name].combine_chunks()
        sizes = pc.fill_null(pc.binary_length(column), 0).to_numpy(zero_copy_only=False)
        data = b"".join(value for value in column.to_pylist() if value is not None)
        offsets = np.concatenate([[0], np.cumsum(sizes // 2)]).astype(np.int32)
        values = pa.array(np.frombuffer(data, "<f2"))
        mask = pc.is_null(column)
        found = found.append_column(name, pa.ListArray.from_arrays(offsets, values, mask=mask))
    return found


def _with_pictures(found: pa.Table, root: Path) -> pa.Table:
    """Adds `picture`, struct<bytes, path>, as Hugging Face stores images."""
    read: dict[str, bytes] = {}
    pictures: list[dict[str, Any]] = []
    for image in found["image"].to_pylist():
        if image is None:
            raise RsaDataError("export: --pictures: some samples name no image")
        if image not in read:
            read.clear()  # captions of one image stand together
            try:
                read[image] = images.read_bytes(root / image)
            except RowError as error:
                raise RsaDataError(f"export: --pictures: {image}: {error}") from error
        pictures.append({"bytes": read[image], "path": image})
    kind = pa.struct([("bytes", pa.binary()), ("path", pa.string())])
    return found.append_column("picture", pa.array(pictures, kind))


def root_of(work: WorkDir, dataset: str) -> Path:
    """Where the pictures of a dataset lie; raises RsaDataError when nobody knows."""
    root = index.find_root(work, dataset)
    if root is None:
        raise RsaDataError(
            f"export: --pictures: {dataset}: its images are not at hand; set "
            f"RSA_DATA_{dataset.upper().replace('-', '_')}_ROOT"
        )
    return root

"""What a notebook calls: open a work dir, write captions, embed texts, predict depth.

Arrays and lists go in and come out; no work dir is needed but for `open_work`.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from ..common.errors import RsaDataError, UsageError, unknown
from ..store import schemas
from ..store.tables import Table, WorkDir

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow.dataset

    from ..heads.checkpoint import ScaleHead

# Columns of binary values that are float16 arrays.
_HALVES = ("relative", "metric")


class OpenTable:
    """One table of a work dir, such as captions/occupancy."""

    def __init__(self, table: Table, samples: Table):
        self._table, self._samples = table, samples

    def __repr__(self) -> str:
        return f"<table {self._table}: {len(self._table.parts())} parts>"

    def to_arrow(self, *, partial: bool = False) -> pa.Table:
        """All rows, in the order of the samples.

        Raises RsaDataError when parts are not done yet, unless `partial` is given.
        """
        done = self._numbers(partial)
        return pa.concat_tables([self._table.read(number) for number in done])

    def to_pandas(self, *, partial: bool = False) -> pd.DataFrame:
        """The same as a DataFrame; features and depth become numpy arrays, one a row.

        embedding : (dim,), as stored. relative, metric : float16 (k,), or (height, width) where the
        row holds a whole map.
        """
        table = self.to_arrow(partial=partial)
        frame = table.to_pandas()
        if "embedding" in table.column_names:
            dtype = schemas.embedding_array(table.slice(0, 0)).dtype
            frame["embedding"] = [_array(v, dtype) for v in frame["embedding"]]
        for name in set(_HALVES) & set(table.column_names):
            maps = zip(frame[name], frame["kind"], frame["height"], frame["width"], strict=True)
            frame[name] = [
                _array(v, "<f2", (int(h), int(w)) if kind == "map" else None)
                for v, kind, h, w in maps
            ]
        return frame

    def to_numpy(self, *, partial: bool = False) -> np.ndarray:
        """The features of an embeddings table, (n, dim), as stored.

        Raises UsageError for a table without features, or with rows that have none.
        """
        table = self.to_arrow(partial=partial)
        if "embedding" not in table.column_names or table["embedding"].null_count:
            raise UsageError(f"{self._table}: expected a feature in every row; use to_pandas")
        return schemas.embedding_array(table)

    def dataset(self, *, partial: bool = False) -> pyarrow.dataset.Dataset:
        """The same as a pyarrow dataset: filters and columns are pushed down into the files."""
        import pyarrow.dataset

        done = self._numbers(partial)
        folder = Path(self._table.store.location)
        if not folder.is_dir():
            return pyarrow.dataset.dataset(self.to_arrow(partial=partial))
        files = [folder / self._table.path / self._table.receipt(n).file for n in done]
        return pyarrow.dataset.dataset([str(file) for file in files])

    def _numbers(self, partial: bool) -> list[int]:
        done, wanted = self._table.parts(), self._samples.parts()
        missing = sorted(set(wanted) - set(done))
        if missing and not partial:
            raise RsaDataError(
                f"{self._table}: {len(missing)} of {len(wanted)} parts are not done, such as "
                f"{missing[0]}. Run the command of its stage again, or give partial=True"
            )
        if not done:
            raise RsaDataError(f"{self._table}: no part is done yet")
        return done


class OpenDataset(Mapping[str, OpenTable]):
    """The tables of one dataset, by name."""

    def __init__(self, work: WorkDir, name: str):
        self._work, self._name = work, name

    def __getitem__(self, table: str) -> OpenTable:
        found = self._work.table(self._name, table)
        if not found.exists():
            raise unknown(f"table of {self._name}", table, self)
        return OpenTable(found, self._work.table(self._name, "samples"))

    def __iter__(self) -> Iterator[str]:
        return iter(self._work.tables(self._name))

    def __len__(self) -> int:
        return len(self._work.tables(self._name))

    def __repr__(self) -> str:
        return f"<dataset {self._name}: {', '.join(self)}>"


class OpenWork(Mapping[str, OpenDataset]):
    """The datasets of a work dir, by name."""

    def __init__(self, work: WorkDir):
        self._work = work

    def __getitem__(self, dataset: str) -> OpenDataset:
        if dataset not in self._work.datasets():
            raise unknown("dataset in this work dir", dataset, self)
        return OpenDataset(self._work, dataset)

    def __iter__(self) -> Iterator[str]:
        return iter(self._work.datasets())

    def __len__(self) -> int:
        return len(self._work.datasets())

    def __repr__(self) -> str:
        return f"<work dir {self._work.store.location}: {', '.join(self)}>"


def open_work(location: str | os.PathLike[str]) -> OpenWork:
    """Opens a work dir for reading: `open_work("work")["nyuv2"]["captions/occupancy"].to_pandas()`.

    location : a folder, or the address of an object store such as s3://bucket/prefix.

    Raises RsaDataError when it holds no dataset.
    """
    work = WorkDir(os.fspath(location))
    if not work.datasets():
        raise RsaDataError(f"{work.store.location}: expected a work dir; found no dataset in it")
    return OpenWork(work)


def write_captions(
    segments: Sequence[Sequence[Mapping[str, Any] | tuple[str, float]]],
    *,
    style: str = "occupancy",
    variants: int = 1,
    seed: int = 0,
    **options: Any,
) -> list[list[str]]:
    """Captions of images from what they show, as `rsa-data captions` writes them.

    Parameters
    ----------
    segments : for each image its objects: (label, area) or a mapping with `label`, `area` (share of
        the image, 0 to 1) and, where the style needs them, `box` (x1, y1, x2, y2 in px), `score`
        and `is_thing`.
    style : a wording of `rsa-data list styles`, or `module:attribute` of your own.
    variants : captions of each image; the first is the plain one.
    seed : of the other variants, which leave objects out or change their order.
    options : other options of `rsa-data captions`, such as `digits` or `tokenizer`.

    Returns a list of `variants` texts for each image.
    """
    from ..captions import write
    from ..common import entries
    from ..common.options import call

    entries.allow([style])
    found = [[_segment(s) for s in image] for image in segments]
    ids = [f"notebook/train/{k}" for k in range(len(found))]
    asked = {"style": style, "variants": variants, "seed": seed, **options}
    step = call(write.build, **asked)
    texts = step(_segments_table(ids, found), _samples_table(ids))["text"].to_pylist()
    return [texts[k * variants : (k + 1) * variants] for k in range(len(found))]


def embed_texts(
    texts: Sequence[str], *, encoder: str = "clip-rn50", encoder_weights: Path | None = None
) -> np.ndarray:
    """Features of texts, float32 (n, dim), raw, as `rsa-data embed` computes them.

    encoder : a name of `rsa-data list encoders`, or `module:attribute` of your own.
    encoder_weights : file or folder of its weights, instead of the download.
    """
    from ..common import entries
    from ..embeddings import embed

    entries.allow([encoder])
    if isinstance(texts, str):
        raise UsageError("embed_texts: expected a list of texts, found one text")
    if not len(texts):
        raise UsageError("embed_texts: expected at least one text, found none")
    return embed.encode(list(texts), encoder=encoder, encoder_weights=encoder_weights)


def predict_depth(
    image: np.ndarray | str | os.PathLike[str],
    *,
    head: ScaleHead | str | os.PathLike[str],
    caption: str | None = None,
    relative: np.ndarray | None = None,
    segments: str | None = None,
    segmenter_weights: Path | None = None,
    encoder_weights: Path | None = None,
    depth_weights: Path | None = None,
) -> np.ndarray:
    """Metric depth of one image, float32 (height, width), m; inf where it is beyond everything.

    Parameters
    ----------
    image : uint8 (height, width, 3), RGB, or an image file.
    head : a ScaleHead, or the folder that holds one, such as work/heads/NAME.
    caption : what the image shows, instead of a caption from the head's segmenter.
    relative : float (height, width), raw output of the head's depth model, instead of running it.
    segments, segmenter_weights : the segmenter, and the file of its weights.
    encoder_weights, depth_weights : files of the text encoder's and the depth model's weights.
    """
    from PIL import Image

    from ..heads.belong import encode
    from ..heads.checkpoint import ScaleHead
    from ..heads.metric import to_metric
    from ..heads.predict.choices import Models
    from ..heads.predict.images import describer, relative_map, relative_source

    if not isinstance(head, ScaleHead):
        head = ScaleHead.load(os.fspath(head))
    about = head.description
    models = Models(
        segments=segments, segmenter_weights=segmenter_weights, depth_weights=depth_weights
    )
    with tempfile.TemporaryDirectory() as folder:
        if isinstance(image, np.ndarray):
            if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
                raise UsageError(
                    "predict_depth: image: expected uint8 (height, width, 3), RGB; found "
                    f"{image.dtype} {image.shape}"
                )
            place = Path(folder) / "image.png"
            Image.fromarray(image).save(place)
        else:
            place = Path(image)
        if caption is None:
            caption = describer(about, place.parent, models)(place.name)[1]
        if relative is None:
            with Image.open(place) as opened:
                size = opened.height, opened.width
            source = relative_source(about, place.parent, models)
            relative = relative_map(source, place.name, size)
    scale, shift = head(encode(about["features"], [caption], encoder_weights))
    depth: np.ndarray = to_metric(np.asarray(relative), float(scale[0]), float(shift[0]))
    return depth


def _array(value: bytes | None, dtype: Any, shape: tuple[int, int] | None = None) -> Any:
    if value is None:
        return None
    found = np.frombuffer(value, dtype)
    return found.reshape(shape) if shape is not None else found


def _segment(given: Mapping[str, Any] | tuple[str, float]) -> dict[str, Any]:
    """One object with every field that it may have."""
    known = {"score": 1.0, "is_thing": True, "box": None}
    if isinstance(given, Mapping):
        strange = set(given) - {"label", "area", *known}
        if strange or not {"label", "area"} <= set(given):
            raise UsageError(
                "write_captions: expected label, area and maybe box, score and is_thing; found "
                f"{', '.join(given)}"
            )
        return {**known, **given}
    label, area = given
    return {**known, "label": label, "area": area}


def _segments_table(ids: list[str], images: list[list[dict[str, Any]]]) -> pa.Table:
    n = len(ids)
    boxes = [[s["box"] for s in image] for image in images]
    columns: dict[str, Any] = {name: [None] * n for name in schemas.schema("segments").names}
    columns |= {"sample_id": ids, "status": ["ok"] * n}
    columns |= {
        name: [[s[name] for s in image] for image in images]
        for name in ("label", "score", "area", "is_thing")
    }
    columns["box"] = [None if any(b is None for b in found) else found for found in boxes]
    columns["center"] = [
        None if b is None else [((x0 + x1) / 2, (y0 + y1) / 2) for x0, y0, x1, y1 in b]
        for b in columns["box"]
    ]
    return schemas.from_columns("segments", columns)


def _samples_table(ids: list[str]) -> pa.Table:
    n = len(ids)
    columns: dict[str, Any] = {name: [None] * n for name in schemas.schema("samples").names}
    columns |= {"sample_id": ids, "dataset": ["notebook"] * n, "split": ["train"] * n}
    return schemas.from_columns("samples", columns | {"scene": ["."] * n})

"""Work dirs whose tables are written straight from arrays: for tests and benchmarks of the head."""

import hashlib

import numpy as np

from rsa_data.store import schemas as tables
from rsa_data.store.tables import Description, Made, WorkDir

ENCODER = {"encoder": "minilm", "store": "float16", "normalize": False, "threads": 2}
DEPTH = {"depth_model": "files", "files_hold": "relative", "geometry": None, "crop": "none"}


def text_id(text: str) -> bytes:
    return hashlib.blake2b(text.encode(), digest_size=16).digest()


def write(
    work: WorkDir,
    dataset: str,
    *,
    scenes: list[str],
    texts: list[list[str]],
    features: dict[str, np.ndarray],
    relative: np.ndarray,
    metric: np.ndarray,
    split: str = "train",
    builder: str | None = None,
    part: int = 1000,
    first_part: int = 0,
    encoder: dict = ENCODER,
    depth: dict = DEPTH,
    failed: tuple[int, ...] = (),
    size: tuple[int, int] | None = None,
    n_valid: list[int] | None = None,
    covers: tuple[int, int] | None = None,
) -> None:
    """Writes samples, captions/occupancy, embeddings/occupancy/minilm and depth/files.

    scenes, texts : of each image, its variants. features : of each text. relative, metric : (n, k).
    builder : dataset whose depth range holds, by default `dataset`. failed : rows without depth.
    size : height and width, when the k values are whole maps, as test splits have them.
    n_valid, covers : of each image, and height and width of all, where the k values are pixels.
    """
    names = ("samples", "captions/occupancy", "embeddings/occupancy/minilm", "depth/files")
    made = {name: work.table(dataset, name) for name in names}
    options: list[dict] = [{"dataset": builder or dataset}, {"style": "occupancy"}, encoder, depth]
    inputs = [[], ["samples"], ["captions/occupancy"], ["samples"]]
    schemas = ("samples", "captions", "embeddings", "depth")
    for table, option, source, schema in zip(made.values(), options, inputs, schemas, strict=True):
        about = {"schema": schema, "options": option, "inputs": source, "files": {}}
        table.bind(Description(stage=schema, **about))
    for number, start in enumerate(range(0, len(scenes), part), first_part):
        rows = range(start, min(start + part, len(scenes)))
        ids = [f"{dataset}/{split}/{row:06d}" for row in rows]
        blank = dict.fromkeys(tables.schema("samples").names)
        samples = [
            blank
            | {"sample_id": i, "dataset": dataset, "split": split, "scene": scenes[row]}
            | {"image": f"{split}/{row:06d}.jpg"}
            for i, row in zip(ids, rows, strict=True)
        ]
        variants = [
            {"sample_id": i, "variant": v, "text": text, "text_id": text_id(text)}
            | {"n_objects": 1, "n_kept": 1, "n_tokens": 5, "area": 1.0, "area_kept": 1.0}
            for i, row in zip(ids, rows, strict=True)
            for v, text in enumerate(texts[row])
        ]
        distinct = list(dict.fromkeys(v["text"] for v in variants))
        blank = dict.fromkeys(tables.schema("depth").names)
        depths = [
            blank | {"sample_id": i, "status": "failed", "error": "no valid pixel"}
            if row in failed
            else blank
            | {"sample_id": i, "status": "ok", "kind": "pixels", "n_valid": 9999, "repeated": False}
            | (dict(zip(("height", "width"), size, strict=True), kind="map") if size else {})
            | ({"n_valid": n_valid[row]} if n_valid else {})
            | (dict(zip(("height", "width"), covers, strict=True)) if covers else {})
            | {
                "relative": relative[row].astype("<f2").tobytes(),
                "metric": metric[row].astype("<f2").tobytes(),
                **dict(
                    zip(("fit_scale", "fit_shift"), _fit(relative[row], metric[row]), strict=True)
                ),
            }
            for i, row in zip(ids, rows, strict=True)
        ]
        columns = {
            "samples": _columns(samples),
            "captions/occupancy": _columns(variants),
            "embeddings/occupancy/minilm": {
                "text_id": [text_id(text) for text in distinct],
                "embedding": tables.embedding_column(np.stack([features[t] for t in distinct])),
                "n_tokens": [5] * len(distinct),
                "truncated": [False] * len(distinct),
            },
            "depth/files": _columns(depths),
        }
        digests: dict[str, str] = {}
        for (name, table), source, schema in zip(made.items(), inputs, schemas, strict=True):
            content = tables.from_columns(schema, columns[name])
            receipt = {"ok": len(rows), "failed": 0, "skipped": 0, "split": split}
            receipt |= {"inputs": {n: digests[n] for n in source}, "fingerprint": "made"}
            digests[name] = table.commit(number, content, Made(**receipt)).digest


def _columns(rows: list[dict]) -> dict[str, list]:
    return {name: [row[name] for row in rows] for name in rows[0]}


def _fit(y: np.ndarray, depth: np.ndarray) -> tuple[float, float]:
    y, depth = y[depth > 0], depth[depth > 0]
    design = np.stack([y, np.ones_like(y)], 1).astype(np.float64)
    scale, shift = np.linalg.lstsq(design, 1 / depth.astype(np.float64), rcond=None)[0]
    return float(scale), float(shift)

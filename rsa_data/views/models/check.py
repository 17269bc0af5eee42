"""models check: each model's file, run on two rendered scenes, held against what must be true."""

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ...common.digests import read_sha256
from ...common.errors import RsaDataError
from ...common.model_files import MissingFile, local_file
from ...datasets.synthetic import scenes
from ...runner.fingerprints import made_with
from ..pictures.pictures import save
from . import listing

# Things that no picture of the other kind shows: large and sure, they tell of a wrong input.
_NOT_IN_STREETS = {"bed", "couch", "toilet", "oven", "refrigerator", "sink", "microwave"}
_NOT_IN_ROOMS = {"car", "bus", "train", "truck", "traffic light", "airplane", "boat"}
_LARGE, _SURE = 0.1, 0.6
# A room with a couch and a floor, a street with cars and a road.
_SCENE = 3


@dataclass(frozen=True)
class Finding:
    """One thing that must be true, and what was found."""

    what: str
    ok: bool
    found: str


@dataclass
class Result:
    """What came of one model: ok, failed, or missing with the reason."""

    name: str
    kind: str
    state: str
    sha256: str = ""
    reason: str = ""
    findings: list[Finding] = field(default_factory=list)


@dataclass(frozen=True)
class Scene:
    """A rendered scene: where its picture lies, and which pixels are its floor or road."""

    path: Path
    outdoors: bool
    ground: np.ndarray
    depth: np.ndarray


def check(
    wanted: Sequence[str] = (),
    weights: Mapping[str, Path] | None = None,
    report: Callable[[Result], None] = lambda result: None,
) -> dict[str, Any]:
    """Runs the models asked for, or all; report : called with each result.

    weights : files by model name, instead of the cache and the download.
    Returns what was run as plain values: versions, and each model's digest and findings.
    """
    results = []
    with tempfile.TemporaryDirectory() as folder:
        pair = [_scene(Path(folder), False), _scene(Path(folder), True)]
        for entry in listing.entries(wanted):
            card, kind = entry.card, entry.card.kind or ""
            result = Result(card.name, kind, "ok")
            try:
                path = local_file(card, (weights or {}).get(card.name), option=None)
            except MissingFile:
                result.state, result.reason = "missing", "its file is not on this machine"
            except RsaDataError as error:
                result.state, result.reason = "failed", str(error)
            else:
                result.sha256 = read_sha256(path)
                try:
                    result.findings = list(_CHECKS[kind](card.name, path, pair))
                    bad = [f for f in result.findings if not f.ok]
                    result.state = "failed" if bad else "ok"
                    result.reason = "; ".join(f"{f.what}: {f.found}" for f in bad)
                except RsaDataError as error:
                    result.state, result.reason = "failed", str(error)
            results.append(result)
            report(result)
    return {"made_with": made_with(), "models": [asdict(result) for result in results]}


def _scene(folder: Path, outdoors: bool) -> Scene:
    (shot,) = scenes.shoot(scenes.STREET if outdoors else scenes.INDOOR, (0, 1, _SCENE), 1)
    path = folder / ("street.png" if outdoors else "room.png")
    save(shot.image, path)
    ground = [k + 1 for k, label in enumerate(shot.labels) if label in ("floor", "road")]
    return Scene(path, outdoors, np.isin(shot.segments, ground), shot.depth)


def _segments(name: str, path: Path, pair: Sequence[Scene]) -> Iterator[Finding]:
    import pyarrow as pa

    from ...datasets.folder import folder
    from ...segments import detect
    from ...store import schemas

    columns = schemas.schema("samples")
    blank = dict.fromkeys(columns.names) | {"dataset": "folder", "split": "test", "scene": "."}
    rows = [blank | {"sample_id": s.path.name, "image": s.path.name} for s in pair]
    step = detect.build(
        dataset=folder(), root=pair[0].path.parent, segments=name, segmenter_weights=path
    )
    for scene, row in zip(pair, step(pa.Table.from_pylist(rows, columns)).to_pylist(), strict=True):
        where = scene.path.stem
        yield Finding(f"{where} is processed", row["status"] == "ok", row["error"] or "ok")
        scores, areas = np.array(row["score"]), np.array(row["area"])
        good = bool(((scores >= 0) & (scores <= 1)).all() and ((areas > 0) & (areas <= 1)).all())
        yield Finding(f"{where}: scores and shares are 0 to 1", good, f"{len(scores)} segments")
        if row["box"] is None:
            total = float(areas.sum())
            yield Finding(f"{where}: shares sum to at most 1", total <= 1 + 1e-6, f"{total:.3f}")
        odd = _NOT_IN_STREETS if scene.outdoors else _NOT_IN_ROOMS
        wrong = [
            f"{label} {area:.0%}"
            for label, area, score in zip(row["label"], areas, scores, strict=True)
            if label in odd and area > _LARGE and score > _SURE
        ]
        shown = ", ".join(wrong) or ", ".join(sorted(set(row["label"]))) or "nothing"
        yield Finding(f"{where}: nothing large that cannot be there", not wrong, shown)


def _depth(name: str, path: Path, pair: Sequence[Scene]) -> Iterator[Finding]:
    from ...heads.predict.choices import Models
    from ...heads.predict.images import relative_map, relative_source

    source = relative_source({}, pair[0].path.parent, Models(depth_model=name, depth_weights=path))
    for scene in pair:
        where = scene.path.stem
        y = relative_map(source, scene.path.name, scene.depth.shape)
        there = np.isfinite(y)
        yield Finding(f"{where}: depth is defined", bool(there.mean() > 0.4), f"{there.mean():.0%}")
        spread = float(np.ptp(y[there])) if there.any() else 0.0
        yield Finding(f"{where}: depth differs", spread > 0, f"{spread:.4g}")
        rows = np.nonzero(scene.ground & there)[0]
        if len(rows) < 100:
            yield Finding(f"{where}: ground is seen", False, f"{len(rows)} pixels")
            continue
        low, high = np.quantile(rows, [0.25, 0.75])
        ground = scene.ground & there
        index = np.arange(len(y))[:, None]
        near = float(np.median(y[ground & (index >= high)]))
        far = float(np.median(y[ground & (index <= low)]))
        yield Finding(
            f"{where}: ground is nearer at the bottom", near > far, f"{near:.4g}, {far:.4g}"
        )


def _encoder(name: str, path: Path, pair: Sequence[Scene]) -> Iterator[Finding]:
    from ... import registry
    from ...datasets.images import read_image
    from ...embeddings import embed_images, frozen

    texts = ["a room with furniture", "a street with cars"]
    features = frozen.encode(texts, encoder=name, encoder_weights=path)
    finite = bool(np.isfinite(features).all() and features.any(1).all())
    yield Finding("features of texts are finite", finite, f"{features.shape[1]} numbers")
    if name not in registry.IMAGE_ENCODERS:
        return
    seen = embed_images.encode(
        [read_image(s.path) for s in pair], encoder=name, encoder_weights=path
    )

    def unit(x: np.ndarray) -> np.ndarray:
        scaled: np.ndarray = x / np.linalg.norm(x, axis=1, keepdims=True)
        return scaled

    alike = unit(seen) @ unit(features).T  # (images, texts)
    agree = alike[0, 0] - alike[0, 1] > alike[1, 0] - alike[1, 1]
    yield Finding(
        "texts and images agree in rank", bool(agree), np.array2string(alike, precision=3)
    )


def _head(name: str, path: Path, pair: Sequence[Scene]) -> Iterator[Finding]:
    from ...heads.checkpoint import ScaleHead

    head = ScaleHead.load(path)
    features = np.random.default_rng(0).normal(0, 0.3, (64, head.dim)).astype(np.float32)
    scale, shift = head(features)
    good = bool((np.isfinite(scale) & np.isfinite(shift) & (scale > 0) & (shift > 0)).all())
    yield Finding("scale and shift are above 0", good, f"scale {scale.min():.3g}")


_CHECKS: dict[str, Callable[[str, Path, Sequence[Scene]], Iterator[Finding]]] = {
    "segments": _segments,
    "relative-depth": _depth,
    "text-encoder": _encoder,
    "head": _head,
}


def table(checked: Mapping[str, Any]) -> str:
    """What was run and what came of it, as Markdown; checked : what `check` returned."""
    versions = ", ".join(f"{k} {v}" for k, v in checked["made_with"].items())
    lines = ["| model | kind | run | sha256 |", "|---|---|---|---|"]
    for model in checked["models"]:
        run = {"ok": "yes", "failed": f"failed: {model['reason']}", "missing": "no"}[model["state"]]
        reason = " ".join(run.split())[:200].replace("|", "/")
        lines.append(f"| {model['name']} | {model['kind']} | {reason} | {model['sha256'][:12]} |")
    return "\n".join([*lines, "", f"With {versions}.", ""])

"""What the features hold: their map in two components, and the scale and shift a head makes."""

import re
from dataclasses import dataclass

import numpy as np
import pyarrow.compute as pc

from ...common.errors import RsaDataError
from ...common.html import Html, tag
from ...evaluation.inputs import TestPart
from ...heads.checkpoint import ScaleHead
from ...store.tables import WorkDir
from . import plots
from .lineage import head_description, head_names, left_out
from .words import spread

_POINTS, _PARTS, _TYPES = 900, 4, 24


@dataclass(frozen=True)
class Features:
    """Features of the plain captions of a sample of images.

    rows : dataset, scene and caption (or sample_id) of each. values : float32 (n, dim).
    """

    rows: list[tuple[str, str, str]]
    values: np.ndarray


def meaning(work: WorkDir) -> Html:
    """A section: for each kind of features a map, and scale and shift by type of scene."""
    kinds = sorted(
        {
            name
            for dataset in work.datasets()
            for name in work.tables(dataset)
            # Proposals are a list of features an image: there is no point to draw.
            if name.startswith("embeddings/")
            and name.split("/")[1] not in ("proposals", "objects")  # several rows an image
            and work.table(dataset, name).parts()
        }
    )
    drawn: list[Html] = []
    for kind in kinds:
        found = sample(work, kind)
        if len(found.rows) < 3:
            continue
        drawn += _map(kind, found, _heads_of(work, kind))
    nothing = tag("p", "There are no embeddings in this work dir yet.")
    return tag("section", tag("h2", "Features, scale and shift"),
               tag("div", drawn or nothing, class_="plots"), id="features")  # fmt: skip


def sample(work: WorkDir, kind: str) -> Features:
    """Features of at most 900 images, as many of each dataset, evenly over its parts."""
    rows: list[tuple[str, str, str]] = []
    values = []
    datasets = [d for d in work.datasets() if kind in work.tables(d)]
    for dataset in datasets:
        numbers = spread(work.table(dataset, kind).parts(), _PARTS)
        for number in numbers:
            part = TestPart(work, dataset, number, depth="")
            style = kind.split("/")[1]
            captions = None if style == "images" else f"captions/{style}"
            features, there = part.features(kind, captions)
            told = _plain(work, dataset, captions, number) if captions else {}
            most = max(_POINTS // (len(datasets) * len(numbers)), 1)
            chosen = spread(np.flatnonzero(there).tolist(), most)
            values.append(features[chosen])
            for k in chosen:
                s = part.samples[k]
                words = told.get(s["sample_id"], s["sample_id"])
                rows.append((dataset, s["scene"], words))
    return Features(rows, np.concatenate(values) if values else np.zeros((0, 1), np.float32))


def _plain(work: WorkDir, dataset: str, captions: str, number: int) -> dict[str, str]:
    """The plain caption of each sample of a part."""
    texts = work.table(dataset, captions).read(number, ["sample_id", "variant", "text"])
    texts = texts.filter(pc.equal(texts["variant"], 0))
    return dict(zip(texts["sample_id"].to_pylist(), texts["text"].to_pylist(), strict=True))


def _heads_of(work: WorkDir, kind: str) -> list[tuple[str, ScaleHead]]:
    """Heads that were trained on this kind of features, controls left out."""
    _, style, encoder = kind.split("/")
    found = []
    for name in head_names(work):
        about = head_description(work, name)
        features = about.get("features", {})
        control = about.get("options", {}).get("control", "none")
        same = (features.get("style"), features.get("encoder")) == (style, encoder)
        if same and control == "none" and "images" not in features:
            try:
                found.append((name, ScaleHead.load(f"{work.store.location}/heads/{name}")))
            except RsaDataError as error:
                left_out(name, error)
    return found


def components(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The first two principal components (n, 2) of values (n, dim), and their shares of variance.

    The sign of a component is chosen so that its largest loading is positive.
    """
    centred = values.astype(np.float64) - values.mean(0)
    _, s, v = np.linalg.svd(centred, full_matrices=False)
    v = v[:2] * np.sign(v[:2][np.arange(len(v[:2])), np.abs(v[:2]).argmax(1)])[:, None]
    share = s**2 / max(float((s**2).sum()), 1e-12)
    return centred @ v.T, share[:2]


def _map(kind: str, found: Features, heads: list[tuple[str, ScaleHead]]) -> list[Html]:
    places, share = components(found.values)
    hints = [f"{dataset}, {scene}: {text}" for dataset, scene, text in found.rows]
    across, up = (f"principal component {k + 1} ({share[k]:.0%} of the variance)" for k in (0, 1))
    what = "images" if kind.startswith("embeddings/images/") else "plain captions"
    title = f"{kind}: {len(hints):,} {what}"
    datasets = [row[0] for row in found.rows]
    drawn = [plots.scatter(f"{title}, by dataset", places, across, up, hints, group=datasets)]
    for name, head in heads:
        if head.dim != found.values.shape[1]:
            continue
        scale, shift = head(found.values)
        unit = "predicted scale (1/m per unit of relative depth)"
        drawn.append(
            plots.scatter(f"{title}, by scale of the head {name}", places, across, up, hints,
                        colour=(scale, unit))
        )  # fmt: skip
        types = [scene_type(dataset, scene) for dataset, scene, _ in found.rows]
        for values, what in ((scale, unit), (shift, "predicted shift (1/m)")):
            word = what.split(" (")[0]
            named = _by_type(types, values)
            drawn.append(plots.ranges(
                f"head {name}: {word} by type of scene, median and 10% to 90%",
                [n for n, _ in named], [s for _, s in named], what,
            ))  # fmt: skip
    return drawn


def scene_type(dataset: str, scene: str) -> str:
    """What kind of place a scene is: its name without numbers, below the dataset's name."""
    words = re.sub(r"[\d_\-./ ]*\d.*$", "", scene).strip("/_- ")
    return dataset if not words or scene == dataset else f"{dataset}: {words}"


def _by_type(types: list[str], values: np.ndarray) -> list[tuple[str, tuple[float, float, float]]]:
    names = np.array(types)
    found = []
    for name in sorted(set(types), key=lambda n: -types.count(n))[:_TYPES]:
        low, middle, high = np.quantile(values[names == name], [0.1, 0.5, 0.9])
        found.append((name, (float(low), float(middle), float(high))))
    return sorted(found, key=lambda item: -item[1][1])

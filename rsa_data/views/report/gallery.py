"""The gallery: a card a sample: picture, segments, captions, depth, prediction and error."""

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ...common import html
from ...common.errors import RowError, TransientError
from ...common.html import Html, tag
from ...datasets.images import read_image
from ...segments.segments import Segments
from ...store.tables import WorkDir
from ..pictures.colours import depth_colours, error_colours, range_of, round_up
from ..pictures.drawing import scatter
from ..pictures.pictures import draw_segments
from .samples import Sample, choose

# Bytes of pictures in a page, so that the whole stays below 10 MB.
_BUDGET = 7_500_000
_WIDTH, _MAP = 420, 260
# More boxes than this hide the picture.
_DRAWN = 12


def gallery(
    work: WorkDir, count: int, head: str | None, bar: Callable[[str, int], Any] | None
) -> Html:
    """A section with a form that filters, and a card for each of about `count` samples."""
    datasets = work.datasets()
    samples = [
        sample
        for dataset in datasets
        for sample in choose(work, dataset, -(-count // len(datasets)), head)
    ]
    shown = bar("pictures", len(samples)) if bar else None
    cards, used = [], 0
    for sample in samples:
        card = _card(sample, with_pictures=used < _BUDGET)
        used += len(card)
        cards.append(card)
        if shown:
            shown.update(1)
    if shown:
        shown.close()
    return tag(
        "section",
        tag("h2", "Samples"),
        tag("p", f"{len(cards):,} samples, evenly over the parts, failed ones before others. Depth "
            "is shown where whole maps are stored, as for test splits; of training images the "
            "pixels that were drawn are shown, their relative depth against 1 / depth. Truth and "
            "prediction of a sample have one scale of colours, from the "
            "2nd to the 98th percentile of the truth; errors are prediction - truth."),
        _filters(samples),
        tag("p", f"{len(cards)} of {len(cards)} samples shown", id="shown", role="status"),
        tag("div", cards, class_="cards"),
        id="samples",
    )  # fmt: skip


def _filters(samples: list[Sample]) -> Html:
    classes = Counter(c for s in samples for c in _classes(s))
    return tag(
        "form",
        _select("dataset", [s.row["dataset"] for s in samples]),
        _select("split", [s.row["split"] for s in samples]),
        _select("scene", [s.row["scene"] for s in samples]),
        _select("class", list(classes)),
        tag("label", "Words ", tag("input", type="search", name="words", size="14")),
        tag("label", tag("input", type="checkbox", name="failed"), " only failures"),
        tag("button", "Show all", type="reset"),
        id="filters", aria_label="Filter the samples",
    )  # fmt: skip


def _select(name: str, values: list[str]) -> Html:
    options = [tag("option", "all", value="")]
    options += [tag("option", v, value=v) for v in sorted(set(values))]
    return tag("label", f"{name.capitalize()} ", tag("select", options, name=name))


def _classes(sample: Sample) -> list[str]:
    return list(dict.fromkeys(sample.segments.label)) if sample.segments else []


def _card(sample: Sample, with_pictures: bool) -> Html:
    row = sample.row
    facts = [row["dataset"], row["split"], f"scene {row['scene']}"]
    if sample.scale is not None:
        facts.append(f"head {sample.head}: scale {sample.scale:.4g} 1/m per unit of relative "
                     f"depth, shift {sample.shift:.4g} 1/m")  # fmt: skip
    words = " ".join([row["sample_id"], *sample.captions, *sample.failures]).lower()
    return tag(
        "article",
        tag("h3", row["sample_id"]),
        [tag("p", f"failed: {reason}", class_="failure") for reason in sample.failures],
        tag("div", _pictures(sample), class_="pictures") if with_pictures else "",
        [tag("p", caption, class_="caption") for caption in sample.captions],
        tag("p", " · ".join(facts), class_="note"),
        class_="card wide" if sample.truth is not None else "card",
        data_dataset=row["dataset"], data_split=row["split"], data_scene=row["scene"],
        data_class="|" + "|".join(_classes(sample)) + "|",
        data_failed="yes" if sample.failures else "no",
        data_words=words,
    )  # fmt: skip


def _pictures(sample: Sample) -> list[Html]:
    return [_image(sample), *_maps(sample)]


def _image(sample: Sample) -> Html:
    if sample.where is None or sample.row["image"] is None:
        return tag("p", "No picture: the dataset's files are not at hand.", class_="missing")
    try:
        pixels = read_image(sample.where / sample.row["image"])
    except (RowError, TransientError) as error:
        reason = re.sub(r"^.*/", "", str(error))
        return tag("p", f"No picture: {reason}", class_="missing")
    alt = f"Photo {sample.row['sample_id']}"
    segments = _largest(sample.segments)
    name = "photo"
    if segments is not None:
        pixels = draw_segments(pixels, segments, masks=_masks(segments), width=640)
        shares = zip(segments.label, segments.area, strict=True)
        alt += " with its segments: " + ", ".join(f"{name} {share:.0%}" for name, share in shares)
        count = len(sample.segments.label) if sample.segments else 0
        name = "photo and segments" + (f", the {_DRAWN} largest of {count}" * (count > _DRAWN))
    return _shown(html.picture(pixels, alt, _WIDTH), name)


def _largest(segments: Segments | None) -> Segments | None:
    """The largest segments, or None where there are none."""
    if segments is None or not len(segments.label):
        return None
    rows = np.argsort(-segments.area, kind="stable")[:_DRAWN]
    return replace(
        segments,
        label=[segments.label[k] for k in rows],
        area=segments.area[rows],
        score=segments.score[rows],
        is_thing=segments.is_thing[rows],
        box=None if segments.box is None else segments.box[rows],
        mask=None if segments.mask is None else [segments.mask[k] for k in rows],
    )


def _masks(segments: Segments) -> list[np.ndarray] | None:
    if segments.mask is None:
        return None
    try:
        from pycocotools import mask as coco
    except ImportError:
        return None  # boxes show where things are, too

    size = [segments.height, segments.width]
    return [
        coco.decode({"size": size, "counts": counts.encode()}).astype(bool)
        for counts in segments.mask
    ]


def _maps(sample: Sample) -> list[Html]:
    truth = sample.truth
    if sample.points is not None:
        return _points(sample, sample.points)
    if truth is None or not (truth > 0).any():
        return []
    valid = truth > 0
    span = range_of(truth)
    ends = (f"{span.low:g}", f"{span.high:g} m")
    low, high = np.percentile(truth[valid], [2, 98])
    found = [_map(depth_colours(truth, span.high, span.low),
                  f"True depth, mostly {low:.2g} to {high:.2g} m",
                  "true depth", "depth", ends)]  # fmt: skip
    if sample.predicted is None:
        return found
    predicted = np.where(np.isnan(sample.predicted), 0, np.minimum(sample.predicted, 1e4))
    seen = predicted[predicted > 0]
    low, high = np.percentile(seen, [2, 98]) if len(seen) else (0, 0)
    error = np.where(valid & (predicted > 0), predicted - truth, np.nan)
    known = np.abs(error[np.isfinite(error)])
    most = round_up(float(np.percentile(known, 95))) if len(known) else 1.0
    rel = float(np.nanmean(np.abs(error[valid]) / truth[valid])) if len(known) else float("nan")
    found.append(_map(depth_colours(predicted, span.high, span.low),
                      f"Predicted depth, mostly {low:.2g} to {high:.2g} m",
                      "predicted depth", "depth", ends))  # fmt: skip
    found.append(
        _map(
            error_colours(error, most),
            f"Error of the depth; mean of |error| / depth is {rel:.3f}",
            f"error, AbsRel {rel:.3f}",
            "error",
            (f"-{most:g}", f"+{most:g} m"),
        )
    )
    return found  # fmt: skip


def _points(sample: Sample, points: np.ndarray) -> list[Html]:
    """Pixels that were drawn for training: relative depth against 1 / depth, and the own fit."""
    y, metric = points[np.isfinite(points).all(1) & (points[:, 1] > 0)].T
    if not len(y):
        return []
    span = range_of(metric)
    colours = depth_colours(metric[None], span.high, span.low)[0]
    pixels = scatter(y, 1 / metric, colours, sample.fit)
    low, high = np.percentile(metric, [2, 98])
    alt = (
        f"Relative depth (across) against 1 / depth (up) of {len(y):,} pixels, mostly {low:.2g} to "
        f"{high:.2g} m" + (", with the line of the image's own fit" if sample.fit else "")
    )
    return [_map(pixels, alt, f"{len(y):,} sampled pixels: y against 1 / depth", "depth",
                 (f"{span.low:g}", f"{span.high:g} m"))]  # fmt: skip


def _map(pixels: np.ndarray, alt: str, name: str, ramp: str, ends: tuple[str, str]) -> Html:
    legend = tag("span", ends[0], " ", tag("span", class_=f"ramp {ramp}"), " ", ends[1])
    return _shown(html.picture(pixels, alt, _MAP, 68), name, legend)


def _shown(image: Html, name: str, legend: Html | str = "") -> Html:
    return tag("figure", image, tag("figcaption", name, tag("br") if legend else "", legend))

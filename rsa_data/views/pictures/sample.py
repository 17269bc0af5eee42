"""The picture of one sample: what every stage has made of it."""

from pathlib import Path

import numpy as np

from ...common.errors import RsaDataError
from ...datasets.images import read_image
from ...datasets.index import load_dataset
from ...store.outputs import check_output, identities
from ...store.tables import WorkDir
from ..report.samples import Sample, one
from .colours import depth_colours, error_colours, range_of, round_up
from .pictures import save
from .segments import draw_segments, segment_grid


def draw(work: WorkDir, sample_id: str, head: str | None, out: Path) -> list[str]:
    """Writes the picture of a sample to `out`; returns what the tables know of it, in lines.

    Raises RsaDataError when the image is not at hand.
    """
    check_output(out, "--out")
    sample = one(work, sample_id, head)
    dataset = load_dataset(work, sample.row["dataset"])
    lines = [f"{sample_id}: split {sample.row['split']}, scene {sample.row['scene']}"]
    lines += [f"failed: {failure}" for failure in sample.failures]
    lines += sample.captions
    if sample.scale is not None:
        lines.append(f"head {sample.head}: scale {sample.scale:.4g}, shift {sample.shift:.4g} 1/m")
    if sample.where is None or sample.row["image"] is None:
        raise RsaDataError(
            f"{sample_id}: its image is not at hand: give the commands --root once, so that the "
            "work dir knows where the files lie. Its captions: " + " | ".join(sample.captions)
        )
    read = [sample.where / sample.row[name] for name in ("image", "depth") if sample.row[name]]
    check_output(out, "--out", identities(file for file in read if isinstance(file, Path)))
    image = read_image(sample.where / sample.row["image"])
    cells = [(image, sample_id)]
    if sample.segments is not None:
        cells.append((draw_segments(image, sample.segments), "segments, share of the image"))
    truth = sample.truth
    if truth is None and sample.row["depth"] is not None:
        truth = dataset.read_depth(sample.where / sample.row["depth"])
    if truth is not None:
        cells += _depths(sample, truth)
    if sample.captions:
        name, text = cells[0][1], sample.captions[0]
        cells[0] = (cells[0][0], f"{name}\n{text}")
    save(segment_grid(cells, columns=2), out)
    return lines


def _depths(sample: Sample, truth: np.ndarray) -> list[tuple[np.ndarray, str]]:
    """True depth, predicted depth on the same colours, and the difference."""
    span = range_of(truth)
    told = f"{span.low:g} to {span.high:g} m"
    cells = [(depth_colours(truth, span.high, span.low), f"true depth, {told}")]
    if sample.predicted is not None:
        error = np.where(truth > 0, sample.predicted - truth, np.nan)
        there = np.abs(error[truth > 0])
        most = round_up(float(np.percentile(there, 98))) if len(there) else 1.0
        colours = depth_colours(sample.predicted, span.high, span.low)
        cells.append((colours, f"predicted depth, {told}"))
        cells.append((error_colours(error, most), f"predicted - true, -{most:g} to {most:g} m"))
    return cells

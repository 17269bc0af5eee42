"""Metres from a few known points, without a head: AbsRel on real frames.

    python benchmarks/known_points.py MOSAIC MODEL.onnx [--head HEAD --work WORK]

MOSAIC is a folder with index.json, PLACE/FRAME_rgb.* and PLACE/FRAME_depth.png (uint16, 0 = none,
`depth_units_per_m` of the index). For each frame, 1, 2, 3 and 5 pixels with ground truth are drawn
at random (20 draws); their true depths, each off by 2% as a tape measure is, give scale and shift.
Beside that the frame's own least-squares fit, which is the best any scale and shift can do; and
with --head, which needs captions of the frames, the head alone and corrected by the same points.
Only pixels with relative depth count: tu2020 sees the centre square. Prints a table and writes
benchmarks/results/known_points.md.
"""

import argparse
import json
from collections import defaultdict
from pathlib import Path

import cv2
import numpy as np

from rsa_data.common.errors import RsaDataError
from rsa_data.evaluation.depth_errors import depth_errors
from rsa_data.heads.metric import to_metric
from rsa_data.heads.predict import correction, known_depth
from rsa_data.heads.predict.choices import Models
from rsa_data.heads.predict.images import describer, relative_map, relative_source
from rsa_data.store.tables import WorkDir

COUNTS, DRAWS, TAPE = (1, 2, 3, 5), 20, 0.02


def frames(mosaic: Path) -> list[tuple[str, Path, np.ndarray]]:
    """Place, image and depth in m (0: none) of each frame."""
    found = []
    for entry in json.loads((mosaic / "index.json").read_text("utf-8")):
        stem = mosaic / entry["scene"] / entry["frame"]
        image = next(stem.parent.glob(f"{stem.name}_rgb.*"))
        raw = cv2.imread(f"{stem}_depth.png", cv2.IMREAD_UNCHANGED)
        found.append((entry["scene"], image, raw.astype(np.float32) / entry["depth_units_per_m"]))
    return found


def errors(truth: np.ndarray, depth: np.ndarray, top: float) -> float:
    """AbsRel of a prediction, clipped to the range as evaluation does."""
    return float(depth_errors(truth, depth, min_depth=1e-3, max_depth=top)["abs_rel"])


def measure(
    truth: np.ndarray,
    y: np.ndarray,
    rng: np.random.Generator,
    words: tuple[float, float] | None,
    prior: dict | None,
    top: float,
) -> dict[str, list[float]]:
    """AbsRel by way, of one frame: one value for each draw."""
    from rsa_data.depth.fits import inverse_fit

    truth = np.where(np.isfinite(y), truth, 0)  # the model sees the centre square only
    valid = np.argwhere((truth > 0.1) & (truth < top) & np.isfinite(y))
    rows, columns = valid.T
    z, at = truth[rows, columns], y[rows, columns]
    found: dict[str, list[float]] = defaultdict(list)
    fit = inverse_fit(at, z)
    if fit is not None:
        found["the frame's own fit"].append(errors(truth, to_metric(y, *fit), top))
    if words is not None:
        found["head"].append(errors(truth, to_metric(y, *words), top))
    for _ in range(DRAWS):
        order = rng.permutation(len(z))[: max(COUNTS)]
        metres = z[order] * (1 + TAPE * rng.standard_normal(len(order)))
        for count in COUNTS:
            own_y, own_z = at[order[:count]], metres[:count]
            try:
                alone = known_depth.fit(own_y, own_z)
                pair = (alone.scale, alone.shift)
                found[f"{count} alone"].append(errors(truth, to_metric(y, *pair), top))
            except RsaDataError:
                found[f"{count} refused"].append(1.0)
            if words is not None:
                pair = correction.correct(*words, own_y, own_z, prior)[:2]
                found[f"{count} with the head"].append(errors(truth, to_metric(y, *pair), top))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("mosaic", type=Path)
    parser.add_argument("weights", type=Path)
    parser.add_argument("--depth-model", default="tu2020")
    parser.add_argument("--work", default="work")
    parser.add_argument("--head")
    parser.add_argument("--segments", default="yolox-nano")
    parser.add_argument("--segmenter-weights", type=Path)
    parser.add_argument("--leave-out", action="append", default=[], help="place; may be repeated")
    given = parser.parse_args()
    models = Models(
        segments=given.segments,
        segmenter_weights=given.segmenter_weights,
        depth_model=given.depth_model,
        depth_weights=given.weights,
    )
    head, about = None, {}
    if given.head:
        from rsa_data.heads.predict.find import find
        from rsa_data.heads.predict.from_captions import from_captions

        head = find(WorkDir(given.work), given.head)
        about = head.description
    by_kind: dict[str, dict[str, list[float]]] = {"rooms": {}, "streets": {}}
    counted = {"rooms": 0, "streets": 0}
    rng = np.random.default_rng(0)
    for place, image, truth in frames(given.mosaic):
        if place in given.leave_out:
            continue
        source = relative_source(about, image.parent, models)
        y = relative_map(source, image.name, truth.shape)
        words = None
        if head is not None:
            _, caption = describer(about, image.parent, models)(image.name)
            (p,) = from_captions(head, [caption])
            words = (p.scale, p.shift)
        street = np.median(truth[truth > 0]) > 6
        kind = "streets" if street else "rooms"
        counted[kind] += 1
        frame = measure(truth, y, rng, words, about.get("prior"), 80.0 if street else 10.0)
        for way, values in frame.items():
            by_kind[kind].setdefault(way, []).append(
                float(np.sum(values)) if "refused" in way else float(np.median(values))
            )
    lines = [
        f"Relative depth: {given.depth_model}. Median over frames of the median over {DRAWS} draws;"
        f" known depths are off by {TAPE:.0%}. AbsRel up to 10 m in rooms, 80 m in streets.",
        "",
        "| way | " + " | ".join(f"{k} ({counted[k]} frames)" for k in by_kind) + " |",
        "|---|" + "---:|" * len(by_kind),
    ]
    ways = ["the frame's own fit", "head"]
    ways += [f"{n} {how}" for how in ("alone", "with the head") for n in COUNTS]
    for way in ways:
        cells = [by_kind[kind].get(way) for kind in by_kind]
        if any(cells):
            text = [f"{np.median(c):.3f}" if c else "" for c in cells]
            lines.append(f"| {way} | " + " | ".join(text) + " |")
    for n in COUNTS:
        shares = [
            float(np.sum(by_kind[k].get(f"{n} refused", [0]))) / max(1, counted[k] * DRAWS)
            for k in by_kind
        ]
        if any(shares):
            lines.append(f"| {n} alone, refused | " + " | ".join(f"{s:.0%}" for s in shares) + " |")
    text = "\n".join(lines)
    print(text)
    out = Path(__file__).parent / "results" / "known_points.md"
    out.write_text(f"# Known points\n\nMade by benchmarks/known_points.py.\n\n{text}\n", "utf-8")


if __name__ == "__main__":
    main()

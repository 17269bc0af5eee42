"""The depth stage: samples -> relative depth where the ground truth is, with each image's fits."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
import pyarrow as pa

from .. import registry
from ..common.errors import RowError
from ..common.onnx_sessions import Device
from ..common.options import accepts_old_names
from ..common.prefetch import each
from ..common.ranges import AtOnce, Count
from ..datasets.dataset import Dataset
from ..datasets.roots import readers
from ..datasets.shapes import check_aspect, check_turn
from ..datasets.shards import name_of
from ..runner.stage import Notes, Stage
from ..store import schemas
from . import notes
from .choice import check, entry, files, label
from .fits import inverse_fit, median_scale
from .model import Relative, Source
from .pixels import draw

_FLOAT16_MAX = float(np.finfo(np.float16).max)
_FLOAT16_MIN = float(np.finfo(np.float16).tiny)  # below it digits get lost


@accepts_old_names("depth")
def build(
    *,
    dataset: Dataset,
    root: Path,
    depth_model: str | None = None,
    depth_weights: Path | None = None,
    card: Path | None = None,
    geometry: str | None = None,
    crop: Literal["none", "kb"] = "none",
    files_hold: Literal["relative", "depth"] = "relative",
    pixels: Annotated[int, msgspec.Meta(ge=1, le=2**20)] = 1024,
    seed: Count = 0,
    threads: AtOnce = 1,
    device: Device = "auto",
) -> Callable[[pa.Table], pa.Table]:
    """Runs a relative-depth model, or reads its files, and pairs it with the ground truth.

    Parameters
    ----------
    depth_model : a model of `rsa-data list depth-models`, files:DIR, or files for those that the
        dataset brings. DIR holds DIR/IMAGE.npy or .png for each IMAGE.jpg below the root. With a
        model card of your own, any name that its table shall have.
    depth_weights : file of the model's weights, instead of the download.
    card : model card (TOML) of a model of your own.
    geometry : WIDTHxHEIGHT in px that images are resized to for the model, whatever their shape,
        instead of the model's own way. Part of what a head is trained for: y moves with it.
    crop : what is cut from the image before the model sees it; kb is KITTI's 352x1216 at the
        bottom centre, as BTS and RSA do.
    files_hold : what depth files hold; relative is y itself, depth is metric-like and is inverted.
    pixels : pixels drawn from each training image; test images are stored whole.
    seed : another seed draws other pixels.
    threads : CPU threads of the model in each worker.
    device : where the model runs; auto takes CUDA where onnxruntime has it.
    """
    check(depth_model=depth_model, card=card, device=device)
    name, argument = registry.DEPTH_MODELS.split(depth_model or "")
    source: Source = registry.resolve("depth model", registry.DEPTH_MODELS, entry(name, card))(
        name=name,
        argument=argument,
        dataset=dataset,
        root=root,
        weights=depth_weights,
        card=card,
        geometry=geometry,
        crop=crop,
        holds=files_hold,
        threads=threads,
        device=device,
    )

    def step(samples: pa.Table) -> pa.Table:
        def measured(sample: dict[str, Any]) -> dict[str, Any]:
            whole = sample["split"] in dataset.test_splits
            return _row(sample, dataset, root, source, None if whole else pixels, seed)

        columns = ("sample_id", "split", "image", "depth")
        rows: list[Any] = list(each(measured, samples.select(columns).to_pylist(), readers(root)))
        names = schemas.schema("depth").names
        return schemas.from_columns("depth", {n: [row.get(n) for row in rows] for n in names})

    return step


def _row(
    sample: dict[str, Any],
    dataset: Dataset,
    root: Path,
    source: Source,
    pixels: int | None,
    seed: int,
) -> dict[str, Any]:
    row: dict[str, Any] = {"sample_id": sample["sample_id"]}
    if sample["depth"] is None:
        return row | {"status": "skipped", "error": "no ground-truth depth is listed"}
    try:
        if sample["image"] is None:
            raise RowError("no image is listed, so there is no relative depth")
        try:
            depth = dataset.read_depth(root / sample["depth"])
        except RowError as error:
            raise RowError(f"{name_of(sample['depth'])}: {error}") from error
        relative = source(sample["image"])
        try:
            if relative.image is not None:
                check_aspect(depth.shape, relative.image, "ground truth")
                turn = relative.orientation
                check_turn(depth.shape, relative.image, turn, "ground truth")
            return row | _measure(sample["sample_id"], depth, relative, dataset, pixels, seed)
        except RowError as error:
            raise RowError(f"{name_of(sample['depth'])}: {error}") from error
    except RowError as error:
        return row | {"status": "failed", "error": str(error)}


def _measure(
    sample_id: str,
    depth: np.ndarray,
    relative: Relative,
    dataset: Dataset,
    pixels: int | None,
    seed: int,
) -> dict[str, Any]:
    """The columns of one image whose ground truth and relative depth were both read."""
    depth = np.where(np.isfinite(depth), depth, 0).astype(np.float32)
    height, width = depth.shape
    y = at_size(relative, height, width)
    # What float16 cannot hold would be stored as 0 m, or as a few digits.
    nearest = max(dataset.min_depth, _FLOAT16_MIN)
    valid = (depth > nearest) & (depth < dataset.max_depth)
    valid &= dataset.train_mask(height, width) & ~np.isnan(y)
    if not valid.any():
        found = depth[depth > 0]
        there = (
            f"it goes from {found.min():g} to {found.max():g} m" if len(found) else "it has none"
        )
        raise RowError(
            f"no valid pixel: no ground truth between {nearest:g} and "
            f"{dataset.max_depth:g} m inside the mask where the relative depth is defined; {there}"
        )
    largest = np.nanmax(np.abs(y))
    if largest > _FLOAT16_MAX:
        raise RowError(f"relative depth {largest:g} is too large for float16")
    if 0 < largest < _FLOAT16_MIN:
        raise RowError(
            f"relative depth of at most {largest:g} is too small for float16: multiply it by a "
            "constant, the same for all images"
        )
    if (depth > _FLOAT16_MAX).any():
        raise RowError(f"depth of {depth.max():g} m is too large for float16: is the unit right?")
    y_valid, depth_valid = y[valid], depth[valid]
    fit = inverse_fit(y_valid, depth_valid)
    n_valid = len(y_valid)
    if pixels is not None:
        drawn = draw(n_valid, pixels, seed, sample_id)
    stored = (y, depth) if pixels is None else (y_valid[drawn], depth_valid[drawn])
    return {
        "status": "ok",
        "y_width": relative.y.shape[1],
        "y_height": relative.y.shape[0],
        "width": width,
        "height": height,
        "kind": "map" if pixels is None else "pixels",
        "relative": stored[0].astype("<f2").tobytes(),
        "metric": stored[1].astype("<f2").tobytes(),
        "n_valid": n_valid,
        "repeated": pixels is not None and n_valid < pixels,
        "fit_scale": fit and fit[0],
        "fit_shift": fit and fit[1],
        "median_scale": median_scale(y_valid, depth_valid),
    }


def at_size(relative: Relative, height: int, width: int) -> np.ndarray:
    """y on the pixels of a map of another size, bicubic; NaN outside the box that y covers.

    NaN in y spreads to every pixel that bicubic interpolation would have drawn from it. Bicubic
    overshoots at edges, so y may become negative, as it does in the released code.
    Returns float32 of shape (height, width).
    """
    import cv2

    x0, y0, x1, y1 = np.round(np.multiply(relative.box, (width, height, width, height))).astype(int)
    y: np.ndarray = np.asarray(relative.y, np.float32)
    if y.shape != (y1 - y0, x1 - x0):
        y = cv2.resize(y, (int(x1 - x0), int(y1 - y0)), interpolation=cv2.INTER_CUBIC)
    if y.shape == (height, width):
        return y
    whole = np.full((height, width), np.nan, np.float32)
    whole[y0:y1, x0:x1] = y
    return whole


def settle(options: dict[str, Any], there: dict[str, Any] | None) -> dict[str, Any]:
    """The options without `device` where no model runs, and where the table is older than it."""
    name = registry.DEPTH_MODELS.split(options["depth_model"] or "")[0]
    older = there is not None and "device" not in there and options["device"] == "auto"
    dropped = {"device"} if name == "files" or older else set()
    return {option: value for option, value in options.items() if option not in dropped}


STAGE = Stage(
    name="depth",
    version=1,
    build=build,
    help="""Run a relative-depth model, or read its files.

    The relative depth is stored beside the ground truth; images without any are skipped.

    \b
      rsa-data depth --dataset nyuv2 --depth-model depth-anything-v2-small
      rsa-data depth --dataset nyuv2 --card mine.toml --depth-weights mine.onnx
    """,
    next="train-head",
    schema="depth",
    folder="depth",
    selector="depth_model",
    models=True,
    choices=registry.DEPTH_MODELS,
    label=label,
    local=("depth_weights", "card"),
    files=files,
    notes=Notes(notes.COLUMNS, notes.write),
    check=check,
    settle=settle,
)

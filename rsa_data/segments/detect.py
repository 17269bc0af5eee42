"""The detect stage: samples -> what each image shows, by a model or from existing segments."""

from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, Literal

import pyarrow as pa

from .. import registry
from ..common import options
from ..common.cards import read_card
from ..common.errors import UsageError
from ..common.onnx_sessions import Device
from ..common.ranges import AtOnce, Positive, Share
from ..datasets.dataset import Dataset
from ..datasets.images import MAX_PIXELS
from ..runner.stage import Notes, Stage
from . import notes

Step = Callable[[pa.Table], pa.Table]

DEFAULT = "detr-resnet-50-panoptic"


@options.accepts_old_names("detect")
def build(
    *,
    dataset: Dataset,
    root: Path | None,
    images: Callable[[], Sequence[str]] | None = None,
    segments: str = DEFAULT,
    segmenter_weights: Path | None = None,
    card: Path | None = None,
    names: str | None = None,
    score_threshold: Share | None = None,
    masks: bool = False,
    crowd: Literal["omit", "stuff"] = "omit",
    features: str | None = None,
    threads: AtOnce = 2,
    batch: Positive = 1,
    device: Device = "auto",
    max_pixels: Positive = MAX_PIXELS,
) -> Step:
    """Detects objects, or imports segments that exist already.

    Parameters
    ----------
    segments : a model or importer of `rsa-data list segmenters`, importers as NAME:PLACE; with a
        model card of your own, any name that its table shall have.
    segmenter_weights : file of the model's weights, instead of the download.
    card : model card (TOML) of a model of your own.
    names : class names of a label map or of detection results; a table of
        `rsa-data list class-tables`, or a file with one name a line or TOML.
    score_threshold : lowest score that is kept, instead of the model's own.
    images : gives the images of the whole dataset, which importers hold in memory.
    masks : keep each segment's mask as COCO run lengths.
    crowd : what a region that COCO marks as a crowd, or Cityscapes as a group, becomes: nothing, or
        a segment of stuff such as "crowd of people".
    features : output of the graph to keep one row of for each segment.
    threads : images that the model runs on at the same time in each worker, each on one core;
        what comes out does not depend on it.
    batch : images in a run of the model, where it takes more than one.
    device : where the model runs; auto takes CUDA where onnxruntime has it.
    max_pixels : images with more pixels are refused, unread.
    """
    name, argument = registry.SEGMENTERS.split(segments)
    given = {
        "segmenter_weights": segmenter_weights,
        "card": card,
        "names": names,
        "score_threshold": score_threshold,
        "masks": masks,
        "crowd": crowd,
        "features": features,
        "threads": threads,
        "batch": batch,
        "device": device,
        "max_pixels": max_pixels,
    }
    builder = registry.resolve("segmenter", registry.SEGMENTERS, _entry(name, card))
    known = options.parameters(builder)
    usual = options.parameters(build)
    for option, value in given.items():
        # Ray says cpu for a worker without a GPU, which is where an importer runs.
        without_effect = (usual[option].default, "cpu" if option == "device" else None)
        if option not in known and value not in without_effect:
            raise UsageError(
                f"segments {name}: {options.flag(option)} has no effect here: leave it out"
            )
    own = {option: value for option, value in given.items() if option in known}
    where: dict[str, Any] = {"dataset": dataset, "root": root}
    if "images" in known:
        where["images"] = images and images()
    step: Step = builder(name=name, argument=argument or None, **where, **own)
    return step


def files(
    *,
    segments: str = DEFAULT,
    segmenter_weights: Path | None = None,
    card: Path | None = None,
    **given: Any,
) -> dict[str, Path]:
    """The files whose bytes decide the segments: model and card, or what an importer reads whole.

    May download the model. Raises RsaDataError, with the way out, when it cannot be had.
    """
    name, argument = registry.SEGMENTERS.split(segments)
    entry = _entry(name, card)
    target = registry.SEGMENTERS.get(entry, "")
    if target and not registry.SEGMENTERS.is_own(entry):
        registry.resolve("segmenter", registry.SEGMENTERS, entry)  # explains what fails
    finder = getattr(import_module(target.partition(":")[0]), "files", None) if target else None
    if finder is None:
        return {}
    given |= {"segmenter_weights": segmenter_weights, "card": card}
    found: dict[str, Path] = finder(name=name, argument=argument or None, **given)
    return found


def _entry(name: str, card: Path | None) -> str:
    # With a card of one's own any name will do: its builder is the one of the default model.
    return DEFAULT if card is not None and name not in registry.SEGMENTERS else name


def label(*, segments: str = DEFAULT, card: Path | None = None, **_: Any) -> str | None:
    """The name of a card of one's own, where no other name was given for its table."""
    return read_card(card).name if card is not None and segments == DEFAULT else None


def check(*, segments: str = DEFAULT, card: Path | None = None, **_: Any) -> None:
    """Refuses a segmenter that is not in the registry, unless a card describes it."""
    name = registry.SEGMENTERS.split(segments)[0]
    registry.check("segmenter", registry.SEGMENTERS, _entry(name, card))


def index(source: str, dataset: Dataset) -> pa.Table | None:
    """The samples that a source of segments lists, where the images are not at hand; or None."""
    from .rsa_release import index_release

    name, _, argument = source.partition(":")
    return index_release(argument, dataset) if name == "rsa-release" and argument else None


STAGE = Stage(
    name="detect",
    version=2,
    build=build,
    help="""Detect what each image shows, or import existing segments.

    \b
      rsa-data detect --dataset nyuv2 --segments yolox-nano --segmenter-weights yolox_nano.onnx
    """,
    next="captions --dataset {dataset}",
    schema="segments",
    folder="segments",
    selector="segments",
    label=label,
    models=True,
    choices=registry.SEGMENTERS,
    local=("segmenter_weights", "card", "threads"),
    files=files,
    notes=Notes(notes.COLUMNS, notes.write),
    check=check,
    index=index,
)

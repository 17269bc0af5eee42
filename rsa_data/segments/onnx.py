"""The segmenter that runs an ONNX model: reading, inference and decoding overlap."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pyarrow as pa

from ..common.cards import Card, card_of, card_path, read_card
from ..common.errors import RowError, RsaDataError, UsageError
from ..common.model_files import local_file, with_data
from ..common.onnx_sessions import Device, open_session
from ..common.prefetch import ahead, settled
from ..common.progress import advance
from ..common.ranges import AtOnce, Positive, Share
from ..datasets import images
from ..datasets.dataset import Dataset
from ..datasets.roots import readers
from ..datasets.shards import name_of
from .graph import Detector, class_table, load
from .graph_checks import Prepared
from .label_maps import read_table
from .recognised import Recognised, recognise
from .segments import Segments, to_table

# Images read before the model asks for them: enough that it never waits for a slow one, few enough
# that memory stays at some tens of images.
_AHEAD = 8


def build(
    *,
    name: str,
    argument: str | None,
    dataset: Dataset,
    root: Path | None,
    segmenter_weights: Path | None = None,
    card: Path | None = None,
    names: str | None = None,
    score_threshold: Share | None = None,
    masks: bool = False,
    features: str | None = None,
    threads: AtOnce = 2,
    batch: Positive = 1,
    device: Device = "auto",
    max_pixels: Positive = images.MAX_PIXELS,
) -> Callable[[pa.Table], pa.Table]:
    """A detector of your own (ONNX), its family recognised: --segmenter-weights FILE.

    The step reads each sample's image below `root` and detects what it shows; see detect.
    """
    if argument is not None:
        raise UsageError(f"segmenter {name}: takes no argument, found {argument!r}")
    if root is None:
        raise RsaDataError(
            f"segmenter {name}: expected the dataset's images; found no folder of {dataset.name}. "
            "Give --root DIR, or import segments that exist (rsa-data list segmenters)"
        )
    if name == "onnx" and card is None:
        found = recognised_file(_own_file(segmenter_weights), names)
        described, table = found.card, found.table
    elif names is not None:
        raise UsageError(f"segmenter {name}: --names has no effect here: its card has the classes")
    else:
        described = _card(name, card)
        table = class_table(described)
    detector = load(
        described,
        local_file(described, segmenter_weights, "--segmenter-weights"),
        table=table,
        score_threshold=score_threshold,
        device=device,
        features=features,
        with_masks=masks,
    )
    if batch > 1 and not detector.batches:
        raise UsageError(f"segmenter {name}: its graph takes one image at a time, not {batch}")

    def step(samples: pa.Table) -> pa.Table:
        def read(path: str | None) -> Prepared:
            if path is None:
                raise RowError("no image is listed")
            try:
                return detector.prepare(images.read_image(root / path, max_pixels))
            except RowError as error:
                raise RowError(f"{name_of(path)}: {error}") from error

        paths = samples["image"].to_pylist()
        found = detect(detector, read, paths, threads=threads, batch=batch, helpers=readers(root))
        return to_table(samples["sample_id"].to_pylist(), found)

    return step


def recognised_file(path: Path, names: str | None) -> Recognised:
    """What family a file is of; names : a class table, or a file of names, for its classes."""
    given = None if names is None else read_table(names)
    return recognise(open_session(path), path.name, given)


def _own_file(path: Path | None) -> Path:
    if path is None:
        raise UsageError("segmenter onnx: expected your own file: --segmenter-weights FILE.onnx")
    if not path.is_file():
        raise RsaDataError(f"--segmenter-weights: expected the model's file; none at {path}")
    return path


def files(
    *,
    name: str,
    segmenter_weights: Path | None = None,
    card: Path | None = None,
    names: str | None = None,
    **_: Any,
) -> dict[str, Path]:
    """The model's file, which may be downloaded here, what lies outside it, and its card."""
    if name == "onnx" and card is None:
        listed = {"names": Path(names)} if names and Path(names).is_file() else {}
        return {**with_data("model", _own_file(segmenter_weights)), **listed}
    path = local_file(_card(name, card), segmenter_weights, "--segmenter-weights")
    return {**with_data("model", path), "card": card or card_path(name)}


def _card(name: str, card: Path | None) -> Card:
    return card_of("segments", name) if card is None else read_card(card)


def detect(
    detector: Detector,
    read: Callable[[str | None], Prepared],
    paths: list[str | None],
    *,
    threads: int = 1,
    batch: int = 1,
    helpers: int = 2,
) -> Iterator[Segments | RowError]:
    """What each image shows, in the order of `paths`, or the error that quarantines it.

    Helpers read and decode while `threads` runs of the model go on, each on one core: that keeps
    the cores busier than one run on all of them, and what comes out does not depend on `threads`.
    What is in a batch follows from `paths` alone: consecutive good images of one tensor shape.
    """
    with ThreadPoolExecutor(helpers) as pool, ThreadPoolExecutor(threads) as runners:

        def run(group: list[Prepared]) -> list[Future[Segments]]:
            found = detector.run(group) if group else []
            return [
                pool.submit(detector.finish, outputs, geometry)
                for outputs, (_, geometry) in zip(found, group, strict=True)
            ]

        # One entry a group of images: their places in it or their errors, and the run.
        going: deque[tuple[list[int | RowError], Future[list[Future[Segments]]]]] = deque()
        most = threads * batch + max(_AHEAD, helpers)
        for places, group in _groups(ahead(pool, read, paths, most), batch):
            going.append((places, runners.submit(run, group)))
            if len(going) > 2 * threads:
                yield from _results(*going.popleft())
        for entry in going:
            yield from _results(*entry)


def _groups(
    images: Iterable[Prepared | RowError], batch: int
) -> Iterator[tuple[list[int | RowError], list[Prepared]]]:
    """Up to `batch` consecutive images of one shape, with the errors that stood between them."""
    places: list[int | RowError] = []
    group: list[Prepared] = []
    for image in images:
        if isinstance(image, RowError):
            places.append(image)
            continue
        if group and group[0][0].shape != image[0].shape:
            yield places, group
            places, group = [], []
        places.append(len(group))
        group.append(image)
        if len(group) == batch:
            yield places, group
            places, group = [], []
    if places:
        yield places, group


def _results(
    places: list[int | RowError], run: Future[list[Future[Segments]]]
) -> Iterator[Segments | RowError]:
    found = run.result()
    for place in places:
        advance(1)
        yield place if isinstance(place, RowError) else settled(found[place])

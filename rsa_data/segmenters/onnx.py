"""The segmenter that runs an ONNX model: reading, inference and decoding overlap."""

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pyarrow as pa

from .. import images
from ..datasets import Dataset
from ..errors import RowError, RsaDataError, UsageError
from ..models import Card, Device, card_of, card_path, local_file, read_card
from ..progress import advance
from . import Segments, to_table
from .graph import Detector, Prepared, class_table, load

# Images in flight for each thread that reads or decodes: enough that the model never waits for a
# slow one, few enough that memory stays at some tens of images.
_AHEAD = 4
_HELPERS = 2


def build(
    *,
    name: str,
    argument: str | None,
    dataset: Dataset,
    root: Path | None,
    model: Path | None = None,
    model_card: Path | None = None,
    score_threshold: float | None = None,
    masks: bool = False,
    features: str | None = None,
    threads: int = 1,
    batch: int = 1,
    device: Device = "auto",
) -> Callable[[pa.Table], pa.Table]:
    """A step that reads each sample's image below `root` and detects what it shows; see detect."""
    if argument is not None:
        raise UsageError(f"segmenter {name}: takes no argument, found {argument!r}")
    if root is None:
        raise RsaDataError(
            f"segmenter {name}: expected the dataset's images; found no folder of {dataset.name}. "
            "Give --root DIR, or import segments that exist (rsa-data list segmenters)"
        )
    card = _card(name, model_card)
    detector = load(
        card,
        local_file(card, model, "--model"),
        table=class_table(card),
        score_threshold=score_threshold,
        threads=threads,
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
                return detector.prepare(images.read_image(root / path))
            except RowError as error:
                raise RowError(f"{path}: {error}") from error

        paths = samples["image"].to_pylist()
        return to_table(samples["sample_id"].to_pylist(), detect(detector, read, paths, batch))

    return step


def files(
    *, name: str, model: Path | None = None, model_card: Path | None = None, **_: Any
) -> dict[str, Path]:
    """The model's file, which may be downloaded here, and its card."""
    card = _card(name, model_card)
    return {
        "model": local_file(card, model, "--model"),
        "card": model_card or card_path(name),
    }


def _card(name: str, model_card: Path | None) -> Card:
    return card_of("segments", name) if model_card is None else read_card(model_card)


def detect(
    detector: Detector,
    read: Callable[[str | None], Prepared],
    paths: list[str | None],
    batch: int = 1,
) -> Iterator[Segments | RowError]:
    """What each image shows, in the order of `paths`, or the error that quarantines it.

    Two helper threads read and decode while this one runs the model. What is in a batch follows
    from `paths` alone: consecutive good images whose tensors have one shape.
    """
    with ThreadPoolExecutor(_HELPERS) as pool:
        reading = _ahead(pool, read, paths)
        finished: deque[Future[Segments] | RowError] = deque()
        waiting: list[tuple[int, Prepared]] = []
        ready: list[Future[Segments] | RowError | None] = []

        def flush() -> None:
            outputs = detector.run([prepared for _, prepared in waiting])
            for (place, (_, geometry)), arrays in zip(waiting, outputs, strict=True):
                ready[place] = pool.submit(detector.finish, arrays, geometry)
            waiting.clear()
            finished.extend(item for item in ready if item is not None)
            ready.clear()

        for future in reading:
            try:
                prepared = future.result()
            except RowError as error:
                ready.append(error)
                continue
            if waiting and waiting[0][1][0].shape != prepared[0].shape:
                flush()
            ready.append(None)
            waiting.append((len(ready) - 1, prepared))
            if len(waiting) == batch:
                flush()
            while len(finished) > _AHEAD * _HELPERS:
                yield _result(finished.popleft())
        if waiting:
            flush()
        finished.extend(item for item in ready if item is not None)
        while finished:
            yield _result(finished.popleft())


def _ahead(
    pool: ThreadPoolExecutor, read: Callable[[str | None], Prepared], paths: list[str | None]
) -> Iterator[Future[Prepared]]:
    """Futures of `read` in order, a few submitted ahead of the one that is asked for."""
    futures: deque[Future[Prepared]] = deque()
    for path in paths:
        futures.append(pool.submit(read, path))
        if len(futures) > _AHEAD * _HELPERS:
            yield futures.popleft()
    yield from futures


def _result(item: Future[Segments] | RowError) -> Segments | RowError:
    advance(1)
    if isinstance(item, RowError):
        return item
    try:
        return item.result()
    except RowError as error:
        return error

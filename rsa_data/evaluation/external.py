"""Metric depth that another model predicted, under the same protocol: a folder of maps."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from ..common.errors import RowError, UsageError
from ..datasets.shapes import check_aspect
from ..depth.files import read_map
from .inputs import Image, TestPart
from .methods import Method, Prediction


def by_files(folder: Path, dataset: str) -> Method:
    """Reads FOLDER/IMAGE.npy (m) or .png (16 bits, mm) for each IMAGE.jpg of a dataset.

    Where `FOLDER/dataset` exists, the files lie below that. A map of another size is resized to
    the ground truth's, bilinear, as the codebases of the models do.
    """
    below = folder / dataset if (folder / dataset).is_dir() else folder

    def predict(image: Image) -> Prediction:
        import cv2

        path = image.sample["image"]
        if path is None:
            raise RowError("no image is listed, so its prediction has no name")
        depth = read_map(below, str(Path(path).with_suffix("")), 1000)
        height, width = image.valid.shape
        check_aspect(depth.shape, (width, height), f"prediction of {path}")
        if depth.shape != (height, width):
            depth = cv2.resize(depth, (width, height), interpolation=cv2.INTER_LINEAR)
        return Prediction(depth[image.valid].astype(np.float64))

    def method(part: TestPart) -> Callable[[Image], Prediction]:
        return predict

    return method


def external_methods(given: Sequence[str], dataset: str) -> dict[str, Method]:
    """The methods of `NAME=DIR`, ...; raises UsageError for another form or a missing folder."""
    methods = {}
    for text in given:
        name, equals, folder = text.partition("=")
        if not equals or not name:
            raise UsageError(f"--external: expected NAME=DIR, found {text!r}")
        if not Path(folder).is_dir():
            raise UsageError(f"--external {name}: there is no folder {folder}")
        methods[name] = by_files(Path(folder), dataset)
    return methods

"""NYU Depth v2's 1,449 labelled frames from their MATLAB file, unpacked once into plain PNG."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from ..common import files
from ..common.errors import RsaDataError
from ..common.extras import extras
from .dataset import Dataset
from .depth_files import png16
from .listing import Sample, files_below, guide, require_folder, stem, to_table
from .nyuv2 import CAMERA, border, room

_FRAMES, _SPLITS = "nyu_depth_v2_labeled.mat", "splits.mat"

# Written last, so that a killed unpacking goes on.
_DONE = "names.toml"

# Steps in a metre of the depth files: 0.1 mm is lost at most, and 13 m fit.
_PER_METRE = 5000


def nyuv2_labeled() -> Dataset:
    """NYU Depth v2 labelled: 795 training and 654 test images with 894 classes, from the .mat file.

    The first command unpacks the file into PNG beside it (about 1.5 GB).
    """
    return Dataset(
        name="nyuv2-labeled",
        index=_index,
        read_depth=png16(_PER_METRE),
        min_depth=1e-3,
        max_depth=10.0,
        train_mask=border,
        key_paths=lambda split, key: (f"{split}/{key}.png", _depth_of(f"{split}/{key}.png")),
        scene=room,
        prepare=unpack,
    )


def _depth_of(image: str) -> str:
    return image.replace("/rgb_", "/sync_depth_")


def _index(root: Path, split: str | None) -> pa.Table:
    require_folder("nyuv2-labeled", root)
    return to_table("nyuv2-labeled", root, _samples(root), split)


def _samples(root: Path) -> Iterator[Sample]:
    for split in ("train", "test"):
        for below, names in files_below(root / split):
            for name in names:
                if name.startswith("rgb_"):
                    image, key = f"{split}/{below}{name}", stem(below + name)
                    yield Sample(split, key, room(key), image, _depth_of(image), CAMERA)


def unpack(root: Path) -> None:
    """Writes SPLIT/SCENE/rgb_N.png, sync_depth_N.png, labels/SPLIT/SCENE/rgb_N.png, names.toml.

    N counts from 0, as in BTS. Depth is rawDepths, the sensor's without filled holes. Files that
    are there stay, so a killed run goes on.

    Raises RsaDataError when the MATLAB files are missing or not what they should be, or a package
    that reads them is.
    """
    if (root / _DONE).is_file():
        return
    if missing := [name for name in (_FRAMES, _SPLITS) if not (root / name).is_file()]:
        raise RsaDataError(
            f"nyuv2-labeled: {root}: expected {' and '.join(missing)}, found neither that nor the "
            f"unpacked images; {guide('nyuv2-labeled')}"
        )
    names: list[str] = []
    for image, pixels, depth, labels in _frames(root, names):
        files.write(root / image, _png(pixels))
        files.write(root / _depth_of(image), _png(depth))
        files.write(root / "labels" / image, _png(labels))
    text = f"first = 1\nnames = {json.dumps(names, ensure_ascii=False)}\n"
    files.write(root / _DONE, text.encode())


def _frames(
    root: Path, names: list[str]
) -> Iterator[tuple[str, np.ndarray, np.ndarray, np.ndarray]]:
    """Path, RGB, depth and labels of each frame that is not unpacked yet; fills `names`.

    Whatever the two files raise while they are read becomes an RsaDataError.
    """
    with extras("dataset 'nyuv2-labeled'"):
        import h5py
        import scipy.io
    try:
        numbers = scipy.io.loadmat(root / _SPLITS)["testNdxs"].ravel()
        test = {int(number) - 1 for number in numbers}  # MATLAB counts from 1
        with h5py.File(root / _FRAMES) as file:
            for i in range(file["names"].shape[1]):
                names.append(_text(file, "names", i))
            for i in range(len(file["images"])):
                split = "test" if i in test else "train"
                image = f"{split}/{_text(file, 'scenes', i)}/rgb_{i:05d}.png"
                if (root / "labels" / image).is_file():  # the last of the three
                    continue
                # Arrays lie transposed, as MATLAB stores columns first.
                depth = np.rint(file["rawDepths"][i].T.astype(np.float64) * _PER_METRE)
                depth = depth.clip(0, 65535).astype(np.uint16)
                labels = file["labels"][i].T.astype(np.uint16)
                yield image, file["images"][i].transpose(2, 1, 0), depth, labels
    except Exception as error:  # both libraries raise kinds of their own
        raise RsaDataError(
            f"nyuv2-labeled: {root}: expected {_FRAMES} and {_SPLITS} as NYU gives them, found: "
            f"{error}; get them again, {guide('nyuv2-labeled')}"
        ) from error


def _text(file: Any, name: str, i: int) -> str:
    """Element i of a cell array of strings: a reference to an array of UTF-16 codes."""
    return "".join(chr(code) for code in np.asarray(file[file[name][0, i]]).ravel())


def _png(pixels: np.ndarray) -> bytes:
    """PNG of uint8 RGB of shape (h, w, 3) or uint16 grey of shape (h, w)."""
    import cv2

    ordered = pixels[:, :, ::-1] if pixels.ndim == 3 else pixels  # OpenCV wants BGR
    return cv2.imencode(".png", np.ascontiguousarray(ordered))[1].tobytes()

"""Relative depth that runs the wrong way, and maps that are not their photo's."""

import cv2
import numpy as np
import pytest
from flat import train_head
from made_tables import DEPTH, write

from rsa_data.common import options
from rsa_data.heads.predict.predict import predict
from rsa_data.store.tables import WorkDir

FAST = {"epochs": 1, "batch": 16, "pixels": 16, "threads": 1, "head": "linear"}


@pytest.mark.parametrize("grows", [False, True])
def test_train_head_says_when_y_runs_the_wrong_way(tmp_path, grows):
    work = WorkDir(tmp_path / "work")
    rng = np.random.default_rng(0)
    metric = rng.uniform(1, 8, (40, 32))
    write(
        work,
        "nyuv2",
        scenes=[f"room {k % 8}" for k in range(40)],
        texts=[["a room"]] * 40,
        features={"a room": rng.normal(size=8).astype(np.float16)},
        relative=metric if grows else 1 / metric,
        metric=metric,
        depth=DEPTH | {"depth_model": "files:y"},
    )
    for _ in range(2):  # a finished head says it again
        summary = train_head(work, **FAST).summary
        said = [line for line in summary.splitlines() if "grows with the distance" in line]
        assert len(said) == grows
        assert not grows or ("in 100% of the images" in said[0] and "--files-hold depth" in said[0])


def relative(folder, shape):
    """The predictions of a photo of 8 x 6 px with a map of this shape and two known points."""
    cv2.imwrite(str(folder / "a.png"), np.zeros((6, 8, 3), np.uint8))
    np.save(folder / "y.npy", np.linspace(1, 0.2, np.prod(shape)).reshape(shape))
    known = ("0,0,2.0", "3,3,3.5")
    call = {"relative": folder / "y.npy", "known": known}
    (found,) = options.call(predict, WorkDir(folder / "work"), [folder / "a.png"], **call)
    return found


def test_relative_maps_are_held_against_their_photo(tmp_path):
    assert relative(tmp_path, (12, 16)).depth.shape == (6, 8)
    assert "found 6 x 8, which is transposed" in relative(tmp_path, (8, 6)).error
    assert "expected the aspect of its image of 8 x 6 px" in relative(tmp_path, (6, 20)).error

"""Scale from the sizes of the objects found."""

import numpy as np
import pytest
import scipy.optimize

from rsa_data.common.errors import RowError
from rsa_data.evaluation import sizes
from rsa_data.evaluation.inputs import Image


def image(y, fy=500.0):
    valid = np.ones(y.shape, bool)
    sample = {"sample_id": "a", "fy": fy}
    return Image(0, sample, y.ravel(), 1 / y.ravel(), valid, y.astype(np.float16))


def row(*found, width=640, height=480):
    """(label, depth in m, x, y): boxes as tall as a thing of that class at that depth."""
    boxes, labels = [], []
    for label, depth, x, y in found:
        tall = 500 * sizes.sizes()[label][0] / depth
        boxes.append([x, y, x + 40, y + tall])
        labels.append(label)
    return {"label": labels, "box": boxes, "width": width, "height": height}


def test_objects_of_the_right_size_give_the_true_scale():
    depth = np.full((480, 640), 9.0)
    depth[:, 300:] = 4.0
    y = 1 / depth / 0.02
    objects = row(("car", 9.0, 50, 100), ("person", 4.0, 400, 100), ("chair", 4.0, 500, 50))
    assert sizes.scale_from_sizes(*sizes.objects_of(image(y), objects)) == pytest.approx(
        0.02, rel=1e-3
    )
    half = row(("car", 9.0, 50, 100))
    small = image(y[::2, ::2])  # y of another size than the image
    assert sizes.scale_from_sizes(*sizes.objects_of(small, half)) == pytest.approx(0.02, rel=1e-3)


def test_the_scale_is_the_weighted_least_squares_of_the_relative_error():
    rng = np.random.default_rng(0)
    y, inverse, spread = rng.uniform(1, 5, 9), rng.uniform(0.1, 1, 9), rng.uniform(0.1, 0.5, 9)
    found = scipy.optimize.least_squares(lambda s: (s * y / inverse - 1) / spread, 0.1, xtol=1e-14)
    assert sizes.scale_from_sizes(y, inverse, spread) == pytest.approx(found.x[0], rel=1e-6)


def test_what_is_cut_off_or_unknown_does_not_count():
    y = np.ones((480, 640))
    objects = row(("car", 9.0, 0, 100), ("person", 4.0, 400, 300), ("chair", 4.0, 610, 50))
    objects["label"].append("cloud")
    objects["box"].append([10, 10, 50, 50])
    assert sizes.scale_from_sizes(*sizes.objects_of(image(y), objects)) is None


@pytest.mark.parametrize(
    ("fy", "found", "says"),
    [
        (None, row(), "focal length"),
        (500.0, None, "no boxes"),
        (500.0, {"box": None}, "no boxes"),
    ],
    ids=["no camera", "no row", "no boxes"],
)
def test_what_it_needs(fy, found, says):
    with pytest.raises(RowError, match=says):
        sizes.objects_of(image(np.ones((4, 4)), fy), found)


def test_every_size_names_its_source():
    import tomllib
    from pathlib import Path

    table = tomllib.loads((Path(sizes.__file__).parent / "sizes.toml").read_text("utf-8"))
    assert {entry["source"] for entry in table["size"].values()} == set(table["source"])
    assert all(0.2 < height < 4 and 0 < spread < 1 for height, spread in sizes.sizes().values())

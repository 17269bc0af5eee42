"""The distance of an object of a photo: the median over its mask, else over half of its box."""

import numpy as np
import pytest

from rsa_data.heads.predict.objects import seen, things
from rsa_data.segments import masks
from rsa_data.segments.segments import Segments


def found(**more) -> Segments:
    about = {
        "label": ["bed", "tv"],
        "area": np.array([0.1, 0.3]),
        "score": np.ones(2, np.float32),
        "is_thing": np.array([True, False]),
        "box": np.array([[40, 20, 80, 60], [0, 0, 200, 100]], np.float32),
        "width": 200,
        "height": 100,
    }
    return Segments(**about | more)


def ramp(height: int, width: int) -> np.ndarray:
    """Depth whose pixel (row, column) is 1000 row + column + 1."""
    return 1000.0 * np.arange(height)[:, None] + np.arange(width) + 1


def test_the_central_half_of_a_box():
    tv, bed = seen(found(), ramp(100, 200))
    assert (tv.label, tv.area, bed.label, bed.area) == ("tv", 0.3, "bed", 0.1)
    # Columns 50 to 69 and rows 30 to 49 of the bed's box; its median is that of the middle.
    assert bed.distance == np.median(ramp(100, 200)[30:50, 50:70])
    assert tv.distance == np.median(ramp(100, 200)[25:75, 50:150])
    assert bed.over == "the central half of its box"
    assert bed.line == f"bed, 10.0% of the image, {bed.distance:.2f} m (median over {bed.over})"


def test_a_map_of_another_size_is_looked_at_in_the_same_place():
    _, bed = seen(found(), ramp(50, 50))  # half as high, a quarter as wide
    assert bed.distance == np.median(ramp(50, 50)[15:25, 12:18])  # 12.5 and 17.5, to even


def test_a_small_box_at_the_edge_has_its_nearest_pixel():
    box = np.array([[199.6, 99.6, 200, 100], [0, 0, 0.2, 0.2]], np.float32)
    tv, bed = seen(found(box=box), ramp(100, 200))
    assert (tv.distance, bed.distance) == (1, 1000 * 99 + 200)


def test_what_is_not_finite_or_not_positive_does_not_count():
    depth = ramp(100, 200)
    depth[30:50, 50:70] = np.inf
    depth[30, 50:55] = [np.nan, 0, -3, 7, 9]
    _, bed = seen(found(), depth)
    assert bed.distance == 8
    _, bed = seen(found(), np.full((100, 200), np.nan))
    assert (bed.distance, bed.over) == (None, "")
    assert bed.line == "bed, 10.0% of the image, distance unknown"
    assert [o.distance for o in seen(found(), None)] == [None, None]
    assert [o.distance for o in seen(found(box=None), ramp(100, 200))] == [None, None]
    assert [o.distance for o in seen(found(width=None), ramp(100, 200))] == [None, None]


def test_a_mask_is_better_than_a_box():
    pytest.importorskip("pycocotools")
    mask = np.zeros((2, 100, 200), bool)
    mask[0, 10:12, 20:40] = mask[1, 99, 199] = True
    tv, bed = seen(found(mask=masks.encode(mask)), ramp(50, 100))
    assert bed.distance == np.median(ramp(50, 100)[5:6, 10:20])
    assert bed.over == "its mask"
    assert tv.distance is None  # no pixel of the smaller map is inside


def test_a_head_reads_places_as_shares():
    center = np.array([[50.0, 25.0], [100, 100]], np.float32)
    bed, tv = things(found(center=center))
    assert (bed.name, bed.share, bed.center, bed.is_thing) == ("bed", 0.1, (0.25, 0.25), True)
    assert (tv.center, tv.is_thing) == ((0.5, 1.0), False)
    assert [t.center for t in things(found(center=center, width=None))] == [None, None]
    assert [t.center for t in things(found())] == [None, None]

"""Pictures: what lies where, colours that mean numbers, text that stays inside."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from rsa_data.segments.segments import Segments
from rsa_data.views.pictures import pictures
from rsa_data.views.pictures.colours import (
    NOTHING,
    depth_colours,
    error_colours,
    range_of,
    round_up,
)
from rsa_data.views.pictures.drawing import width_of, wrap

RAMP = np.linspace(0.01, 1, 200)[None]


def segments(boxes, labels=("bed", "traffic light"), score=1.0):
    count = len(labels)
    return Segments(
        label=list(labels),
        area=np.linspace(0.4, 0.1, count),
        score=np.full(count, score, np.float32),
        is_thing=np.ones(count, bool),
        box=None if boxes is None else np.array(boxes, np.float32),
        width=80,
        height=60,
    )


def prediction(
    name="room/test/1", caption="An image with bed occupies 40.00% of the image", **other
):
    truth = np.tile(np.linspace(0, 9.7, 80, dtype=np.float32), (60, 1))
    given = {"truth": truth, "predicted": truth + 1, "scale": 0.05, "shift": 0.2, "abs_rel": 0.1}
    image = np.full((60, 80, 3), 128, np.uint8)
    return pictures.Prediction(name, image, caption, **{**given, **other})


def has(picture, colour):
    """Whether a colour stands somewhere in a picture."""
    return bool((picture == np.array(colour)).all(-1).any())


def test_depth_grows_brighter_all_the_way_for_those_who_see_no_colour_too():
    colours = depth_colours(RAMP, 1.0)[0] / 255
    luminance = colours @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(luminance) > -1e-3).all()
    assert luminance[-1] - luminance[0] > 0.6


def test_what_is_beyond_the_scale_has_its_last_colour_and_what_is_nothing_is_grey():
    colours = depth_colours(np.array([[5.0, 10.0, 40.0, 0.0, np.nan, np.inf, -1.0]]), 10.0)[0]
    assert (colours[1] == colours[2]).all()
    assert not (colours[0] == colours[1]).all()
    assert (colours[3:] == NOTHING).all()


@pytest.mark.parametrize(
    ("nearest", "farthest", "ticks"),
    [
        (2.1, 3.9, (2, 2.5, 3, 3.5, 4)),
        (0.03, 9.7, (0, 2, 4, 6, 8, 10)),
        (0.42, 0.61, (0.4, 0.45, 0.5, 0.55, 0.6, 0.65)),
        (6, 74, (0, 20, 40, 60, 80)),
        (3, 3, (3, 3.01, 3.02, 3.03, 3.04, 3.05, 3.06)),
    ],
)
def test_colours_run_over_the_depths_that_are_there_with_round_ticks(nearest, farthest, ticks):
    """2% at each end are wild: they do not count."""
    depth = np.linspace(nearest, farthest, 1000)
    depth[:12], depth[-12:] = 1e-3, 500
    depth = np.concatenate([depth, [0, np.nan, np.inf, -3]])
    span = range_of(depth)
    assert span.ticks == pytest.approx(ticks)
    assert span.labels[0] == f"{ticks[0]:g} m" and len(span.ramp()) == 256
    colours = depth_colours(np.array([[span.low, span.high, 500, np.nan]]), span.high, span.low)[0]
    assert (colours[1] == colours[2]).all() and (colours[3] == NOTHING).all()
    assert (span.ramp()[0] != NOTHING).any()
    assert range_of(np.zeros(3)).ticks == (0, 1)


def test_errors_of_the_two_signs_differ_and_none_is_nearly_white():
    near, none, far, nothing = error_colours(np.array([[-1.0, 0.0, 1.0, np.nan]]), 1.0)[0].astype(
        int
    )
    assert near[2] > near[0] + 80
    assert far[0] > far[2] + 80
    assert (none > 240).all()
    assert (nothing == NOTHING).all()


@pytest.mark.parametrize(
    ("value", "top"),
    [(0.73, 0.8), (1.0, 1.0), (7.2, 8.0), (9.7, 10.0), (61, 80), (0, 1), (np.nan, 1)],
)
def test_scales_end_at_round_numbers(value, top):
    assert round_up(value) == pytest.approx(top)


def test_text_is_wrapped_within_its_width_and_tells_when_it_is_cut():
    text = " ".join(f"chair occupies {k}.00% of the image," for k in range(60))
    whole, cut = wrap(text, 14, 500, 100), wrap(text, 14, 500, 3)
    assert " ".join(whole) == text
    assert (len(cut), cut[:2], cut[2][-4:]) == (3, whole[:2], " ...")
    assert max(width_of(line, 14) for line in whole + cut) <= 500
    assert "".join(wrap("x" * 300, 14, 200, 50)) == "x" * 300
    assert wrap("", 14, 200, 3) == []


def test_a_contact_sheet_has_truth_and_prediction_on_one_scale():
    sheet = pictures.contact_sheet([prediction()], title="Title", note="A note.")
    # The right end of the truth is 9.7 m, the scale ends at 10 m; the prediction is 1 m more.
    last = depth_colours(np.array([[10.0]]), 10.0, 0.0)[0, 0]
    assert has(sheet, last)
    assert has(sheet, error_colours(np.array([[1.0]]), 1.0)[0, 0])
    assert has(sheet, NOTHING)
    alike = pictures.contact_sheet(
        [prediction(predicted=prediction().truth)], title="Title", note="A note."
    )
    assert sheet.shape == alike.shape
    assert not np.array_equal(sheet, alike)


def test_a_contact_sheet_grows_by_a_row_a_sample_and_keeps_its_margins_free():
    long = prediction(caption=" ".join(["chair occupies 0.25% of the image,"] * 80))
    narrow = prediction(truth=np.zeros((30, 100), np.float32), predicted=np.ones((30, 100)))
    one = pictures.contact_sheet([prediction()], title="t")
    sheet = pictures.contact_sheet([prediction(), long, narrow], title="t" * 20, note="n " * 400)
    assert sheet.shape[1] == one.shape[1]
    assert sheet.shape[0] > 2 * one.shape[0]
    assert (sheet[:, :20] == 255).all()
    assert (sheet[:, -20:] == 255).all()


def test_boxes_are_framed_where_they_are_and_named():
    picture = pictures.draw_segments(
        np.zeros((60, 80, 3), np.uint8), segments([[10, 20, 40, 50], [60, 5, 75, 20]]), width=800
    )
    assert picture.shape == (600, 800, 3)
    assert (picture[400, 100] == pictures.SEGMENT_COLOURS[0]).all()
    assert (picture[150, 600] == pictures.SEGMENT_COLOURS[1]).all()
    assert (picture[350, 250] == 0).all()


def test_masks_are_tinted_and_the_rest_is_left_alone():
    mask = np.zeros((60, 80), bool)
    mask[20:50, 10:40] = True
    image = np.full((60, 80, 3), 100, np.uint8)
    found = segments([[10, 20, 40, 50]], ["bed"])
    picture = pictures.draw_segments(image, found, masks=[mask], width=800)
    assert (picture[100, 700] == 100).all()
    assert not (picture[480, 120] == 100).all()


def test_a_masks_label_stands_on_it_and_stuff_without_a_mask_has_no_frame():
    ring = np.ones((60, 80), bool)
    ring[10:50, 20:80] = False  # its middle is not in it
    image = np.full((60, 80, 3), 100, np.uint8)
    found = replace(segments([[0, 0, 80, 60]], ["wall"]), is_thing=np.array([False]))
    tinted = pictures.draw_segments(image, found, masks=[ring], width=800)
    solid = (tinted == pictures.SEGMENT_COLOURS[0]).all(-1)
    solid[90:510, 190:] = False
    assert solid.sum() > 500
    plain = pictures.draw_segments(image, found, width=800)
    assert (plain[:600] == 100).all()
    assert plain.shape[0] > 600


def test_segments_without_a_place_are_named_below_the_image():
    image = np.zeros((60, 80, 3), np.uint8)
    picture = pictures.draw_segments(image, segments(None), width=400)
    assert picture.shape[0] > 300
    assert (picture[300:] < 128).any()
    empty = segments(np.zeros((0, 4)), [])
    assert (pictures.draw_segments(image, empty, width=400) == 0).all()


def test_labels_stay_inside_and_apart_however_crowded():
    image = np.zeros((60, 80, 3), np.uint8)
    crowd = segments([[70, 50, 80, 60]] * 30, ["refrigerator"] * 30, score=0.5)
    picture = pictures.draw_segments(image, crowd, width=400)
    assert picture.shape == (300, 400, 3)


def test_a_grid_holds_pictures_of_all_sizes(tmp_path):
    shapes = ((60, 80), (40, 120), (90, 60), (10, 10))
    shown = [(np.full((*s, 3), 90, np.uint8), f"sample {s}") for s in shapes]
    grid = pictures.segment_grid(shown, columns=3)
    assert (grid == 90).all(-1).sum() == sum(640 * round(640 * h / w) for h, w in shapes)
    pictures.save(grid, tmp_path / "a" / "grid.png")
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "a" / "grid.png")), grid)

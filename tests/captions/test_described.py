"""The objects that a caption names are those that `described` lists."""

import re

import numpy as np
import pytest
import rooms

from rsa_data.captions import write
from rsa_data.captions.described import described
from rsa_data.captions.options import Augmentation, Contents, WrongObjects
from rsa_data.common.options import call
from rsa_data.store import schemas

IDS = [f"rooms/train/000/{n:05d}" for n in range(30)]


@pytest.mark.parametrize(
    ("given", "wrong"),
    [
        ({"delete": 0.0}, {}),
        ({"delete": 0.5}, {}),
        ({"delete_by_area": 10.0}, {"replace": 0.5}),
        ({"delete": 0.2}, {"insert": 3, "domain": "indoor"}),
    ],
)
def test_as_in_captions_of_the_same_seed(given, wrong):
    """Read back from the sentences: "a chair occupies 11.00% of the image"."""
    segments, samples = rooms.segment_rows(IDS), rooms.sample_rows(IDS)
    flat = {**given, **wrong, "seed": 5, "variants": 3, "max_tokens": 0, "tokenizer": "minilm"}
    captions = call(write.build, **flat)(segments, samples)
    for variant in range(3):
        found = described(
            segments,
            samples,
            variant,
            augmentation=Augmentation(seed=5, variants=3, **given),
            wrong=WrongObjects(**wrong),
        )
        texts = captions.filter(np.asarray(captions["variant"]) == variant)["text"].to_pylist()
        for text, row in zip(texts, found.to_pylist(), strict=True):
            told = re.findall(r"(?:with|,|and) (?:an? )?([a-z ]+?) occupies ([\d.]+)%", text)
            listed = [
                (name, f"{100 * area:.2f}")
                for name, area in zip(row["label"], row["area"], strict=True)
            ]
            assert [name for name, _ in told] == [name for name, _ in listed]
            shares = [float(a) - float(b) for (_, a), (_, b) in zip(told, listed, strict=True)]
            np.testing.assert_allclose(shares, 0, atol=0.011)
            assert len(row["is_thing"]) == len(row["label"])
        # These segments have no places; the column is there all the same, as segments have it.
        place = schemas.schema("segments").field("center").type
        assert found.schema.field("center").type == place and found["center"].null_count == 30


def test_what_is_countable_is_known_of_objects_that_were_added():
    """The bed of a street is a thing, its ceiling is not, as COCO says."""
    found = described(
        rooms.segment_rows(IDS),
        rooms.sample_rows(IDS),
        1,
        augmentation=Augmentation(variants=2, delete=0.0),
        contents=Contents(objects="background"),
        wrong=WrongObjects(insert=4, domain="indoor"),
    ).to_pylist()
    things = {
        name: flag
        for row in found
        for name, flag in zip(row["label"], row["is_thing"], strict=True)
    }
    assert all(len(row["label"]) == 4 for row in found)
    assert things["toilet"] and things["vase"]
    assert not things["ceiling"] and not things["shelf"]

"""Captions with their objects in other orders."""

import dataclasses
import itertools

from rsa_data.captions.wordings.counts import counts
from rsa_data.captions.wordings.intrinsics import intrinsics
from rsa_data.captions.wordings.occupancy import occupancy
from rsa_data.heads.predict.paraphrases import paraphrases, wording_of

CAPTION = "a small bathroom with a sink, a mirror and a towel"


def test_paraphrases_hold_the_same_objects():
    texts = paraphrases(CAPTION)
    assert 1 < len(texts) <= 8 and CAPTION not in texts and len(set(texts)) == len(texts)
    for text in texts:
        start, objects = text.split(" with ")
        assert start == "a small bathroom"
        assert sorted(objects.split(", ")) == ["a mirror", "a sink", "a towel"]
    assert paraphrases("a room with a bed") == [] and paraphrases("An image.") == []


def test_the_wording_is_that_of_the_training_captions_or_the_one_that_is_named():
    about = {"captions": {"rooms": {"style": "occupancy"}}}
    assert wording_of(about) is occupancy and wording_of(about, "counts") is counts
    assert wording_of({}, "intrinsics") is intrinsics
    assert wording_of({}) is wording_of(about, "own:words") is wording_of(about, "vlm") is None


def test_paraphrases_follow_the_signs_of_the_wording():
    photo = dataclasses.replace(occupancy, opening="A photo of ", last=" and ", closing="!")
    plain = "A photo of a sink, a tub and a bed!"
    orders = {tuple(o) for o in itertools.permutations(("a sink", "a tub", "a bed"))}
    wanted = {f"A photo of {a}, {b} and {c}!" for a, b, c in orders} - {plain}
    assert paraphrases(plain) is None
    assert set(paraphrases(plain, photo)) <= wanted and len(paraphrases(plain, photo)) > 1
    camera = "An image taken with focal lengths 5 and 5 pixels, with bed occupies 1% of the image"
    assert paraphrases(camera, intrinsics) is None

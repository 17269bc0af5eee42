"""Encoders of one's own that do what they should not: refused, never a table of something else."""

import numpy as np
import pyarrow as pa
import pytest
import tiny_encoders
import torch
from PIL import Image
from tiny_encoders import captions

from rsa_data import registry
from rsa_data.common.errors import RsaDataError
from rsa_data.embeddings import embed, embed_images
from rsa_data.embeddings.encoder import Encoder, ImageModel, TextModel
from rsa_data.store import schemas

TEXTS = [f"text {k}" for k in range(10)]


class Network(torch.nn.Module):
    """Features that tell the row: its number in the first place."""

    def __init__(self, answer=lambda x: x):
        super().__init__()
        self.answer = answer

    def forward(self, ids):
        return self.answer(torch.nn.functional.one_hot(ids[:, 0], 10) * 3.0 + ids[:, :1])


def plan(ids, budget):
    """Batches of four."""
    numbers = np.array([row[0] for row in ids], np.int64)
    for start in range(0, len(ids), 4):
        rows = np.arange(len(ids))[start : start + 4]
        yield rows, {"ids": numbers[rows, None]}


def run(monkeypatch, answer=lambda x: x, batches=plan, **options):
    def tokenize(texts):
        return [[int(text.split()[1])] for text in texts], np.zeros(len(texts), bool)

    model = TextModel(
        lambda: Network(answer), tokenize, batches, 64, {"ids": ("b", "t")}, 10, False
    )
    encoder = Encoder("made here", lambda argument, weights: {}, lambda files: model)
    monkeypatch.setattr(tiny_encoders, "OWN", encoder, raising=False)
    monkeypatch.setitem(registry.ENCODERS, "own", "tiny_encoders:OWN")
    step = embed.build(encoder="own", runtime="torch", device="cpu", **options)
    return schemas.embedding_array(step(captions(TEXTS)))


def test_a_buffer_that_is_used_again_is_copied_in_time(monkeypatch):
    buffer = torch.zeros(4, 10)

    def answer(x):
        buffer[: len(x)] = x
        return buffer[: len(x)]

    assert np.array_equal(run(monkeypatch, answer), run(monkeypatch))


@pytest.mark.parametrize(
    ("answer", "says"),
    [
        (lambda x: x[:, :1], r"expected real numbers of shape \(4, 10\)"),
        (lambda x: x[:1], r"found float32 of shape \(1, 10\)"),
        (lambda x: x[0], "of shape"),
        (lambda x: x.sum(), "of shape"),
        (lambda x: x.to(torch.complex64), "expected a tensor of real numbers"),
        (lambda x: x.long(), "expected a tensor of real numbers"),
        (lambda x: (x,), "expected a tensor of real numbers, found tuple"),
        (lambda x: x * 1e-9, "float16 keeps hardly a digit: use --store float32"),
        (lambda x: x * 1e9, "which float16 cannot: use --store float32"),
        (lambda x: x * float("nan"), "expected a finite feature"),
    ],
    ids=["one column", "one row", "flat", "scalar", "complex", "whole", "tuple", "small", "large",
         "nan"],
)  # fmt: skip
def test_features_of_another_form_are_refused(monkeypatch, answer, says):
    with pytest.raises(RsaDataError, match=says):
        run(monkeypatch, answer)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda found: found[:-1], "expected each row once; found row 8 0 times"),
        (lambda found: [*found, found[0]], "expected each row once; found row 0 2 times"),
        (lambda found: [(rows - 1, inputs) for rows, inputs in found], "found -1 to 2"),
    ],
    ids=["left out", "twice", "negative"],
)
def test_batches_hold_each_text_once(monkeypatch, change, says):
    with pytest.raises(RsaDataError, match=says):
        run(monkeypatch, batches=lambda ids, budget: change(list(plan(ids, budget))))


def test_an_image_without_a_feature_is_a_failed_row(monkeypatch, tmp_path):
    names = [f"{k}.png" for k in range(3)]
    for k, name in enumerate(names):
        Image.new("RGB", (4, 4), (k, 9, 9)).save(tmp_path / name)

    class Spoilt(torch.nn.Module):
        def forward(self, pixels):
            rows = pixels.flatten(1)[:, :5] + 1
            return torch.where(rows[:, :1] == 2, float("nan"), rows)

    model = ImageModel(Spoilt(), lambda image: image.transpose(2, 0, 1).astype(np.float32), 5)
    encoder = Encoder("made here", lambda argument, weights: {}, lambda files: model)
    monkeypatch.setattr(tiny_encoders, "OWN", encoder, raising=False)
    monkeypatch.setitem(registry.IMAGE_ENCODERS, "own", "tiny_encoders:OWN")
    step = embed_images.build(root=tmp_path, encoder="own", device="cpu")
    table = step(pa.table({"sample_id": names, "image": names}))
    schemas.check("image_embeddings", table)
    assert table["status"].to_pylist() == ["ok", "failed", "ok"]
    assert table["error"].to_pylist()[1] == "1.png: its feature is not finite, or all zero"
    assert table["embedding"].null_count == 1

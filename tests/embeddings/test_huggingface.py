"""Text encoders from folders of transformers, tiny and random, against transformers itself."""

import json

import numpy as np
import pytest
import torch
from tiny_encoders import SIGHT, captions, randomize

from rsa_data.common.errors import RsaDataError, UsageError
from rsa_data.embeddings.embed import build
from rsa_data.embeddings.frozen import encode
from rsa_data.store import schemas

TEXTS = ["", "a", "a bed and a lamp", "lamp lamp bed", "bed " * 40]
WORDS = ["<pad>", "<unk>", "<s>", "</s>", "a", "bed", "and", "lamp", "image"]


def save_tokenizer(folder, length: int) -> None:
    """A tokenizer of whole words with start and end tokens."""
    from tokenizers import Tokenizer, models, pre_tokenizers, processors
    from transformers import PreTrainedTokenizerFast

    inner = Tokenizer(models.WordLevel({w: i for i, w in enumerate(WORDS)}, unk_token="<unk>"))
    inner.pre_tokenizer = pre_tokenizers.Whitespace()
    inner.post_processor = processors.TemplateProcessing(
        single="<s> $A </s>", special_tokens=[("<s>", 2), ("</s>", 3)]
    )
    PreTrainedTokenizerFast(
        tokenizer_object=inner, pad_token="<pad>", unk_token="<unk>", model_max_length=length
    ).save_pretrained(folder)


SIZES = {
    "hidden_size": 32,
    "intermediate_size": 64,
    "num_hidden_layers": 2,
    "num_attention_heads": 2,
    "vocab_size": len(WORDS),
    "max_position_embeddings": 12,
    "bos_token_id": 2,
    "eos_token_id": 3,
    "pad_token_id": 0,
}


def save_clip(folder):
    from transformers import CLIPConfig, CLIPModel

    config = CLIPConfig(
        text_config=SIZES | {"projection_dim": 24},
        vision_config=SIGHT | {"projection_dim": 24},
        projection_dim=24,
    )
    model = randomize(CLIPModel(config))
    model.save_pretrained(folder)
    save_tokenizer(folder, 12)
    return lambda inputs: model.text_projection(model.text_model(**inputs).pooler_output)


def save_siglip(folder):
    from transformers import SiglipConfig, SiglipModel

    model = randomize(SiglipModel(SiglipConfig(text_config=SIZES, vision_config=SIGHT)))
    model.save_pretrained(folder)
    save_tokenizer(folder, 12)
    return lambda inputs: model.text_model(input_ids=inputs["input_ids"]).pooler_output


def save_sentence(folder, pooling="mean_tokens", normalize=True, extra=(), **settings):
    from transformers import BertConfig, BertModel

    sizes = {k: v for k, v in SIZES.items() if k != "max_position_embeddings"}
    config = BertConfig(**sizes, **settings)
    model = randomize(BertModel(config))
    model.save_pretrained(folder)
    save_tokenizer(folder, 12)
    steps = ["Transformer", "Pooling", *(["Normalize"] if normalize else []), *extra]
    modules = [{"type": f"sentence_transformers.models.{step}"} for step in steps]
    (folder / "modules.json").write_text(json.dumps(modules))
    (folder / "1_Pooling").mkdir()
    (folder / "1_Pooling" / "config.json").write_text(json.dumps({f"pooling_mode_{pooling}": True}))
    (folder / "sentence_bert_config.json").write_text(json.dumps({"max_seq_length": 12}))

    def features(inputs):
        states = model(**inputs).last_hidden_state
        if pooling == "mean_tokens":
            pooled = states.mean(1)
        else:
            pooled = states[:, 0] if pooling == "cls_token" else states.amax(1)
        return pooled / pooled.norm(dim=1, keepdim=True) if normalize else pooled

    return features


def save_raw_cls_sentence(folder):
    return save_sentence(folder, "cls_token", normalize=False)


def save_max_sentence(folder):
    return save_sentence(folder, "max_tokens")


def save_sentence_of_another_network(folder):
    return save_sentence(folder, hidden_act="gelu_new")


SENTENCES = [
    save_sentence,
    save_raw_cls_sentence,
    save_max_sentence,
    save_sentence_of_another_network,
]


@pytest.mark.parametrize(
    "save",
    [save_clip, save_siglip, *SENTENCES],
    ids=lambda save: save.__name__[5:],
)
def test_features_equal_transformers_text_by_text(save, tmp_path):
    from transformers import AutoTokenizer

    reference = save(tmp_path)
    tokenizer = AutoTokenizer.from_pretrained(tmp_path)
    expected = []
    for text in TEXTS:
        fill = "max_length" if save is save_siglip else False
        inputs = tokenizer(
            [text], truncation=True, max_length=12, padding=fill, return_tensors="pt"
        )
        with torch.inference_mode():
            kept = {k: v for k, v in inputs.items() if k in ("input_ids", "attention_mask")}
            expected.append(reference(kept)[0].numpy())

    step = build(encoder=f"hf:{tmp_path}", runtime="torch", store="float32")
    table = step(captions(TEXTS))

    np.testing.assert_allclose(schemas.embedding_array(table), np.stack(expected), atol=2e-6)
    assert table["truncated"].to_pylist() == [False] * 4 + [True]
    lengths = [12] * 5 if save is save_siglip else [2, 3, 7, 5, 12]
    assert table["n_tokens"].to_pylist() == lengths


def test_a_head_finds_its_encoder_again_by_the_folder(tmp_path):
    save_clip(tmp_path)
    step = build(encoder=f"hf:{tmp_path}", runtime="torch", store="float32")
    again = encode(TEXTS, encoder=f"hf-{tmp_path.name}", encoder_weights=tmp_path)
    np.testing.assert_allclose(again, schemas.embedding_array(step(captions(TEXTS))), atol=1e-6)


def test_a_model_without_a_stated_pooling_is_refused(tmp_path):
    save_sentence(tmp_path)
    (tmp_path / "modules.json").unlink()
    with pytest.raises(RsaDataError, match="found 'bert': how its features are pooled"):
        build(encoder=f"hf:{tmp_path}")


def test_unknown_steps_are_refused(tmp_path):
    save_sentence(tmp_path, extra=["Dense"])
    with pytest.raises(RsaDataError, match="found Transformer, Pooling, Normalize, Dense"):
        build(encoder=f"hf:{tmp_path}")


def test_missing_weights_are_not_made_up(tmp_path):
    from safetensors.torch import load_file, save_file

    save_clip(tmp_path)
    tensors = load_file(tmp_path / "model.safetensors")
    del tensors["text_projection.weight"]
    save_file(tensors, tmp_path / "model.safetensors", {"format": "pt"})
    with pytest.raises(RsaDataError, match=r"text_projection\.weight is missing"):
        build(encoder=f"hf:{tmp_path}")


def test_damaged_and_pickled_weights_are_refused(tmp_path):
    save_clip(tmp_path)
    file = tmp_path / "model.safetensors"
    file.write_bytes(file.read_bytes()[:1000])
    with pytest.raises(RsaDataError, match="the model cannot be loaded"):
        build(encoder=f"hf:{tmp_path}")
    file.rename(tmp_path / "pytorch_model.bin")
    with pytest.raises(RsaDataError, match="Pickled weights"):
        build(encoder=f"hf:{tmp_path}")


def test_names_that_are_nowhere_say_so(tmp_path, monkeypatch):
    with pytest.raises(RsaDataError, match="there is none at /no/such/dir"):
        build(encoder="hf:/no/such/dir")
    with pytest.raises(UsageError, match="hf:NAME_OR_DIR"):
        build(encoder="hf")


@pytest.mark.slow
@pytest.mark.parametrize(
    "save", [save_clip, save_siglip, save_sentence], ids=lambda save: save.__name__[5:]
)
def test_exported_graphs_give_the_features_of_torch(save, tmp_path, monkeypatch):
    pytest.importorskip("onnxscript")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    (tmp_path / "model").mkdir()
    save(tmp_path / "model")
    found, expected = (
        schemas.embedding_array(
            build(encoder=f"hf:{tmp_path / 'model'}", runtime=runtime, store="float32")(
                captions(TEXTS)
            )
        )
        for runtime in ("onnx", "torch")
    )
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-5)

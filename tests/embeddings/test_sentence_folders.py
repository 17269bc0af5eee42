"""Folders as sentence-transformers 5 and 6 write them: applied, or refused by name."""

import json

import pytest

from rsa_data.common.errors import RsaDataError
from rsa_data.common.sentence_folders import applied, layout
from rsa_data.common.tokenizers import hf
from rsa_data.embeddings import sentence
from rsa_data.embeddings.huggingface import HF

WORDS = ["<pad>", "<unk>", "<s>", "</s>", "a", "bed", "and", "lamp", "query:", "Bed"]
FIVE = "sentence_transformers.models."
SIX = "sentence_transformers.sentence_transformer.modules.pooling."


def folder(path, **changes):
    """The JSON files of a small BERT as version 5.1 writes them; changes : file's stem -> keys."""
    from tokenizers import Tokenizer, models, pre_tokenizers, processors
    from transformers import PreTrainedTokenizerFast

    inner = Tokenizer(models.WordLevel({w: i for i, w in enumerate(WORDS)}, unk_token="<unk>"))
    inner.pre_tokenizer = pre_tokenizers.WhitespaceSplit()
    inner.post_processor = processors.TemplateProcessing(
        single="<s> $A </s>", special_tokens=[("<s>", 2), ("</s>", 3)]
    )
    side = changes.pop("side", "right")
    PreTrainedTokenizerFast(
        tokenizer_object=inner,
        pad_token="<pad>",
        unk_token="<unk>",
        model_max_length=10,
        truncation_side=side,
    ).save_pretrained(path)
    kinds = changes.pop("kinds", [FIVE + "Transformer", FIVE + "Pooling"])
    places = ["", "1_Pooling", "2_Normalize"]
    modules = [{"type": k, "path": p} for k, p in zip(kinds, places, strict=False)]
    (path / "modules.json").write_text(json.dumps(modules))
    modes = {f"pooling_mode_{m}": m == "mean_tokens" for m in ("cls_token", "mean_tokens")}
    said = {
        "config": {"model_type": "bert", "hidden_size": 8, "max_position_embeddings": 16},
        "sentence_bert_config": {"max_seq_length": 6, "do_lower_case": False},
        "config_sentence_transformers": {"prompts": {"query": "query: "}},
        "1_Pooling/config": {"word_embedding_dimension": 8, **modes, "include_prompt": True},
    }
    (path / "1_Pooling").mkdir()
    for name, content in said.items():
        change = changes.pop(name.replace("/", "_"), {})
        if change is not None:
            (path / f"{name}.json").write_text(json.dumps(content | change))
    if wrong := changes:
        raise TypeError(wrong)
    files = [*path.glob("*.json"), *path.glob("1_Pooling/*.json")]
    return {file.relative_to(path).as_posix(): file for file in files}


def test_the_default_prompt_stands_before_every_text(tmp_path):
    files = folder(tmp_path, config_sentence_transformers={"default_prompt_name": "query"})
    ids, cut = sentence.load(files).tokenize(["bed", ""])
    assert [[WORDS[i] for i in row] for row in ids] == [
        ["<s>", "query:", "bed", "</s>"],
        ["<s>", "query:", "</s>"],
    ]
    assert not cut.any()


def test_a_table_of_before_is_not_continued(tmp_path):
    """What is followed only now has a name of its own among the files of a table."""
    plain, asked = tmp_path / "plain", tmp_path / "asked"
    assert applied(folder(plain)) == {}
    files = folder(
        asked,
        side="left",
        sentence_bert_config={"do_lower_case": True},
        config_sentence_transformers={"default_prompt_name": "query"},
    )
    assert sorted(applied(files)) == ["left side cut", "lower case applied", "prompt applied"]
    (asked / "model.safetensors").write_bytes(b"")
    assert set(applied(files)) < set(HF.files(str(asked), None))


def test_texts_are_cut_and_lowered_as_the_files_say(tmp_path):
    from transformers import AutoTokenizer

    files = folder(tmp_path, side="left", sentence_bert_config={"do_lower_case": True})
    texts = ["Bed", "a bed and a lamp and a bed"]
    ids, cut = sentence.load(files).tokenize(texts)
    theirs = AutoTokenizer.from_pretrained(tmp_path)
    lowered = [text.lower() for text in texts]
    assert ids == theirs(lowered, truncation=True, max_length=6)["input_ids"]
    assert cut.tolist() == [False, True]
    assert [WORDS[i] for i in ids[1]] == ["<s>", "lamp", "and", "a", "bed", "</s>"]


@pytest.mark.parametrize(
    ("changes", "most"),
    [
        ({}, 6),
        ({"sentence_bert_config": {"max_seq_length": None}}, 10),
        ({"sentence_bert_config": None}, 10),
        ({"sentence_bert_config": {"max_seq_length": 40}}, 16),
        ({"sentence_bert_config": {"max_seq_length": 40}, "config": {"model_type": "roberta"}}, 14),
        ({"sentence_bert_config": {"max_seq_length": 40}, "config": {"model_type": "deberta"}}, 40),
    ],
    ids=["stated", "null", "no file", "beyond the table", "behind the padding", "no table"],
)
def test_tokens_that_are_read(tmp_path, changes, most):
    files = folder(tmp_path, **changes)
    assert layout(files).max_tokens == hf(str(tmp_path)).max_tokens == most
    ids, cut = sentence.load(files).tokenize(["bed " * 60])
    assert len(ids[0]) == most and cut.all()


def test_version_6_names_things_otherwise(tmp_path):
    kinds = ["sentence_transformers.base.modules.transformer.Transformer", SIX + "Pooling"]
    kinds.append("sentence_transformers.base.modules.normalize.Normalize")
    method = {"method": "forward", "method_output_name": "last_hidden_state"}
    files = folder(tmp_path, kinds=kinds, sentence_bert_config=None)
    said = {"transformer_task": "feature-extraction", "modality_config": {"text": method},
            "module_output_name": "token_embeddings"}  # fmt: skip
    files["sentence_bert_config.json"] = tmp_path / "sentence_bert_config.json"
    files["sentence_bert_config.json"].write_text(json.dumps(said))
    pooling = {"embedding_dimension": 8, "pooling_mode": "cls", "include_prompt": True}
    files["1_Pooling/config.json"].write_text(json.dumps(pooling))
    found = layout(files)
    assert (found.pooling, found.normalized, found.max_tokens) == ("cls", True, 10)


@pytest.mark.parametrize("key", ["hidden_size", "dim", "d_model"])
def test_the_width_has_several_names(tmp_path, key):
    files = folder(tmp_path)
    config = {"model_type": "distilbert", key: 24, "max_position_embeddings": 16}
    files["config.json"].write_text(json.dumps(config))
    assert layout(files).width == 24


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"kinds": [FIVE + "Transformer", "custom_st.Pooling"]}, "custom_st.Pooling, code of"),
        ({"kinds": [FIVE + "Transformer", FIVE + "Pooling", FIVE + "Dense"]}, "found .*, Dense"),
        ({"config_sentence_transformers": {"default_prompt_name": "x"}}, "the prompt 'x'"),
        ({"config_sentence_transformers": {"truncate_dim": 4}}, "truncate_dim"),
        ({"sentence_bert_config": {"tokenizer_args": {"a": 1}}}, "tokenizer_args: expected"),
        ({"1_Pooling_config": {"pooling_mode_cls_token": True}}, "found cls, mean|found mean, cls"),
        ({"1_Pooling_config": {"pooling_mode": "lasttoken"}}, "found lasttoken"),
        (
            {
                "1_Pooling_config": {"include_prompt": False},
                "config_sentence_transformers": {"default_prompt_name": "query"},
            },
            "include_prompt: expected true",
        ),
    ],
    ids=["own code", "dense", "no prompt", "cut features", "arguments", "two poolings", "last",
         "prompt left out"],
)  # fmt: skip
def test_what_is_not_computed_is_refused(tmp_path, changes, says):
    with pytest.raises(RsaDataError, match=says):
        sentence.load(folder(tmp_path, **changes))


def test_a_tokenizer_that_contradicts_itself_is_refused(tmp_path):
    files = folder(tmp_path)
    for name, change in (
        ("tokenizer_config.json", {"tokenizer_class": "BertTokenizer", "do_lower_case": False}),
        ("tokenizer.json", {"normalizer": {"type": "BertNormalizer", "lowercase": True}}),
    ):
        content = json.loads(files[name].read_text("utf-8")) | change
        files[name].write_text(json.dumps(content))
    with pytest.raises(RsaDataError, match=r"normalizer\.lowercase: expected False"):
        layout(files)

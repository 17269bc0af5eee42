"""CLIP RN50 by open_clip or transformers: features of texts or images; or its random weights."""

import json
import sys
import time
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import load_file, save_file

given = json.loads(sys.argv[1])
_NAMES = {
    "ln_1": "layer_norm1",
    "ln_2": "layer_norm2",
    "mlp.c_fc": "mlp.fc1",
    "mlp.c_proj": "mlp.fc2",
    "attn.out_proj": "self_attn.out_proj",
}


def in_open_clip(tensors=None):
    import open_clip

    torch.manual_seed(0)
    model = open_clip.create_model("RN50-quickgelu", pretrained=None).eval()
    if tensors is not None:
        model.load_state_dict(tensors)
    return open_clip, model


def in_transformers(found):
    from transformers import CLIPTextConfig, CLIPTextModelWithProjection

    sizes = {"vocab_size": 49408, "hidden_size": 512, "intermediate_size": 2048}
    sizes |= {"num_hidden_layers": 12, "num_attention_heads": 8, "max_position_embeddings": 77}
    ends = {"bos_token_id": 49406, "eos_token_id": 49407}
    config = CLIPTextConfig(**sizes, **ends, projection_dim=1024, hidden_act="quick_gelu")
    model = CLIPTextModelWithProjection(config).eval()
    base = "text_model.embeddings"
    named = {
        f"{base}.token_embedding.weight": found["token_embedding.weight"],
        f"{base}.position_embedding.weight": found["positional_embedding"],
        "text_model.final_layer_norm.weight": found["ln_final.weight"],
        "text_model.final_layer_norm.bias": found["ln_final.bias"],
        "text_projection.weight": found["text_projection"].T,
    }
    for i in range(12):
        for kind in ("weight", "bias"):
            block, layer = f"transformer.resblocks.{i}", f"text_model.encoder.layers.{i}"
            for own, name in _NAMES.items():
                named[f"{layer}.{name}.{kind}"] = found[f"{block}.{own}.{kind}"]
            parts = found[f"{block}.attn.in_proj_{kind}"].chunk(3)
            for letter, part in zip("qkv", parts, strict=True):
                named[f"{layer}.self_attn.{letter}_proj.{kind}"] = part
    missing, unknown = model.load_state_dict(named, strict=False)
    assert not unknown and all("position_ids" in name for name in missing), missing
    return model


if "make" in given:
    made = in_open_clip()[1].state_dict()
    save_file({name: tensor.contiguous() for name, tensor in made.items()}, given["make"])
    sys.exit()

torch.set_num_threads(given["threads"])
tensors = load_file(given["weights"])
if given["way"] == "transformers":
    # Its own tokenizer wants files from the hub; open_clip's gives the same numbers.
    from open_clip import tokenize

    model = in_transformers(tensors)
else:
    open_clip, model = in_open_clip(tensors)
    tokenize = open_clip.tokenize


def texts():
    said = json.loads(Path(given["texts"]).read_text())
    for start in range(0, len(said), 32):
        ids = tokenize(said[start : start + 32])
        if given["way"] == "transformers":
            yield model(input_ids=ids).text_embeds
        else:
            yield model.encode_text(ids)


def images():
    from open_clip.transform import image_transform
    from PIL import Image

    prepare = image_transform(224, is_train=False)
    for start in range(0, len(given["images"]), 16):
        batch = [prepare(Image.open(path)) for path in given["images"][start : start + 16]]
        yield model.encode_image(torch.stack(batch))


begun = time.process_time()
with torch.inference_mode():
    features = torch.cat(list(images() if "images" in given else texts())).numpy()
steady = time.process_time() - begun
np.save(given["out"], features)
print(json.dumps({"steady": steady}))

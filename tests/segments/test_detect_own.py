"""detect with models of one's own: cards that do not fit, bad images, batches, memory."""

import numpy as np
import pyarrow as pa
import pytest
from own_models import CARD, DATASET, run, write_graph, write_semantic
from PIL import Image

from rsa_data.common import cards, onnx_sessions
from rsa_data.common.errors import RsaDataError, UsageError
from rsa_data.runner import stages
from rsa_data.segments import detect
from rsa_data.store import schemas


def test_a_model_of_ones_own_needs_no_code(own, tmp_path):
    found = run(tmp_path, ["r.png", "g.png", "b.png"], **own)
    assert found.select(["label", "area", "width", "height", "is_thing"]).to_pylist() == [
        {"label": ["red"], "area": [1.0], "width": 6, "height": 5, "is_thing": [False]},
        {"label": [], "area": [], "width": 6, "height": 5, "is_thing": []},
        {"label": ["blue"], "area": [1.0], "width": 6, "height": 5, "is_thing": [False]},
    ]
    assert detect.files(**own) == {"model": own["segmenter_weights"], "card": own["card"]}
    weights = tmp_path / "m.onnx.data"
    weights.write_bytes(b"weights that the graph leaves out")
    assert detect.files(**own)["model.data"] == weights


def test_neither_threads_nor_batches_change_a_byte(own, tmp_path):
    rng = np.random.default_rng(0)
    names = []
    for k in range(23):
        size = (int(rng.integers(1, 40)), int(rng.integers(1, 40)), 3)
        Image.fromarray(rng.integers(0, 256, size, dtype=np.uint8)).save(tmp_path / f"{k}.png")
        names.append(f"{k}.png" if k % 5 else f"missing{k}.png")
    digests = {
        schemas.digest(run(tmp_path, names, **own, threads=threads, batch=batch))
        for threads, batch in ((1, 1), (3, 1), (2, 4), (2, 50))
    }
    assert len(digests) == 1


BAD_IMAGES = {
    "missing.jpg": "no such file",
    "folder.jpg": "expected a file, found a directory",
    "empty.jpg": "found an empty file",
    "text.jpg": "found a file that begins with",
    "short.jpg": "unreadable JPEG image",
    None: "no image is listed",
}


def test_bad_images_are_quarantined(own, tmp_path):
    (tmp_path / "folder.jpg").mkdir()
    (tmp_path / "empty.jpg").touch()
    (tmp_path / "text.jpg").write_text("hello, this is no image")
    noise = np.random.default_rng(0).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    Image.fromarray(noise).save(tmp_path / "whole.jpg")
    (tmp_path / "short.jpg").write_bytes((tmp_path / "whole.jpg").read_bytes()[:1000])
    names = ["r.png", *BAD_IMAGES, "whole.jpg"]
    samples = pa.table({"sample_id": [str(n) for n in names], "image": names})
    found = detect.build(dataset=DATASET, root=tmp_path, **own, batch=3)(samples)
    schemas.check("segments", found)
    assert found["status"].to_pylist() == ["ok", *["failed"] * len(BAD_IMAGES), "ok"]
    for name, error in zip(names, found["error"].to_pylist(), strict=True):
        if name in BAD_IMAGES:
            assert BAD_IMAGES[name] in error
            assert str(tmp_path) not in error
            assert name is None or error.startswith(name)


def test_odd_images_are_read(own, tmp_path):
    red = Image.new("RGB", (8, 4), (200, 0, 0))
    turned = red.getexif()
    turned[0x0112] = 6
    red.save(tmp_path / "turned.jpg", exif=turned)
    Image.new("RGB", (1, 1), (200, 0, 0)).save(tmp_path / "one.png")
    red.convert("CMYK").save(tmp_path / "cmyk.jpg")
    red.convert("RGBA").save(tmp_path / "alpha.png")
    red.save(tmp_path / "moving.gif", save_all=True, append_images=[Image.new("RGB", (8, 4))])
    Image.fromarray(np.full((4, 8), 40000, np.uint16)).save(tmp_path / "deep.png")
    Image.new("L", (8, 4), 7).save(tmp_path / "grey.png")
    names = ["turned.jpg", "one.png", "cmyk.jpg", "alpha.png", "moving.gif", "deep.png", "grey.png"]
    found = run(tmp_path, names, **own)
    sizes = list(zip(found["width"].to_pylist(), found["height"].to_pylist(), strict=True))
    assert sizes == [(4, 8), (1, 1), *[(8, 4)] * 5]
    assert found["label"].to_pylist() == [["red"]] * 7  # grey: the first of three equal channels


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('name = "x"', 'name = "images"', "expected the inputs images in m.onnx; found x"),
        (
            'map = "y"',
            'map = "logits"',
            r"expected the output logits \(map\) in m.onnx; found y, z",
        ),
        ('map = "y"', 'maps = "y"', r"\[output\] expected the names of map; found none for map"),
        (
            "size = [4, 4]",
            "size = [4, 8]",
            r"expected input x of m.onnx of shape \[1, 3, 4, 8\]; found \['b', 3, 4, 4\]",
        ),
        (
            'names = ["red", "", "blue"]',
            'names = ["red", "green"]',
            r"output y of m.onnx: expected shape \[\?, 2, \?, \?\], by its family and class table",
        ),
        ('map = "y"', 'map = "z"', "output z of m.onnx: expected shape"),
        ('family = "semantic"', 'family = "semantics"', "Did you mean 'semantic'"),
        ('family = "semantic"', 'family = "yolox"', r"\[output\] expected|\[decoder\] expected"),
        ('resize = "stretch"', 'resize = "fit"', r"\[input\] expected resize, one of letterbox"),
        ('resize = "stretch"', 'resize = "stretch"\ncolour = "GBR"', "unknown colour 'GBR'"),
        ("[decoder]", "[decoders]", r"expected a section \[decoder\]; found none"),
        ('names = ["red", "", "blue"]', "names = 3", "expected names = "),
        ('things = "none"', 'things = ["rod"]', "things not among the names: rod"),
    ],
)
def test_a_card_that_does_not_fit_the_graph(own, tmp_path, old, new, message):
    own["card"].write_text(CARD.replace(old, new))
    with pytest.raises(RsaDataError, match=message):
        run(tmp_path, ["r.png"], **own)


def test_shapes_that_only_a_run_tells(own, tmp_path):
    """Sides left open in the graph: the first picture is tried before the first part is begun."""
    write_graph(
        own["segmenter_weights"],
        [
            ("ReduceMin", ["x"], ["least"], {"keepdims": 0}),
            ("Mul", ["least", "zero"], ["nothing"]),
            ("Add", ["sides", "nothing"], ["floats"]),
            ("Cast", ["floats"], ["shape"], {"to": 7}),  # int64
            ("Reshape", ["x", "shape"], ["y"]),
        ],
        [("x", ["b", 3, 4, 4])],
        [("y", ["b", "c", "h", "w"])],
        [("zero", np.float32(0)), ("sides", np.array([1, 6, 2, 4], np.float32))],
    )
    with pytest.raises(
        RsaDataError, match=r"expected shape \[\?, 3, \?, \?\].*found \[1, 6, 2, 4\]"
    ):
        detect.build(dataset=DATASET, root=tmp_path, **own)


def test_nan_is_quarantined(own, tmp_path):
    write_graph(
        own["segmenter_weights"],
        [("Log", ["x"], ["y"])],
        [("x", ["b", 3, 4, 4])],
        [("y", ["b", 3, 4, 4])],
    )
    own["card"].write_text(CARD.replace("[output]", "mean = [1, 1, 1]\n[output]"))
    found = run(tmp_path, ["r.png"], **own)
    assert found["error"].to_pylist() == ["the model's output y holds nan or inf"]


def test_batches_where_the_graph_takes_one(own, tmp_path):
    write_semantic(own["segmenter_weights"], batch=1)
    with pytest.raises(UsageError, match="its graph takes one image at a time, not 4"):
        run(tmp_path, ["r.png"], **own, batch=4)


def test_external_data_stays_inside_the_models_folder(own, tmp_path):
    import onnx
    from onnx import TensorProto, helper

    secret = tmp_path / "secret.bin"
    secret.write_bytes(np.ones(48, np.float32).tobytes())
    inside = tmp_path / "models"
    inside.mkdir()
    for where in ("../secret.bin", str(secret)):
        weights = TensorProto(name="w", data_type=TensorProto.FLOAT, dims=[1, 3, 4, 4])
        weights.data_location = TensorProto.EXTERNAL
        weights.external_data.add(key="location", value=where)
        graph = helper.make_graph(
            [helper.make_node("Add", ["x", "w"], ["y"])],
            "g",
            [helper.make_tensor_value_info("x", TensorProto.FLOAT, [1, 3, 4, 4])],
            [helper.make_tensor_value_info("y", TensorProto.FLOAT, [1, 3, 4, 4])],
            [weights],
        )
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
        (inside / "m.onnx").write_bytes(model.SerializeToString())
        with pytest.raises(RsaDataError, match="expected an ONNX model in one file"):
            onnx_sessions.open_session(inside / "m.onnx")
    assert onnx.__version__


def test_inputs_besides_the_picture(tmp_path):
    """A graph as PaddleDetection's: the scale goes in, boxes in px of the image come out."""
    corners = np.array([[0, 0.9, 0, 0, 8, 8], [0, 0.8, 8, 8, 16, 12], [-1, 0, 0, 0, 0, 0]])
    write_graph(
        tmp_path / "m.onnx",
        [
            ("Concat", ["scale", "scale"], ["yxyx"], {"axis": 1}),
            ("Gather", ["yxyx", "order"], ["xyxy"], {"axis": 1}),
            ("Concat", ["one", "xyxy"], ["divisor"], {"axis": 1}),
            ("ReduceMin", ["image"], ["least"], {"keepdims": 0}),
            ("Mul", ["least", "zero"], ["nothing"]),
            ("Add", ["rows", "nothing"], ["same"]),
            ("Div", ["same", "divisor"], ["found"]),
        ],
        [("image", [1, 3, 16, 16]), ("scale", [1, 2])],
        [("found", ["n", 6])],
        [
            ("order", np.array([1, 0, 3, 2])),
            ("one", np.ones((1, 2), np.float32)),
            ("zero", np.float32(0)),
            ("rows", corners.astype(np.float32)),
        ],
    )
    (tmp_path / "card.toml").write_text(
        """
        [input]
        name = "image"
        resize = "stretch"
        size = [16, 16]
        [input.others]
        scale = { fill = "scale" }
        [output]
        rows = "found"
        [decoder]
        family = "nms-rows"
        score_threshold = 0.5
        [classes]
        names = ["thing"]
        """
    )
    Image.new("RGB", (32, 64)).save(tmp_path / "a.png")
    options = {
        "segments": "x",
        "segmenter_weights": tmp_path / "m.onnx",
        "card": tmp_path / "card.toml",
    }
    (row,) = run(tmp_path, ["a.png"], **options).to_pylist()
    assert row["box"] == [[0, 0, 16, 32], [16, 32, 32, 48]]
    assert row["score"] == [pytest.approx(0.9), pytest.approx(0.8)]


def test_float16_graphs(own, tmp_path):
    """Input and output in float16, as the default model's file may have them."""
    import onnx

    model = onnx.load(own["segmenter_weights"])
    for value in (*model.graph.input, *model.graph.output, *model.graph.value_info):
        value.type.tensor_type.elem_type = onnx.TensorProto.FLOAT16
    whole = run(tmp_path, ["r.png", "b.png"], **own)
    onnx.save(model, own["segmenter_weights"])
    half = run(tmp_path, ["r.png", "b.png"], **own)
    assert half["label"].to_pylist() == whole["label"].to_pylist() == [["red"], ["blue"]]


def test_a_limit_on_pixels(own, tmp_path):
    Image.new("1", (30_000, 20_000)).save(tmp_path / "bomb.png")
    found = run(tmp_path, ["r.png", "bomb.png"], **own)
    assert found["status"].to_pylist() == ["ok", "failed"]
    assert found["error"][1].as_py().startswith("bomb.png: image of 30000 x 20000 pixels: expected")
    found = run(tmp_path, ["r.png"], **own, max_pixels=29)
    assert found["error"].to_pylist() == [
        "r.png: image of 6 x 5 pixels: expected at most 29 pixels (max_pixels)"
    ]


def test_a_card_of_ones_own_names_its_table(own):
    card = own["card"]
    assert stages.bind("detect", {"card": card}).default_label(None) == "card"
    card.write_text('name = "mine"\n' + card.read_text())
    assert stages.bind("detect", {"card": card}).default_label(None) == "mine"
    assert stages.bind("detect", {"card": card, "segments": "x"}).default_label(None) == "x"


def test_memory_does_not_grow_with_the_images(own, tmp_path):
    """Only some images are in flight, however many there are."""
    from rsa_data.segments import graph, onnx

    card = cards.read_card(own["card"])
    detector = graph.load(card, own["segmenter_weights"], table=graph.class_table(card))
    begun, most, ended = 0, 0, 0

    def read(path):
        nonlocal begun
        begun += 1
        return detector.prepare(np.zeros((4, 4, 3), np.uint8))

    for _ in onnx.detect(detector, read, ["x"] * 500, threads=2):
        ended += 1
        most = max(most, begun - ended)
    assert ended == 500
    assert most < 30


def test_features_that_are_not_of_the_candidates(own, tmp_path):
    with pytest.raises(RsaDataError, match="features z: expected one row for each of"):
        run(tmp_path, ["r.png"], **own, features="z")
    with pytest.raises(RsaDataError, match=r"expected the output q \(features\)"):
        run(tmp_path, ["r.png"], **own, features="q")

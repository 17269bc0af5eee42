"""What fuzz.py fuzzes: each importer of text or JSON through its public door, and its seeds.

An importer of several files takes one JSON object, file name -> content; a content that is a string
is written as it is, anything else as JSON. Seeds are small files in the form of real ones, and real
ones where ../shared/data has them. An `assert` that fails is an error like any other.
"""

import json
import tarfile
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pyarrow as pa
import torch
from PIL import Image

from rsa_data.captions import natural, served, vlm
from rsa_data.common import class_names, models, pretrained, tokenizers, units
from rsa_data.common.errors import RsaDataError
from rsa_data.datasets import cameras, dgp
from rsa_data.datasets.dataset import Dataset
from rsa_data.datasets.ddad import ddad, read_depth
from rsa_data.datasets.folder import folder
from rsa_data.datasets.kitti import kitti, read_camera
from rsa_data.datasets.nyuv2 import nyuv2
from rsa_data.datasets.seven_scenes import seven_scenes
from rsa_data.datasets.sun3d import sun3d
from rsa_data.datasets.sunrgbd import sunrgbd
from rsa_data.datasets.void import void
from rsa_data.depth import onnx
from rsa_data.embeddings import sentence
from rsa_data.heads import checkpoint
from rsa_data.heads.predict import known_depth, predict
from rsa_data.runner import limits, pipeline_files, status, verify
from rsa_data.segments import coco_detections, coco_panoptic, graph, rsa_release
from rsa_data.store import schemas
from rsa_data.store.tables import WorkDir

SHARED = Path(__file__).parents[2] / "shared" / "data"
One = Callable[[bytes], object]


@dataclass(frozen=True)
class Importer:
    """seeds : inputs to begin with. make : (empty folder) -> what reads one input.

    kind : text or json, which says how inputs are changed.
    """

    seeds: Callable[[], list[bytes]]
    make: Callable[[Path], One]
    kind: str = "json"


def put(here: Path, data: bytes, names: tuple[str, ...]) -> None:
    """Writes an input as files; what is no such JSON object becomes the first of them."""
    try:
        content = json.loads(data)
    except (ValueError, RecursionError):
        content = None
    if not isinstance(content, dict):
        content = {names[0]: data.decode("utf-8", "surrogateescape")}
    for name in names:
        (here / name).parent.mkdir(parents=True, exist_ok=True)
        if name in content:
            value = content[name]
            text = value if isinstance(value, str) else json.dumps(value)
            (here / name).write_bytes(text.encode("utf-8", "surrogatepass"))
        else:
            (here / name).unlink(missing_ok=True)


def js(value: Any) -> bytes:
    return json.dumps(value).encode()


def shared(*globs: str, most: int = 12_000) -> list[bytes]:
    """Real files that are small enough."""
    found = [path for glob in globs for path in sorted(SHARED.glob(glob))]
    return [path.read_bytes() for path in found if path.stat().st_size < most]


def cut(value: Any, most: int = 3) -> Any:
    """A JSON value with the first entries of each list."""
    if isinstance(value, list):
        return [cut(v, most) for v in value[:most]]
    return {k: cut(v, most) for k, v in value.items()} if isinstance(value, dict) else value


def samples(sample_id: str = "folder/train/a") -> pa.Table:
    values = dict.fromkeys(schemas.schema("samples").names)
    values |= {"sample_id": sample_id, "dataset": "folder", "split": "train", "scene": "."}
    return pa.Table.from_pylist([values | {"image": "a.jpg"}], schemas.schema("samples"))


def accounted(table: pa.Table, here: Path) -> None:
    """One sample in, one row out: ok, or failed with a reason that names no folder of here."""
    (row,) = table.to_pylist()
    assert (row["status"] == "ok") != bool(row["error"]), row
    assert str(here) not in (row["error"] or ""), row


# --- segments


def released_seeds() -> list[bytes]:
    found = [b"bed 0.25\ntraffic light 0.01\n", b"wall-other 1e-3\n\nperson 1.0", b"a nan\n"]
    archive = SHARED / "rsa_release" / "nyu-test.tar.xz"
    if archive.is_file():
        with tarfile.open(archive) as file:
            for member in file:
                if member.name.endswith(".txt") and (content := file.extractfile(member)):
                    found.append(content.read())
                if len(found) > 30:
                    break
    return found


def released(here: Path) -> One:
    place = here / "seg_txt_panoptic" / "nyu" / "train"
    texts = here / "text_all" / "nyu" / "train"
    place.mkdir(parents=True), texts.mkdir(parents=True)
    step = rsa_release.build(argument=str(here), dataset=nyuv2())
    read = natural.release_text(str(here))
    rows = samples("nyuv2/train/a")

    def one(data: bytes) -> None:
        (place / "a.txt").write_bytes(data)
        (texts / "a.txt").write_bytes(data)
        accounted(step(rows), here)
        natural.step("release-text", read, tokenizers.clip())(rows)

    return one


IMAGE = {"id": 1, "file_name": "a.jpg", "width": 4, "height": 3}
CATEGORY = {"id": 1, "name": "wall-brick", "isthing": 1, "supercategory": "x"}
SEGMENT = {"id": 7, "category_id": 1, "area": 12, "bbox": [0, 0, 4, 3], "iscrowd": 0}
PANOPTIC = {
    "images": [IMAGE],
    "annotations": [{"image_id": 1, "file_name": "a.png", "segments_info": [SEGMENT]}],
    "categories": [CATEGORY],
}
RLE = {"size": [3, 4], "counts": "0<"}
RESULTS = [
    {"image_id": 1, "category_id": 1, "score": 0.5, "bbox": [0, 0, 2, 2]},
    {"image_id": 1, "category_id": 1, "score": 0.5, "segmentation": {**RLE, "counts": [0, 12]}},
    {"image_id": 1, "category_id": 1, "segmentation": RLE},
    {"image_id": 1, "category_id": 1, "segmentation": [[0, 0, 3, 0, 3, 2, 0, 2]]},
]


def panoptic_seeds() -> list[bytes]:
    real = [cut(json.loads(data)) for data in shared("panoptic_coco/*.json", most=200_000)]
    for content in real:  # the picture here is another one
        content["images"][0] |= IMAGE
        content["annotations"][0] |= {"image_id": 1, "file_name": "a.png"}
    return [js(content) for content in [PANOPTIC, *real]]


def panoptic(here: Path) -> One:
    ids = np.zeros((3, 4, 3), np.uint8)
    ids[..., 0] = 7
    Image.fromarray(ids).save(here / "a.png")

    def one(data: bytes) -> None:
        (here / "a.json").write_bytes(data)
        build = partial(coco_panoptic.build, argument=str(here / "a.json"), dataset=folder())
        accounted(build(root=None, masks=True)(samples()), here)

    return one


def detection_seeds() -> list[bytes]:
    images = {"images": [IMAGE], "categories": [CATEGORY]}
    seeds = [{"a.json": RESULTS[:1], "b.json": images}]
    seeds += [{"a.json": {**images, "annotations": [result]}} for result in RESULTS]
    return [*map(js, seeds), js({"a.json": RESULTS[1:], "b.json": images})]


def detections(here: Path) -> One:
    def one(data: bytes) -> None:
        put(here, data, ("a.json", "b.json"))
        both = [str(here / name) for name in ("a.json", "b.json") if (here / name).is_file()]
        build = partial(coco_detections.build, argument=":".join(both), dataset=folder())
        accounted(build(root=None, masks=True)(samples()), here)

    return one


def class_table(here: Path) -> One:
    def one(data: bytes) -> None:
        for suffix in (".toml", ".txt"):
            (here / f"names{suffix}").write_bytes(data)
            try:
                table = class_names.read(here / f"names{suffix}")
            except RsaDataError:
                continue
            assert all(isinstance(table.label(n), str) for n in table.names)

    return one


def card_seeds() -> list[bytes]:
    cards = Path(models.__file__).parent / "model_cards".glob("*.toml")
    return [path.read_bytes() for path in sorted(cards)]


def card(here: Path) -> One:
    """A card of the user's own, with a graph that answers nothing it may ask for."""
    import onnx as onnx_format
    from onnx import TensorProto, helper

    names = {"images": "output", "input.1": "758", "pixel_values": "logits"}
    shape = [1, 3, "h", "w"]
    nodes = [helper.make_node("Identity", [a], [b]) for a, b in names.items()]
    ends = [[helper.make_tensor_value_info(n, TensorProto.FLOAT, shape) for n in side]
            for side in (names.keys(), names.values())]  # fmt: skip
    for k, (given, answered) in enumerate(zip(*ends, strict=True)):
        made = helper.make_model(
            helper.make_graph([nodes[k]], "g", [given], [answered]),
            opset_imports=[helper.make_opsetid("", 17)],
            ir_version=8,
        )
        onnx_format.save(made, here / f"{k}.onnx")

    def one(data: bytes) -> None:
        (here / "card.toml").write_bytes(data)
        found = models.read_card(here / "card.toml")
        models.cached_path(found)
        table = graph.class_table(found)
        for k in range(len(names)):
            try:
                detector = graph.load(found, here / f"{k}.onnx", table=table)
                image = np.zeros((30, 40, 3), np.uint8)
                geometry = (prepared := detector.prepare(image))[1]
                detector.finish(detector.run([prepared])[0], geometry)
            except RsaDataError:
                continue

    return one


# --- datasets


def list_seeds(*lines: str) -> Callable[[], list[bytes]]:
    return lambda: [line.encode() for line in lines] + ["\n".join(lines).encode()]


def listed(
    files: tuple[str, ...], names: tuple[str, ...], build: Callable[[Path], Dataset]
) -> Callable[[Path], One]:
    """files : that lie below the root. names : what the input is written to, below it or beside."""

    def make(here: Path) -> One:
        root = here / "root"
        for name in files:
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            (root / name).touch()

        def one(data: bytes) -> None:
            for name in names:
                (here / name).write_bytes(data)
            found = build(here / names[0]).index(root, None)
            assert len(found)

        return one

    return make


KITTI = "2011_09_26/2011_09_26_drive_0002_sync"


def scene_seeds() -> list[bytes]:
    quaternion = {"qw": 1.0, "qx": 0.0, "qy": 0.0, "qz": 0.0}
    pose = {"rotation": quaternion, "translation": {"x": 0.0, "y": 0.0, "z": 1.0}}
    image = {"filename": "rgb/C/1.jpg", "width": 8, "height": 6, "pose": pose}
    cloud = {"filename": "point_cloud/LIDAR/1.npz", "pose": pose}
    made = {
        "scene/scene_0.json": {
            "samples": [{"calibration_key": "k", "datum_keys": ["i", "l"]}],
            "data": [
                {"key": "i", "id": {"name": "CAMERA_01"}, "datum": {"image": image}},
                {"key": "l", "id": {"name": "LIDAR"}, "datum": {"point_cloud": cloud}},
            ],
        },
        "scene/calibration/k.json": {
            "names": ["CAMERA_01"],
            "intrinsics": [{"fx": 8.0, "fy": 8.0, "cx": 4.0, "cy": 3.0, "skew": 0.0}],
        },
        "ddad.json": {"scene_splits": {"0": {"filenames": ["scene/scene_0.json"]}}},
    }
    seeds = [made, {k: v for k, v in made.items() if k != "ddad.json"}]
    for path in SHARED.glob("rgbd/ddad/*/scene_*.json"):
        scene = json.loads(path.read_bytes())
        calibration = next(path.parent.glob("calibration/*.json"))
        scene["samples"][0]["calibration_key"] = "k"
        about = {"scene/scene_0.json": {k: scene[k] for k in ("samples", "data")}}
        seeds.append(about | {"scene/calibration/k.json": json.loads(calibration.read_bytes())})
    return [js(seed) for seed in seeds]


def scene(here: Path) -> One:
    place = here / "scene" / "point_cloud" / "LIDAR"
    place.mkdir(parents=True)
    np.savez(place / "1.npz", data=np.random.default_rng(0).uniform(-9, 9, (50, 4)))
    names = ("scene/scene_0.json", "scene/calibration/k.json", "ddad.json")

    def one(data: bytes) -> None:
        put(here, data, names)
        dgp.read_scene.cache_clear()
        ddad().index(here, None)
        read_depth(place / "1.npz#CAMERA_01")

    return one


def camera_text(here: Path) -> One:
    def one(data: bytes) -> None:
        (here / "a.txt").write_bytes(data)
        for read in (
            lambda path: cameras.read_matrix(path, "folder"),
            lambda path: read_camera(path, "02"),
        ):
            try:
                found = read(here / "a.txt")
            except RsaDataError:
                continue
            assert len(found) == 4 and all(isinstance(v, float) for v in found)

    return one


def job(here: Path) -> One:
    def one(data: bytes) -> None:
        (here / "job.toml").write_bytes(data)
        pipeline_files.load(here / "job.toml")

    return one


def job_seeds() -> list[bytes]:
    shipped = sorted((Path(pipeline_files.__file__).parents[1] / "pipelines").glob("*.toml"))
    mine = b'[dataset.a]\nbuilder = "folder"\nroot = "x"\n[dataset.a.detect]\nsource = "labels"\n'
    return [mine, *(path.read_bytes() for path in shipped)]


# --- captions


def text_seeds() -> list[bytes]:
    files = [
        {"a.json": {"folder/train/a": ["a bed", "two beds"], "a": "An image."}},
        {"a.json": [{"key": "a.jpg", "text": "a room with a caf\u00e9"}]},
        {"a.csv": 'key,text\na,a bed\na.jpg,"a, b"\n'},
        {"texts/a.txt": "a bed\n\ntwo beds"},
    ]
    real = [cut(json.loads(d), 2) for d in shared("captions_nyu/*.json", most=3_000_000)]
    real = [dict(list(r.items())[:3]) if isinstance(r, dict) else r for r in real]
    return [js(file) for file in [*files, *({"a.json": r} for r in real)]]


def texts(here: Path) -> One:
    def one(data: bytes) -> None:
        put(here, data, ("a.json", "a.csv", "texts/a.txt"))
        for name in ("a.json", "a.csv", "texts"):
            try:
                read = natural.import_texts(str(here / name))
                made = natural.step(f"import:{name}", read, tokenizers.clip())(samples())
            except RsaDataError:
                continue
            assert made["sample_id"].unique().to_pylist() == ["folder/train/a"]

    return one


def stand_in(here: Path, dim: int = 8) -> tuple[WorkDir, dict[str, Any]]:
    """A head of 8 features that is not trained."""
    about: dict[str, Any] = {
        "format": 1,
        "architecture": {"name": "linear"},
        "features": {"dim": dim, "encoder": "minilm", "style": "occupancy", "files": {},
                     "options": {"encoder": "minilm", "normalize": False}},
        "depth_model": {"model": "files", "options": None, "files": {}, "geometry": {"a": {}}},
        "far": 0.5, "prior": {"scale": 0.3, "shift": 0.3, "correlation": 0.1},
        "datasets": {"rooms": {"tables": {"samples": "0" * 64}}},
        "captions": {"rooms": {"style": "occupancy"}}, "segments": {"rooms": "segments/labels"},
    }  # fmt: skip
    network = checkpoint.build_network(about["architecture"], dim)
    reference = np.eye(dim, dtype=np.float16)
    head = checkpoint.ScaleHead(network, about, torch.zeros(dim), torch.ones(dim), reference)
    work = WorkDir(here / "work")
    head.save(work.store, "heads/head")
    return work, about


def features_of(texts: list[str], dim: int = 8) -> np.ndarray:
    """Features that depend on the tokens alone, by the real tokenizers."""
    ids = tokenizers.clip().ids(texts)
    assert (tokenizers.clip().count(texts) <= [2 * len(text.encode()) + 2 for text in texts]).all()
    return np.stack([np.bincount(np.array(row) % dim, minlength=dim) for row in ids]) / 10.0


def caption(here: Path) -> One:
    work, _ = stand_in(here)
    head = checkpoint.ScaleHead.load(f"{work.store.location}/heads/head")
    path = here / "captions.txt"

    def one(data: bytes) -> None:
        path.write_bytes(data)
        for text in [data.decode()] if _utf8(data) else []:
            (found,) = predict.from_captions(head, [text], encoder=features_of)
            assert np.isfinite([found.scale, found.shift]).all() and found.lines
        with patch.object(predict, "from_captions", just_texts):
            predict.predict(work, head="head", captions=path)

    return one


def just_texts(head: Any, texts: list[str], *_: object) -> list[predict.Prediction]:
    return [predict.Prediction(text, 1.0, 1.0) for text in texts]


def _utf8(data: bytes) -> bool:
    try:
        return bool(data.decode().strip())
    except UnicodeDecodeError:
        return False


def answer_seeds() -> list[bytes]:
    message = {"choices": [{"message": {"role": "assistant", "content": "a bed\nand a lamp"}}]}
    usage = {"usage": {"prompt_tokens": 9, "completion_tokens": 4}}
    return [js({**message, **usage}), js({"data": [{"id": "m", "object": "model"}]})]


def answer(here: Path) -> One:
    """What a vision-language model's server answers."""
    said = b""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.rfile.read(int(self.headers.get("Content-Length") or 0))
            self.send_response(200)
            self.send_header("Content-Length", str(len(said)))
            self.end_headers()
            self.wfile.write(said)

        do_POST = do_GET

        def log_message(self, *_: object) -> None:
            pass

    web = HTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=web.serve_forever, daemon=True).start()
    server = served.Server(f"http://127.0.0.1:{web.server_port}", "?", wait=0.0)
    count = 0

    def one(data: bytes) -> None:
        nonlocal said, count
        said = data
        count += 1
        pixels = np.frombuffer(count.to_bytes(12, "big"), np.uint8).reshape(2, 2, 3)
        Image.fromarray(pixels).save(here / "a.png")  # a new one: answers are kept
        for act in (lambda: server.model(""), lambda: server.ask("m", here / "a.png")):
            try:
                act()
            except RsaDataError:
                continue
        for kept in (here.parent / "cache").rglob("*.json"):
            kept.unlink()

    return one


# --- what rsa-data wrote itself, after somebody had his hands on it


def head_seeds() -> list[bytes]:
    import tempfile

    with tempfile.TemporaryDirectory() as place:
        about = stand_in(Path(place))[1]
    return [js(about), js({**about, "architecture": {"name": "mlp3"}})]


def head(here: Path) -> One:
    work, _ = stand_in(here)
    place = Path(work.store.location) / "heads" / "head"

    def one(data: bytes) -> None:
        (place / "head.json").write_bytes(data)
        for act in (
            lambda: status.status(work),
            lambda: predict.from_captions(
                checkpoint.ScaleHead.load(str(place)), ["a bed with a lamp"], encoder=features_of
            ),
        ):
            try:
                act()
            except RsaDataError:
                continue

    return one


def made_work(here: Path) -> tuple[WorkDir, dict[str, Any]]:
    import sys

    sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
    import rooms

    from rsa_data.runner import runs

    work = rooms.made(here / "work", parts=1, rows=3)
    runs.run(rooms.captions_job(work), bar=rooms.NoBar)
    base = here / "work"
    texts = [*base.rglob("*.json"), *base.glob("logs/*")]
    return work, {
        path.relative_to(base).as_posix(): json.loads(path.read_bytes())
        if path.suffix == ".json"
        else path.read_text()
        for path in sorted(texts)
    }


def work_seeds() -> list[bytes]:
    import tempfile

    with tempfile.TemporaryDirectory() as place:
        files = made_work(Path(place))[1]
    stable = {name: value for name, value in files.items() if not name.startswith("logs/")}
    log = next(value for name, value in files.items() if name.startswith("logs/"))
    stable["logs/rooms.captions.occupancy.1.jsonl"] = log
    one_table = {k: v for k, v in stable.items() if "samples" in k}
    return [js(stable), js(one_table)]


def work_dir(here: Path) -> One:
    work, files = made_work(here)
    base = Path(work.store.location)
    for name in files:
        if name.startswith("logs/"):
            (base / name).unlink()
    names = tuple(json.loads(work_seeds()[0]))
    usual = js(json.loads(work_seeds()[0]))

    def one(data: bytes) -> None:
        put(base, usual, names)
        put(base, data, names)
        for act in (
            lambda: status.status(work),
            lambda: verify.verify(work, str),
            lambda: verify.recompute(work, 1, str, seed=0),
            lambda: [work.table("rooms", n).read(0) for n in ("samples", "captions/occupancy")],
        ):
            try:
                act()
            except RsaDataError:
                continue

    return one


# --- models


def vocabulary() -> dict[str, Any]:
    from tokenizers import Tokenizer, pre_tokenizers, processors
    from tokenizers import models as kinds

    words = {w: i for i, w in enumerate(["[UNK]", "[CLS]", "[SEP]", "a", "bed", "##s"])}
    made = Tokenizer(kinds.WordPiece(words, unk_token="[UNK]"))
    made.pre_tokenizer = pre_tokenizers.Whitespace()
    ends = [("[CLS]", 1), ("[SEP]", 2)]
    made.post_processor = processors.TemplateProcessing("[CLS] $A [SEP]", None, ends)
    return json.loads(made.to_str())


FOLDER = ("tokenizer.json", "config.json", "sentence_bert_config.json", "modules.json")
FOLDER += ("1_Pooling/config.json",)


def model_seeds() -> list[bytes]:
    config = {"model_type": "bert", "max_position_embeddings": 512, "hidden_size": 8}
    files = {"tokenizer.json": vocabulary(), "config.json": config}
    steps = [{"type": f"sentence_transformers.models.{n}"} for n in ("Transformer", "Pooling")]
    more = {"modules.json": steps, "sentence_bert_config.json": {"max_seq_length": 128}}
    more |= {"1_Pooling/config.json": {"pooling_mode_mean_tokens": True, "x": 1}}
    return [js(files), js({**files, **more})]


def model_folder(here: Path) -> One:
    """A Hugging Face folder: what we read of it. Its weights are read by transformers."""
    (here / "model.safetensors").touch()

    def one(data: bytes) -> None:
        put(here, data, FOLDER)
        try:
            made = tokenizers.hf.__wrapped__(str(here))
            made.encode(["a bed", "", "a \u00e9"])
        except RsaDataError:
            pass
        with patch.object(sentence, "_module", lambda *_: None):
            try:
                sentence.load(pretrained.folder_files(here))
            except AttributeError as error:  # the stand-in for the module has no dim
                if "'dim'" not in str(error):
                    raise

    return one


# --- values of options


def argument(here: Path) -> One:
    y = np.linspace(0.1, 4, 48, dtype=np.float32).reshape(6, 8)

    def known(text: str) -> None:
        at, metres = known_depth.points(y, [text])
        assert np.isfinite(known_depth.refine(0.1, 0.1, at, metres)).all()

    def ends(text: str) -> None:
        assert np.isfinite(known_depth.refine(0.1, 0.1, *known_depth.ends(y, text))).all()

    readers = [limits.parse_failures, vlm.parse_prices, known, ends, known_depth.camera, onnx.fixed,
               lambda t: units.parse_size(t, "x"), lambda t: folder(depth="d", depth_unit=t),
               lambda t: folder(intrinsics=t).index(here, None), tokenizers.named]  # fmt: skip
    Image.fromarray(np.zeros((2, 2, 3), np.uint8)).save(here / "a.png")

    def one(data: bytes) -> None:
        if not _utf8(data):
            return
        for read in readers:
            try:
                read(data.decode())
            except RsaDataError:
                continue

    return one


_FRAME = "image/0000001-000000000001.jpg"
_SUN = "SUNRGBD/kv1/NYUdata/NYU0001"
CAMERA_SEEDS = ["585 0 320\n0 585 240\n0 0 1\n",
                "P_rect_02: 7.2e+02 0 6e+02 4e+01 0 7.2e+02 1e+02 2e-01 0 0 1 2e-03\n"]  # fmt: skip

IMPORTERS = {
    "rsa-release": Importer(released_seeds, released, "text"),
    "coco-panoptic": Importer(panoptic_seeds, panoptic),
    "coco-detections": Importer(detection_seeds, detections),
    "class-table": Importer(
        lambda: [
            b'names = ["bed", "chair"]\nthings = ["bed"]\n',
            b"bed\nchair\n",
            b'first = 1\nthings = "none"\ncount = 9\n[names]\n3 = "a_b"\n',
            *shared("categories/*.txt", "categories/*.names"),
        ],
        class_table,
        "text",
    ),
    "model-card": Importer(card_seeds, card, "text"),
    "list-kitti": Importer(
        list_seeds(
            f"{KITTI}/image_02/data/0000000069.png None 721.5377",
            f"{KITTI}/image_02/data/0000000070.png 2011_09_26_drive_0002_sync/proj_depth/"
            "groundtruth/image_02/0000000070.png 721.5377",
        ),
        listed((f"{KITTI}/a.png",), ("list.txt",), lambda path: kitti(train_list=path)),
        "text",
    ),
    "list-void": Importer(
        list_seeds(*(f"void_release/void_1500/data/copyroom{k}/image/1.2.png" for k in range(3))),
        listed(
            ("void_1500/data/a",),
            tuple(
                f"root/void_1500/{s}_{w}.txt"
                for s in ("train", "test")
                for w in ("image", "ground_truth")
            ),
            lambda path: void(),
        ),
        "text",
    ),
    "list-sunrgbd": Importer(
        list_seeds(f"{_SUN}/image/NYU0001.jpg {_SUN}/depth/NYU0001.png"),
        listed(
            (f"{_SUN}/image/NYU0001.jpg", f"{_SUN}/depth/NYU0001.png"),
            ("list.txt",),
            lambda path: sunrgbd(test_list=path),
        ),
        "text",
    ),
    "list-sun3d": Importer(
        list_seeds("hotel_umd/maryland_hotel3"),
        listed(
            (f"hotel_umd/maryland_hotel3/{_FRAME}", "hotel_umd/maryland_hotel3/depth/1-1.png"),
            ("list.txt",),
            lambda path: sun3d(test_list=path),
        ),
        "text",
    ),
    "list-7scenes": Importer(
        list_seeds("sequence1", "sequence2"),
        listed(
            ("chess/seq-01/frame-000000.color.png", "chess/seq-02/frame-000001.color.jpg"),
            tuple(f"root/chess/{w}Split.txt" for w in ("Train", "Test")),
            lambda path: seven_scenes(),
        ),
        "text",
    ),
    "list-folder": Importer(
        list_seeds("a.jpg", "room/b c.png"),
        listed(
            ("a.jpg", "room/b c.png", "room/d.png"),
            ("list.txt",),
            lambda path: folder(test_list=path),
        ),
        "text",
    ),
    "list-files": Importer(
        list_seeds("a.jpg", "room/b c.png", "room/depth/b c.png", "test/x.png", "train/x.png"),
        listed(("a.jpg",), ("list.txt",), lambda path: folder(file_list=path)),
        "text",
    ),
    "dgp": Importer(scene_seeds, scene),
    "camera": Importer(
        lambda: [*map(str.encode, CAMERA_SEEDS), *shared("rgbd/*/*calib*.txt", "rgbd/7scenes/c*")],
        camera_text,
        "text",
    ),
    "job": Importer(job_seeds, job, "text"),
    "texts": Importer(text_seeds, texts),
    "caption": Importer(
        lambda: [
            b"a small bathroom with a sink, a mirror and a towel",
            b"An image.",
            "caf\u00e9 with 3 \U0001f6cf, x and y".encode(),
        ],
        caption,
        "text",
    ),
    "vlm-answer": Importer(answer_seeds, answer),
    "head": Importer(head_seeds, head),
    "work-dir": Importer(work_seeds, work_dir),
    "model-folder": Importer(model_seeds, model_folder),
    "arguments": Importer(
        list_seeds(
            "3,2,1.5",
            "0.5,9",
            "5%",
            "0.05",
            "100",
            "0.15,0.60",
            "m/5000",
            "mm",
            "4GB",
            "560x434",
            "585,585,320,240",
            "hf:a",
            "clip",
        ),
        argument,
        "text",
    ),
}

"""The export, from a small work dir made through the real stages."""

import base64
import gc
import json
import os
import subprocess
import sys
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import ClassVar

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml
from click.testing import CliRunner
from made_tables import write
from msgspec.structs import replace
from PIL import Image
from tiny_encoders import captions, samples

from rsa_data import registry
from rsa_data.cli.main import cli
from rsa_data.common.errors import RsaDataError, UsageError
from rsa_data.embeddings.embed import build
from rsa_data.store import schemas
from rsa_data.store.tables import Description, Made, WorkDir, to_json
from rsa_data.views.export import export

TEXTS = ["An image.", "An image with a bed.", "An image.", "a", "An image.", "b"]


@pytest.fixture
def work(tmp_path, monkeypatch) -> WorkDir:
    """A work dir with one part of two images, three captions each, and their features."""
    monkeypatch.setitem(registry.ENCODERS, "tiny", "tiny_encoders:TINY")
    work = WorkDir(tmp_path / "work")
    part = captions(TEXTS)
    made = {
        "samples": ("samples", samples(["0.png", "1.png"])),
        "captions/occupancy": ("captions", part),
        "embeddings/occupancy/tiny": (
            "embeddings",
            build(encoder="tiny", runtime="torch", store="float16")(part),
        ),
    }
    for name, (schema, table) in made.items():
        description = {"stage": "x", "schema": schema, "options": {"normalize": False}}
        work.table("nyuv2", name).bind(Description(**description, files={"weights": "ab12"}))
        receipt = {"ok": 2, "failed": 0, "skipped": 0, "split": "train"}
        work.table("nyuv2", name).commit(7, table, Made(**receipt))
    return work


def test_a_table_without_features_is_refused_by_its_name(work, tmp_path):
    table = work.table("nyuv2", "embeddings/objects/tiny")
    table.bind(Description(stage="embed-objects", schema="objects", options={}, files={}))
    with pytest.raises(UsageError, match=r"embeddings/objects/tiny: .*holds objects"):
        export(work, out=tmp_path / "out", embeddings="objects/tiny")
    assert not (tmp_path / "out").exists()


def test_rows_are_captions_with_their_features_as_lists(work, tmp_path):
    assert export(work, out=tmp_path / "out") == {"nyuv2/train": 6}
    rows = pq.read_table(tmp_path / "out" / "nyuv2" / "train-00007.parquet")
    expected = schemas.embedding_array(build(encoder="tiny", runtime="torch")(captions(TEXTS)))
    order = [0, 1, 0, 2, 0, 3]
    assert rows["text"].to_pylist() == TEXTS
    assert rows["image"].to_pylist() == ["0.png"] * 3 + ["1.png"] * 3
    np.testing.assert_array_equal(np.stack(rows["embedding"].to_numpy()), expected[order])


def test_the_card_names_files_counts_encoder_and_terms(work, tmp_path):
    export(work, out=tmp_path / "out")
    card = (tmp_path / "out" / "README.md").read_text()
    _, head, body = card.split("---\n", 2)
    assert yaml.safe_load(head)["configs"] == [
        {
            "config_name": "nyuv2",
            "data_files": [{"split": "train", "path": "nyuv2/train-*.parquet"}],
        }
    ]
    assert "| nyuv2 | train | 6 |" in body
    assert "academic use" in body
    assert "| nyuv2 | occupancy | tiny | normalize=False | weights: ab12 |" in body


def test_the_card_says_that_images_were_rendered_whatever_they_are_called(work, tmp_path):
    samples = work.table("nyuv2", "samples")
    about = replace(samples.description(), options={"dataset": "synthetic-indoor"})
    work.store.write(f"{samples.path}/_table.json", to_json(about))
    export(work, out=tmp_path / "out")
    assert (
        "| nyuv2 | scenes rendered by rsa-data | none |"
        in (tmp_path / "out" / "README.md").read_text()
    )


def test_datasets_opens_it(work, tmp_path):
    datasets = pytest.importorskip("datasets")
    export(work, out=tmp_path / "out")
    rows = datasets.load_dataset(str(tmp_path / "out"), "nyuv2", split="train")
    assert rows[1]["text"] == TEXTS[1]
    assert len(rows[1]["embedding"]) == 32


def test_nothing_is_overwritten_and_the_command_says_where(work, tmp_path):
    result = CliRunner().invoke(
        cli, ["export", "--work", str(tmp_path / "work"), "--out", str(tmp_path / "out")]
    )
    assert result.exit_code == 0, result.output
    assert result.output.startswith("nyuv2/train: 6 rows\n")
    with pytest.raises(UsageError, match="not there yet"):
        export(work, out=tmp_path / "out")


@pytest.fixture
def with_depth(tmp_path):
    """A work dir with depth and pictures of eight images in two parts."""
    work = WorkDir(tmp_path / "deep")
    rng = np.random.default_rng(0)
    y = rng.uniform(1, 9, (8, 20)).astype(np.float16)
    texts = [[f"a {k}", f"b {k}"] for k in range(8)]
    features = {t: rng.normal(size=6).astype(np.float16) for pair in texts for t in pair}
    write(
        work, "rooms", part=5, scenes=["s"] * 8, texts=texts, features=features,
        relative=y, metric=1 / y, failed=(2,),
    )  # fmt: skip
    (tmp_path / "files" / "train").mkdir(parents=True)
    for k in range(8):
        Image.new("RGB", (4, 3), (k, 0, 0)).save(tmp_path / f"files/train/{k:06d}.jpg")
    work.store.write("rooms/root.txt", str(tmp_path / "files").encode())
    return work, texts, features, y


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_webdataset_reads_its_shards(with_depth, tmp_path):
    webdataset = pytest.importorskip("webdataset")
    work, texts, features, y = with_depth
    options = {"format": "webdataset", "depth": "files", "pictures": True}
    assert export(work, out=tmp_path / "out", **options) == {"rooms/train": 8}
    shards = sorted(str(p) for p in (tmp_path / "out" / "rooms").glob("*.tar"))
    assert len(shards) == 2
    rows = list(webdataset.WebDataset(shards, shardshuffle=False).decode("rgb8"))
    assert [row["json"]["sample_id"] for row in rows] == [f"rooms/train/{k:06d}" for k in range(8)]
    for k, row in enumerate(rows):
        assert row["json"]["captions"] == texts[k]
        np.testing.assert_array_equal(row["embedding.npy"], [features[t] for t in texts[k]])
        assert row["jpg"].shape == (3, 4, 3)
        assert ("relative.npy" in row) == (k != 2)
        if k != 2:
            np.testing.assert_array_equal(row["relative.npy"], y[k])
    again = tmp_path / "again"
    export(work, out=again, **options)
    for shard in map(Path, shards):
        assert (again / "rooms" / shard.name).read_bytes() == shard.read_bytes()
    gc.collect()  # webdataset leaves its files to be closed by it


def test_hugging_face_decodes_pictures_and_depth(with_depth, tmp_path):
    datasets = pytest.importorskip("datasets")
    work, texts, _, y = with_depth
    export(work, out=tmp_path / "out", depth="files", pictures=True)
    rows = datasets.load_dataset(str(tmp_path / "out"), "rooms", split="train")
    rows = rows.cast_column("picture", datasets.Image())
    assert len(rows) == 16 and rows[7]["text"] == texts[3][1]
    assert rows[7]["picture"].size == (4, 3)
    np.testing.assert_array_equal(np.float16(rows[7]["relative"]), y[3])
    assert rows[4]["relative"] is None and rows[4]["fit_scale"] is None


def test_an_export_is_whole_or_refused(with_depth, tmp_path):
    work = with_depth[0]
    (tmp_path / "deep/rooms/depth/files/_part-00001.json").unlink()
    with pytest.raises(RsaDataError, match="1 of 2 parts are not done"):
        export(work, out=tmp_path / "out", depth="files")
    assert not (tmp_path / "out").exists()
    assert export(work, out=tmp_path / "out") == {"rooms/train": 16}


class Hub(BaseHTTPRequestHandler):
    """What huggingface_hub asks of the hub when it uploads small files."""

    commits: ClassVar[list[dict[str, bytes]]] = []
    created: ClassVar[list[dict]] = []

    def do_POST(self):
        size = int(self.headers.get("Content-Length") or 0)
        body = self.rfile.read(size)
        if self.path.endswith("/repos/create"):
            self.created.append(json.loads(body))
            self.answer({"url": "http://127.0.0.1/datasets/me/mine"})
        elif self.path.endswith("/validate-yaml"):
            self.answer({"errors": [], "warnings": []})
        elif "/preupload/" in self.path:
            files = json.loads(body)["files"]
            self.answer({"files": [{"path": f["path"], "uploadMode": "regular",
                                    "shouldIgnore": False} for f in files]})  # fmt: skip
        else:
            url = f"http://{self.headers['Host']}"
            lines = [json.loads(line) for line in body.splitlines()]
            files = [line["value"] for line in lines if line["key"] == "file"]
            self.commits.append({f["path"]: base64.b64decode(f["content"]) for f in files})
            self.answer(
                {"commitUrl": f"{url}/datasets/me/mine/commit/{'0' * 40}", "commitOid": "0" * 40}
            )

    def do_GET(self):
        self.answer({"sha": "0" * 40, "id": "me/mine", "siblings": []})

    def answer(self, value):
        data = json.dumps(value).encode()
        self.send_response(200)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def log_message(self, *_):
        pass


def test_push_uploads_the_folder(with_depth, tmp_path):
    server = ThreadingHTTPServer(("127.0.0.1", 0), Hub)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    words = ["export", "--work", str(tmp_path / "deep"), "--out", str(tmp_path / "out")]
    words += ["--push", "me/mine"]
    variables = {"HF_ENDPOINT": f"http://127.0.0.1:{server.server_port}", "HF_TOKEN": "hf_x"}
    done = subprocess.run(
        [sys.executable, "-m", "rsa_data", *words],
        env={**os.environ, **variables}, capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    server.shutdown()
    server.server_close()
    assert done.returncode == 0, done.stdout + done.stderr
    assert Hub.created[0]["name"] == "mine" and Hub.created[0]["type"] == "dataset"
    (commit,) = Hub.commits
    there = {p.relative_to(tmp_path / "out").as_posix(): p.read_bytes()
             for p in (tmp_path / "out").rglob("*") if p.is_file()}  # fmt: skip
    assert commit == there
    again = subprocess.run(
        [sys.executable, "-m", "rsa_data", *words[:-3], str(tmp_path / "b"), *words[-2:]],
        env={**os.environ, **variables}, capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert again.returncode == 1 and "cannot be reached" in again.stderr
    assert "Traceback" not in again.stderr

"""Shards in a bucket, on a web server and on the hub give what they give in a folder."""

import functools
import http.server
import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import threading
from pathlib import Path

import numpy as np
import pytest
from hub_server import hub, surroundings
from shard_files import TABLES, TAR, as_parquet, as_tars, frames, tables
from weather import weather_before

from rsa_data.common.errors import RsaDataError
from rsa_data.datasets import images
from rsa_data.datasets.roots import open_root
from rsa_data.datasets.webdataset import webdataset
from rsa_data.runner.engines.pool import EngineOptions
from rsa_data.store.tables import WorkDir


class Ranges(http.server.SimpleHTTPRequestHandler):
    """A web server that lists its folders and sends spans of files."""

    protocol_version = "HTTP/1.1"

    def send_head(self):
        span = re.fullmatch(r"bytes=(\d+)-(\d+)", self.headers.get("Range", ""))
        path = Path(self.translate_path(self.path))
        if span is None or not path.is_file():
            return super().send_head()
        data = path.read_bytes()[int(span[1]) : int(span[2]) + 1]
        self.send_response(206 if data else 416)
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)
        return None

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def site(tmp_path):
    (tmp_path / "site").mkdir()
    handler = functools.partial(Ranges, directory=str(tmp_path / "site"))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        with weather_before(server.server_address[1]) as proxy:
            yield tmp_path / "site", proxy
        server.shutdown()


def test_tars_on_a_web_server_in_any_weather(tmp_path, site, expected):
    as_tars(frames(), site[0] / "photos")
    root = open_root(f"http://127.0.0.1:{site[1].server_address[1]}/photos")
    site[1].troubles = ["503", "", "half", "cut", "", "lost", ""] * 3
    found, parts = tables(WorkDir(tmp_path / "work"), "webdataset:photos", TAR, root, expected[1])
    assert parts == [4, 4, 2]
    for table in TABLES:
        assert found[table].equals(expected[0][table]), table
    assert any("half" in seen for seen in site[1].seen)


@pytest.mark.parametrize("form", ["tar", "parquet"])
def test_shards_in_a_bucket(tmp_path, weather, expected, form):
    client = pytest.importorskip("boto3").client("s3")
    weather.troubles, weather.seen = [], []
    (as_tars if form == "tar" else as_parquet)(frames(), tmp_path / "photos")
    for path in (tmp_path / "photos").iterdir():
        client.put_object(Bucket="bucket", Key=f"{form}/{path.name}", Body=path.read_bytes())
    choice = "webdataset:photos" if form == "tar" else "parquet:photos"
    options = TAR if form == "tar" else {**TAR, "depth": "depth"}
    root, work = open_root(f"s3://bucket/{form}"), WorkDir(tmp_path / "work")
    engine = EngineOptions(workers=2 if form == "tar" else 1)
    found, _ = tables(work, choice, options, root, expected[1], engine)
    for table in TABLES:
        assert found[table].equals(expected[0][table]), table


def test_a_shard_is_read_in_few_requests(tmp_path, site):
    as_tars(frames(40), site[0] / "photos")
    root = open_root(f"http://127.0.0.1:{site[1].server_address[1]}/photos")
    rows = webdataset().index(root, None)["image"].to_pylist()
    assert len(rows) == 40
    site[1].seen = []
    for row in rows[::-1] + rows:
        images.read_bytes(root / row)
    assert len(site[1].seen) <= 3 * 10  # ten shards: a look at the size, and one block each


SCRIPT = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from shard_files import TABLES, TAR, tables
from rsa_data.datasets.roots import open_root
from rsa_data.store.tables import WorkDir
import pickle
root = open_root(sys.argv[4])
work = WorkDir(sys.argv[2])
found, parts = tables(work, "webdataset:photos", TAR, root, Path(sys.argv[3]))
Path(sys.argv[2], "found.pickle").write_bytes(pickle.dumps([found, parts, str(root)]))
"""


def test_tars_of_a_data_set_of_the_hub(tmp_path, expected):
    import pickle

    as_tars(frames(), tmp_path / "hub")
    with hub(tmp_path / "hub") as address:
        settings = surroundings(address, tmp_path / "cache")
        helpers = Path(__file__).parents[1] / "helpers"
        given = [helpers, tmp_path / "work", expected[1]]

        def ask(address: str) -> subprocess.CompletedProcess[str]:
            return subprocess.run(
                [sys.executable, "-c", SCRIPT, *map(str, given), address],
                env=os.environ | settings,
                capture_output=True,
                text=True,
                timeout=300,
                check=False,
            )

        done = ask("hf://datasets/owner/name")
        assert done.returncode == 0, done.stderr
        missing = ask("hf://datasets/owner/other")
    found, parts, root = pickle.loads((tmp_path / "work" / "found.pickle").read_bytes())
    assert parts == [4, 4, 2] and root == f"hf://datasets/owner/name@{'c' * 40}"
    for table in TABLES:
        assert found[table].equals(expected[0][table]), table
    assert (tmp_path / "work" / "photos" / "root.txt").read_text() == root
    assert "expected a data set of the hub, found" in missing.stderr


@pytest.mark.parametrize("place", ["hf://owner/name", "hf://datasets/name", "hf://models/a/b"])
def test_other_addresses_of_the_hub_are_refused(place):
    with pytest.raises(RsaDataError, match="expected hf://datasets/OWNER/NAME"):
        open_root(place)


def test_tars_that_img2dataset_wrote(tmp_path, site):
    """Runs where the command img2dataset is on the PATH (it wants other packages than this one)."""
    command = shutil.which("img2dataset")
    if command is None:
        pytest.skip("img2dataset is not installed")
    good = {key: parts["png"] for key, parts in frames().items() if key != "scene0/0003"}
    addresses = []
    for key, data in good.items():
        (site[0] / f"{key[-4:]}.png").write_bytes(data)
        addresses.append(f"http://127.0.0.1:{site[1].server_address[1]}/{key[-4:]}.png")
    (tmp_path / "urls.txt").write_text("\n".join(addresses))
    words = ["--url_list", tmp_path / "urls.txt", "--output_folder", tmp_path / "out"]
    words += ["--output_format=webdataset", "--resize_mode=no", "--encode_format=png"]
    words += ["--encode_quality=1", "--processes_count=1", "--number_sample_per_shard=4"]
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    subprocess.run([command, *map(str, words)], check=True, env=environment, timeout=300)
    rows = webdataset().index(tmp_path / "out", None).to_pylist()
    assert len(rows) == len(good)
    found = {}
    for row in rows:
        shard, _, name = row["image"].split("#")
        with tarfile.open(tmp_path / "out" / shard) as tar:
            about = json.load(tar.extractfile(name.replace(".png", ".json")))
        found[about["url"][-8:-4]] = images.read_image(tmp_path / "out" / row["image"])
    for key in good:
        np.testing.assert_array_equal(
            found[key[-4:]], images.read_image(site[0] / f"{key[-4:]}.png")
        )

"""Work dirs in Azure, against its emulator, and by Google's protocol, against a stand-in.

Stores that do not create conditionally are refused.

Azurite is `npm install azurite`; the test looks for the command `azurite-blob`.
"""

import base64
import email.utils
import hashlib
import hmac
import http.server
import json
import os
import shutil
import socket
import subprocess
import threading
import time
import urllib.error
import urllib.request
from http.server import ThreadingHTTPServer

import pytest
import rooms
from weather import Forward

from rsa_data.common.errors import RsaDataError
from rsa_data.runner import runs, verify
from rsa_data.store import object_clients
from rsa_data.store.objects import ObjectStore
from rsa_data.store.stores import open_store
from rsa_data.store.tables import Description, WorkDir

# The account of every emulator, published by Microsoft.
ACCOUNT = "devstoreaccount1"
KEY = "Eby8vdM02xNOcqFlqUwJPLlmEtlCDXJ1OUzFT50uSRZ6IFsuFq2UVErCz4I6tq/K1SZFPTOtr/KBHBeksoGMGw=="


def make_container(address: str) -> None:
    """PUT /ACCOUNT/container, signed as the service wants it (Shared Key, 2021-12-02)."""
    date = email.utils.formatdate(usegmt=True)
    headers = f"x-ms-date:{date}\nx-ms-version:2021-12-02"
    text = "PUT" + "\n" * 12 + f"{headers}\n/{ACCOUNT}/{ACCOUNT}/container\nrestype:container"
    made = hmac.new(base64.b64decode(KEY), text.encode(), hashlib.sha256).digest()
    request = urllib.request.Request(
        f"{address}/container?restype=container",
        method="PUT",
        headers={
            **dict(line.split(":", 1) for line in headers.splitlines()),
            "Authorization": f"SharedKey {ACCOUNT}:{base64.b64encode(made).decode()}",
            "Content-Length": "0",
        },
    )
    with urllib.request.urlopen(request, timeout=10) as answer:
        assert answer.status == 201


@pytest.fixture
def azure(monkeypatch):
    """The address of a container in the emulator."""
    pytest.importorskip("obstore")
    command = shutil.which("azurite-blob")
    if command is None:
        pytest.skip("azurite-blob is not installed")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
    words = [command, "--inMemoryPersistence", "--skipApiVersionCheck", "--blobHost", "127.0.0.1"]
    with subprocess.Popen(
        [*words, "--blobPort", str(port)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as server:
        try:
            address = f"http://127.0.0.1:{port}/{ACCOUNT}"
            for _ in range(60):
                try:
                    make_container(address)
                    break
                except urllib.error.URLError:
                    time.sleep(0.5)
            monkeypatch.setenv("AZURE_STORAGE_ACCOUNT_NAME", ACCOUNT)
            monkeypatch.setenv("AZURE_STORAGE_ACCOUNT_KEY", KEY)
            monkeypatch.setenv("AZURE_STORAGE_ENDPOINT", address)
            yield f"az://container/work{port}"
        finally:
            server.terminate()


class AsGoogle(Forward):
    """Turns Google's condition into that of S3: the rest of their XML protocols is one."""

    def forward(self) -> None:
        if self.headers.get("x-goog-if-generation-match") == "0":
            self.server.conditions += 1
            self.headers["If-None-Match"] = "*"
        del self.headers["Authorization"]  # of a form that S3 does not know; moto checks no more
        scope = "test/20260101/us-east-1/s3/aws4_request"
        self.headers["Authorization"] = f"AWS4-HMAC-SHA256 Credential={scope}, Signature=0"
        super().forward()

    do_GET = do_PUT = do_DELETE = do_HEAD = do_POST = forward


@pytest.fixture
def google(weather, monkeypatch):
    """The address of a bucket behind Google's protocol: requests of its own client, moto's answers.

    A stand-in, not Google's server or its emulator: what it shows is that the client's requests and
    conditions are those that a server of this protocol acts upon.
    """
    pytest.importorskip("obstore")
    with ThreadingHTTPServer(("127.0.0.1", 0), AsGoogle) as server:
        server.upstream, server.conditions = weather.upstream, 0
        server.troubles, server.seen, server.signed = [], [], []
        threading.Thread(target=server.serve_forever, daemon=True).start()
        address = f"http://127.0.0.1:{server.server_address[1]}"
        account = {"gcs_base_url": address, "disable_oauth": True, "client_email": ""}
        account |= {"private_key": "", "private_key_id": ""}
        monkeypatch.setenv("GOOGLE_BASE_URL", address)
        monkeypatch.setenv("GOOGLE_SERVICE_ACCOUNT_KEY", json.dumps(account))
        yield "gs://bucket/work"
        server.shutdown()
        assert server.conditions


@pytest.mark.parametrize("cloud", ["azure", "google"])
def test_a_work_dir_in_another_cloud(cloud, tmp_path, request):
    place = request.getfixturevalue(cloud)
    store = open_store(place)
    assert store.read("a") is None and store.list("") == []
    store.write("a/b.json", b"one")
    assert store.create("a/e", b"3") and not store.create("a/e", b"4") and store.create("a/e", b"3")
    assert store.list("") == ["a/"] and store.list("a") == ["b.json", "e"]
    assert store.size("a/b.json") == 3 and store.open("a/b.json").read() == b"one"
    store.delete("a/b.json")
    store.delete("a/b.json")
    made = []
    for location in (place, tmp_path):
        work = rooms.made(location, parts=2)
        assert runs.run(rooms.captions_job(work), bar=rooms.NoBar).done == 2
        assert runs.run(rooms.captions_job(work), bar=rooms.NoBar).done == 0
        assert verify.verify(work, lambda text: None) == 0
        table = work.table("rooms", "captions/occupancy")
        made.append([table.receipt(number) for number in table.parts()])
    assert made[0] == made[1]


class Careless(http.server.BaseHTTPRequestHandler):
    """A server of S3 that puts every object, whatever the condition."""

    protocol_version = "HTTP/1.1"

    def do_PUT(self) -> None:
        self.rfile.read(int(self.headers["Content-Length"]))
        self.send_response(200)
        self.send_header("ETag", '"0"')
        self.send_header("Content-Length", "0")
        self.end_headers()

    def do_HEAD(self) -> None:
        self.send_response(404)
        self.send_header("Content-Length", "0")
        self.end_headers()

    def log_message(self, *_: object) -> None:
        pass


def test_a_store_that_replaces_what_is_there_is_refused_for_a_work_dir(monkeypatch):
    pytest.importorskip("obstore")
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Careless) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        address = f"http://127.0.0.1:{server.server_address[1]}"
        monkeypatch.setenv("AWS_ENDPOINT_URL_S3", address)
        monkeypatch.setenv("AWS_ACCESS_KEY_ID", "test")
        monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "test")
        monkeypatch.setenv("AWS_DEFAULT_REGION", "us-east-1")
        description = Description(stage="x", schema="captions")
        with pytest.raises(RsaDataError, match="creates an object only where there is none"):
            WorkDir("s3://careless/x").table("a", "b").bind(description)
        server.shutdown()


@pytest.mark.parametrize("place", ["az://", "gs:///x"])
def test_a_container_must_be_named(place):
    with pytest.raises(RsaDataError, match=f"{place}: expected {place[:2]}://"):
        ObjectStore(place)


@pytest.mark.parametrize("place", ["https://example.org/x", "hf://datasets/a/b@" + "c" * 40])
def test_a_work_dir_is_written(place):
    with pytest.raises(RsaDataError, match="expected a place that can be written"):
        open_store(place)


@pytest.mark.parametrize(("place", "known"), [
    ("gs://bucket/x", "GOOGLE_SERVICE_ACCOUNT_KEY"), ("az://box/x", "AZURE_STORAGE_ACCOUNT_KEY"),
])  # fmt: skip
def test_public_places_are_read_without_an_account(place, known, tmp_path, monkeypatch):
    pytest.importorskip("obstore")
    for name in [*os.environ]:
        if name.startswith(("GOOGLE_", "AZURE_")):
            monkeypatch.delenv(name)
    monkeypatch.setenv("HOME", str(tmp_path))  # where gcloud keeps them
    monkeypatch.setenv("AZURE_STORAGE_ACCOUNT_NAME", ACCOUNT)

    def signs(option: str) -> bool:
        client = object_clients.open_client(place.partition(":")[0], place, option)
        return client.config.get("skip_signature") != "true"

    assert [signs("--root"), signs("--work")] == [False, True]
    account = {"gcs_base_url": "http://127.0.0.1:9", "disable_oauth": True, "client_email": ""}
    account |= {"private_key": "", "private_key_id": ""}
    monkeypatch.setenv(known, KEY if place.startswith("az") else json.dumps(account))
    assert signs("--root")

"""Work dirs in S3, against a server that speaks its protocol, in good and in bad weather."""

import http.client
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest
import rooms

from rsa_data import run, status, verify
from rsa_data.engines import How
from rsa_data.errors import RsaDataError, TransientError
from rsa_data.parts import Work
from rsa_data.storage import open_store
from rsa_data.storage_s3 import S3Store

boto3 = pytest.importorskip("boto3")
moto_server = pytest.importorskip("moto.server")


class Weather(ThreadingHTTPServer):
    """A proxy before the server: answers some requests with 503, cuts some connections.

    For each request the next of `troubles` is done: "" (none), "503", "cut" (the request is not
    passed on), "lost" (it is, but the answer is not brought back), "half" (of the answer).
    """

    def __init__(self, upstream: int):
        super().__init__(("127.0.0.1", 0), Forward)
        self.upstream = upstream
        self.troubles: list[str] = []
        self.seen: list[str] = []
        self.daemon_threads = True


class Forward(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: Weather

    def forward(self) -> None:
        body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
        trouble = self.server.troubles.pop(0) if self.server.troubles else ""
        self.server.seen.append(f"{self.command} {trouble}".strip())
        if trouble == "503":
            self.send_response(503)
            self.send_header("Content-Length", "0")
            self.end_headers()
            return
        if trouble == "cut":
            self.close_connection = True
            return
        upstream = http.client.HTTPConnection("127.0.0.1", self.server.upstream)
        upstream.request(self.command, self.path, body, dict(self.headers))
        answer = upstream.getresponse()
        data = answer.read()
        upstream.close()
        if trouble == "lost":
            self.close_connection = True
            return
        self.send_response(answer.status)
        for name, value in answer.getheaders():
            if name.lower() not in ("connection", "content-length", "transfer-encoding"):
                self.send_header(name, value)
        length = answer.getheader("Content-Length") if self.command == "HEAD" else len(data)
        self.send_header("Content-Length", str(length))
        self.end_headers()
        if trouble == "half":
            self.wfile.write(data[: len(data) // 2])
            self.close_connection = True
            return
        self.wfile.write(data)

    do_GET = do_PUT = do_DELETE = do_HEAD = do_POST = forward

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture(scope="module")
def weather() -> Iterator[Weather]:
    server = moto_server.ThreadedMotoServer(port=0, verbose=False)
    server.start()
    proxy = Weather(server.get_host_and_port()[1])
    thread = threading.Thread(target=proxy.serve_forever, daemon=True)
    thread.start()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("AWS_ACCESS_KEY_ID", "test")
        patch.setenv("AWS_SECRET_ACCESS_KEY", "test")
        patch.setenv("AWS_DEFAULT_REGION", "us-east-1")
        patch.setenv("AWS_ENDPOINT_URL_S3", f"http://127.0.0.1:{proxy.server_address[1]}")
        boto3.client("s3").create_bucket(Bucket="bucket")
        yield proxy
    proxy.shutdown()
    proxy.server_close()
    server.stop()


@pytest.fixture
def place(weather, request) -> str:
    """A prefix of the test's own."""
    weather.troubles, weather.seen = [], []
    return f"s3://bucket/{request.node.name}"


def test_a_store_in_a_bucket(place):
    store = open_store(place)
    assert store.read("a/b.json") is None and store.size("a/b.json") is None
    assert store.list("") == [] and store.list("a") == []
    store.write("a/b.json", b"one")
    store.write("a/c/d.json", b"two")
    assert store.create("a/e.json", b"three")
    assert not store.create("a/e.json", b"four")
    assert store.read("a/e.json") == b"three"
    assert store.list("") == ["a/"] and store.list("a") == ["b.json", "c/", "e.json"]
    assert store.open("a/b.json").read() == b"one" and store.size("a/b.json") == 3
    store.delete("a/b.json")
    store.delete("a/b.json")
    with pytest.raises(FileNotFoundError):
        store.open("a/b.json")


def test_a_stage_gives_the_same_bytes_as_in_a_folder(place, tmp_path):
    kept = {}
    for location in (place, tmp_path):
        work = rooms.made(location, parts=3)
        summary = run.run(rooms.captions_job(work), bar=rooms.NoBar)
        assert (summary.done, summary.rows) == (3, 3 * 50 * 5)
        table = work.table("rooms", "captions/occupancy")
        files = [name for name in work.store.list(table.path) if name != "local.json"]
        kept[str(location)] = {name: work.store.read(f"{table.path}/{name}") for name in files}
        assert run.run(rooms.captions_job(work), bar=rooms.NoBar).done == 0
        said: list[str] = []
        assert verify.verify(work, said.append) == 0, said
    assert kept[place] == kept[str(tmp_path)]
    assert len(kept[place]) == 3 * 2 + 2
    assert [name for name in open_store(place).list("logs") if name.startswith("rooms.captions")]


def test_worker_processes_commit_to_a_bucket(place):
    work = rooms.made(place, parts=3)
    summary = run.run(rooms.captions_job(work), engine=How(workers=2), bar=rooms.NoBar)
    assert (summary.done, summary.ok) == (3, 150)
    assert "captions/occupancy" in "\n".join(status.status(work))


@pytest.mark.parametrize("trouble", ["503", "cut", "lost", "half"])
def test_a_bad_moment_passes(place, weather, trouble):
    store = open_store(place)
    weather.troubles = [trouble] * 2
    store.write("a", b"data")
    weather.troubles = [trouble] * 2
    assert store.create("b", b"data")
    weather.troubles = [trouble] * 2
    assert store.read("a") == b"data"
    weather.troubles = [trouble]
    assert store.list("") == ["a", "b"]
    assert any(trouble in seen for seen in weather.seen)


def test_a_stage_in_bad_weather_loses_nothing(place, weather, tmp_path):
    work = rooms.made(place, parts=3)
    weather.troubles = ["", "503", "", "cut", "lost", "", "", "503", "half", "lost"] * 4
    run.run(rooms.captions_job(work), bar=rooms.NoBar)
    weather.troubles = []
    local = rooms.made(tmp_path, parts=3)
    run.run(rooms.captions_job(local), bar=rooms.NoBar)
    there, here = (w.table("rooms", "captions/occupancy") for w in (work, local))
    assert [there.receipt(n) for n in there.parts()] == [here.receipt(n) for n in here.parts()]


class Slow:
    """A store in which another run commits the same part while this one puts its data."""

    def __init__(self, store, other):
        self.store, self.other = store, other

    def __getattr__(self, name):
        return getattr(self.store, name)

    def write(self, path, data):
        self.store.write(path, data)
        if path.endswith(".parquet") and self.other:
            commit, self.other = self.other, None
            commit()


@pytest.mark.parametrize("where", ["s3", "folder"])
def test_of_two_runs_at_once_the_first_receipt_stays(place, where, tmp_path):
    work = rooms.made(place if where == "s3" else tmp_path, parts=1)
    run.run(rooms.captions_job(work), bar=rooms.NoBar)
    fast, slow = (work.table("rooms", "captions/occupancy") for _ in range(2))
    receipt, part = fast.receipt(0), fast.read(0)
    fast.store.delete(f"{fast.path}/part-00000.json")
    slow.store = Slow(slow.store, lambda: fast.commit(0, part, receipt))
    # Another CPU type may give other bits from the same input: what is there first stays.
    assert slow.commit(0, part.slice(5), receipt) == receipt == fast.receipt(0)
    names = fast.store.list(fast.path)
    assert [name for name in names if name.endswith(".parquet")] == [receipt["file"]]

    fast.store.delete(f"{fast.path}/part-00000.json")
    slow.store.other = lambda: fast.commit(0, part, receipt)
    with pytest.raises(TransientError, match="another run has just written part 0"):
        slow.commit(0, part.slice(5), {**receipt, "fingerprint": "of another input"})
    assert fast.receipt(0) == receipt and fast.read(0, check=True).equals(part)


def test_a_server_that_stays_away_is_a_transient_error(place, weather, monkeypatch):
    monkeypatch.setattr("rsa_data.storage_s3._TRIES", 2)
    store = S3Store(place)
    weather.troubles = ["503"] * 20
    with pytest.raises(TransientError, match=f"cannot write {place}/a: .*503.*same command again"):
        store.write("a", b"data")


def test_a_bucket_that_is_not_there_is_an_error(place):
    with pytest.raises(RsaDataError, match="NoSuchBucket") as caught:
        Work("s3://nowhere/x").table("a", "b").bind({"schema": "captions"})
    assert not isinstance(caught.value, TransientError)

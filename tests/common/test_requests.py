"""Requests to servers that never end, answer too much, or lead elsewhere."""

import gzip
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from rsa_data.common import bounded, http
from rsa_data.common.errors import RowError, RsaDataError, TransientError
from rsa_data.common.model_files import download
from rsa_data.common.requests import Asking, ask


class Bad(BaseHTTPRequestHandler):
    """Answers by the path; counts what each was asked."""

    protocol_version = "HTTP/1.1"
    asked: list[tuple[str, str]]

    def do_GET(self):
        self.asked.append((self.path, self.headers.get("Authorization", "")))
        self.close_connection = True
        start = b"HTTP/1.1 200 OK\r\n"
        try:
            if self.path == "/good":
                self.wfile.write(start + b"Content-Length: 4\r\n\r\ngood")
            elif self.path == "/drip":
                self.wfile.write(start + b"Content-Length: 99\r\n\r\n")
                for _ in range(99):
                    self.wfile.write(b"x")
                    time.sleep(0.2)
            elif self.path == "/headers":
                self.wfile.write(start)
                for _ in range(99):
                    self.wfile.write(b"X: y\r\n")
                    time.sleep(0.2)
            elif self.path == "/silent":
                time.sleep(20)
            elif self.path == "/endless":
                self.wfile.write(start + b"\r\n")
                while True:
                    self.wfile.write(bytes(1 << 16))
            elif self.path == "/bomb":
                body = gzip.compress(bytes(1 << 28))
                self.wfile.write(start + b"Content-Encoding: gzip\r\n\r\n" + body)
            elif self.path == "/ring":
                ends = b"Content-Length: 0\r\nConnection: close\r\n\r\n"
                self.wfile.write(b"HTTP/1.1 302 F\r\nLocation: /ring\r\n" + ends)
            elif self.path == "/file":
                self.wfile.write(b"HTTP/1.1 302 F\r\nLocation: file:///etc/passwd\r\n\r\n")
            elif self.path.startswith("/to"):
                line = f"HTTP/1.1 302 F\r\nLocation: {self.path[3:]}\r\n\r\n"
                self.wfile.write(line.encode())
            else:
                self.wfile.write(b"\x00\x01 nonsense\r\n\r\n")
        except OSError:
            pass

    def log_message(self, *_):
        pass


@pytest.fixture
def serve(monkeypatch):
    """Starts servers; gives the address and what was asked."""
    servers = []

    def start():
        handler = type("Handler", (Bad,), {"asked": []})
        server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
        server.daemon_threads = True
        threading.Thread(target=server.serve_forever, daemon=True).start()
        servers.append(server)
        return f"http://127.0.0.1:{server.server_address[1]}", handler.asked

    yield start
    for server in servers:
        server.shutdown()
        server.server_close()


def get(address, path, how=None, **given):
    how = how or Asking(tries=2, wait=0.01)
    return ask(http.client(address), "GET", address + path, how, **given)


def test_a_good_answer(serve):
    address, _ = serve()
    answer = get(address, "/good")
    assert (answer.status, answer.data, answer.said()) == (200, b"good", "200 OK")


@pytest.mark.parametrize("path", ["/drip", "/headers", "/silent"])
def test_every_request_has_a_deadline_in_all(serve, path, monkeypatch):
    monkeypatch.setenv(bounded.VARIABLE, "request=1s")
    address, _ = serve()
    begun = time.monotonic()
    with pytest.raises(TransientError, match="Run the same command again"):
        get(address, path)
    assert time.monotonic() - begun < 4


@pytest.mark.parametrize("path", ["/endless", "/bomb"])
def test_an_answer_over_its_limit_is_given_up(serve, path, monkeypatch):
    monkeypatch.setenv(bounded.VARIABLE, "answer=1MB")
    address, asked = serve()
    with pytest.raises(RowError, match=r"expected at most 1\.0 MB.*RSA_DATA_LIMITS=answer"):
        get(address, path)
    assert len(asked) == 1


def test_what_is_not_http_may_pass(serve):
    address, asked = serve()
    with pytest.raises(TransientError, match="cannot read"):
        get(address, "/nonsense")
    assert len(asked) == 2


def test_redirects_end(serve):
    address, asked = serve()
    with pytest.raises(RowError, match="leads on more than 5 times"):
        get(address, "/ring")
    assert len(asked) == 6


@pytest.mark.parametrize("anywhere", [False, True])
def test_redirects_never_lead_to_files(serve, anywhere):
    address, _ = serve()
    with pytest.raises(RowError, match="leads to an"):
        get(address, "/file", Asking(anywhere=anywhere))


def test_a_key_is_not_sent_to_another_origin(serve):
    address, _ = serve()
    other, asked = serve()
    with pytest.raises(RowError, match="another origin"):
        get(address, f"/to{other}/good", headers={"Authorization": "Bearer secret"})
    assert asked == []
    assert get(address, f"/to{other}/good", Asking(anywhere=True)).data == b"good"
    assert get(address, f"/to{address}/good").data == b"good"


@pytest.mark.parametrize(
    "address",
    [
        "",
        "http://",
        "ftp://a",
        "http://a b",
        "http://u:p@host/",
        "x",
        "http://[::1/",
        "http://a:99999/",
        "http://a\x1b[31m/",
    ],
)
def test_addresses_that_are_none(address):
    assert not http.is_address(address)
    assert "u:p" not in http.hidden(address)


@pytest.mark.parametrize(
    ("path", "limits", "match"),
    [
        ("/drip", "download=1s", "no whole answer within 1 s"),
        ("/endless", "model=1MB", "at most 1,"),
    ],
)
def test_a_download_ends(serve, path, limits, match, monkeypatch, tmp_path):
    monkeypatch.setenv(bounded.VARIABLE, limits)
    address, _ = serve()
    begun = time.monotonic()
    with pytest.raises((OSError, RsaDataError), match=match):
        download(address + path, tmp_path / "model.onnx")
    assert time.monotonic() - begun < 4
    assert not list(tmp_path.iterdir())


def test_a_deadline_counts_over_redirects(serve):
    address, _ = serve()
    begun = time.monotonic()
    with pytest.raises(TimeoutError), http.deadline(0.5):
        http.client(address, tries=1).request("GET", f"{address}/to{address}/drip")
    assert time.monotonic() - begun < 3

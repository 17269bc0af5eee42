"""What lies in a folder: as web servers' pages list it, and as a bucket does."""

import asyncio
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from rsa_data.common.errors import RowError
from rsa_data.store.bucket_listing import listed
from rsa_data.store.http import HttpFiles, names


def test_links_of_a_page():
    page = b"""<a href="../">Parent</a> <a href="?C=N;O=D">Name</a> <a href="http://[half">x</a>
      <a href="a%20b.png">a</a> <a href="c/">c</a> <a href="c/d.png">d</a> <a href="#top">t</a>
      <a href="http://there/x/e.png">e</a> <a href="http://else/x/f.png">f</a> <a name="n">n</a>"""
    assert names(page, "http://there/x/") == ["a b.png", "c/", "e.png"]


class Answers(BaseHTTPRequestHandler):
    """Each file is answered with the status that is its name."""

    protocol_version = "HTTP/1.1"

    def do_GET(self):
        status = int(self.path.rpartition("/")[2])
        self.send_response(status)
        body = b"" if status == 204 else b"data"
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_):
        pass


def test_answers_that_hold_a_file_and_those_that_do_not():
    """RFC 9110: 203 is a 200 that a proxy has changed, 204 has no content, 410 is gone for good."""
    with ThreadingHTTPServer(("127.0.0.1", 0), Answers) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        files = HttpFiles(f"http://127.0.0.1:{server.server_address[1]}/x")
        assert files.read("200") == files.read("203") == b"data"
        assert files.read("404") is files.read("410") is None
        for status, name in ((204, "No Content"), (403, "Forbidden"), (418, "I'm a Teapot")):
            with pytest.raises(RowError, match=f"^the server answers {status} {name}$"):
                files.read(str(status))
        server.shutdown()


class Bucket:
    """obstore's form of a listing, after a moment."""

    async def list_with_delimiter_async(self, prefix):
        await asyncio.sleep(0.15)
        return {"common_prefixes": [f"{prefix}/c"], "objects": [{"path": f"{prefix}/b.png"}]}


def test_a_bucket_is_listed_where_memory_is_not_told(monkeypatch):
    """Systems without /proc, such as macOS."""
    read = Path.read_text

    def without(path, *arguments):
        if path.parts[:2] == ("/", "proc"):
            raise FileNotFoundError(path)
        return read(path, *arguments)

    monkeypatch.setattr(Path, "read_text", without)
    assert listed(Bucket(), "a") == ["a/b.png", "a/c/"]

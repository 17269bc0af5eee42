"""A bucket whose folder never ends: the listing does."""

import itertools
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from rsa_data.common import bounded
from rsa_data.common.errors import RsaDataError, TransientError
from rsa_data.store.objects import ObjectStore

pytest.importorskip("obstore")

_PAGE = """<?xml version="1.0"?>
<ListBucketResult xmlns="http://s3.amazonaws.com/doc/2006-03-01/"><Name>bucket</Name>
<IsTruncated>true</IsTruncated><NextContinuationToken>{page}</NextContinuationToken>{keys}
</ListBucketResult>"""
_KEY = (
    "<Contents><Key>{page:09}-{key:04}.png</Key><ETag>x</ETag><Size>3</Size>"
    "<LastModified>2024-01-01T00:00:00.000Z</LastModified></Contents>"
)


class Pages(BaseHTTPRequestHandler):
    """Each page says that there is another one."""

    protocol_version = "HTTP/1.1"
    pages = itertools.count()
    keys = 1

    def do_GET(self):
        page = next(self.pages)
        keys = "".join(_KEY.format(page=page, key=key) for key in range(self.keys))
        body = _PAGE.format(page=page, keys=keys).encode()
        self.send_response(200)
        self.send_header("Content-Type", "application/xml")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        try:
            self.wfile.write(body)
        except OSError:
            self.close_connection = True

    def log_message(self, *_):
        pass


@pytest.mark.parametrize(
    ("keys", "limits", "kind", "says"),
    [
        (1, "request=1s", TransientError, "no end within 1 s, the limit request"),
        (1000, "listing=20MB", RsaDataError, r"at most 20\.0 MB.*RSA_DATA_LIMITS=listing"),
    ],
)
def test_a_listing_without_end_is_given_up(monkeypatch, keys, limits, kind, says):
    server = ThreadingHTTPServer(("127.0.0.1", 0), type("H", (Pages,), {"keys": keys}))
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, daemon=True).start()
    for name, value in {
        bounded.VARIABLE: limits,
        "AWS_ENDPOINT_URL_S3": f"http://127.0.0.1:{server.server_address[1]}",
        "AWS_ACCESS_KEY_ID": "a",
        "AWS_SECRET_ACCESS_KEY": "b",
        "AWS_DEFAULT_REGION": "us-east-1",
    }.items():
        monkeypatch.setenv(name, value)
    begun = time.monotonic()
    try:
        with pytest.raises(kind, match=says):
            ObjectStore("s3://bucket/root", "--root").list("")
    finally:
        server.shutdown()
        server.server_close()
    assert time.monotonic() - begun < 30

"""Servers on loopback that answer as none should; a process of its own, ended by its parent.

    python servers.py LOG     prints [port, other port]; LOG gets a line of JSON a request

The first part of a path is the name of an attack, which says how the server answers. The other
port stands for another origin: what comes there was led there.
"""

import contextlib
import gzip
import io
import json
import socket
import sys
import threading
import time
import zlib
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from PIL import Image

LOG = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("/dev/null")
LOCK = threading.Lock()


def image() -> bytes:
    file = io.BytesIO()
    Image.linear_gradient("L").resize((40, 30)).convert("RGB").save(file, "PNG")
    return file.getvalue()


GOOD = image()
SAID = json.dumps(
    {"choices": [{"message": {"content": "a room with a bed"}}], "usage": {}}
).encode()
MODELS = json.dumps({"data": [{"id": "eyes"}]}).encode()
# 10 GB of zeros, as gzip packs them twice: 10 MB.
BOMB = gzip.compress(b"\0" * (1 << 26), 1)


class Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: "Server"

    def handle(self) -> None:
        with contextlib.suppress(OSError):
            super().handle()

    def answer(self) -> None:
        length = self.headers.get("Content-Length") or "0"
        self.rfile.read(int(length))
        seen = {
            "path": self.path,
            "origin": self.server.role,
            "key": self.headers.get("Authorization") or "",
        }
        with LOCK, LOG.open("a") as file:
            file.write(json.dumps(seen) + "\n")
        _, kind, *rest = self.path.split("?")[0].split("/")
        below = "/".join(rest)
        if self.server.role == "other":
            self.send(200, SAID if "chat" in self.path else GOOD)
            return
        getattr(self, "_" + kind.split("-")[0])(kind.partition("-")[2], below)

    do_GET = do_POST = do_PUT = do_HEAD = do_DELETE = answer

    def send(
        self, status: int, body: bytes, kind: str = "application/json", **headers: str
    ) -> None:
        given = {"Content-Type": kind, "Content-Length": str(len(body))}
        given |= {name.replace("_", "-"): value for name, value in headers.items()}
        self.send_response(status)
        for name, value in given.items():
            self.send_header(name, value)
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    def raw(self, data: bytes) -> None:
        self.close_connection = True
        self.wfile.write(data)

    def log_message(self, *_: object) -> None:
        pass

    def _root(self, how: str, below: str) -> None:
        """Files below a root: a listing, two good images, and bad.png, which `how` spoils."""
        if how.startswith("list"):
            self.spoil(how[5:], below, self.page(below))
        elif not below:
            self.send(200, self.page(below), "text/html")
        elif below == "bad.png":
            self.spoil(how, below, GOOD)
        else:
            self.send(200, GOOD, "image/png")

    @staticmethod
    def page(below: str, names: tuple[str, ...] = ("a.png", "bad.png", "z.png")) -> bytes:
        return "".join(f'<a href="{name}">{name}</a>\n' for name in names).encode()

    def _vlm(self, how: str, below: str) -> None:
        """An OpenAI-compatible server, spoiled at its models (m_...) or at its answers."""
        models = below.endswith("models")
        if models != how.startswith("m_"):
            self.send(200, MODELS if models else SAID)
        else:
            self.spoil(how.removeprefix("m_"), below, MODELS if models else SAID)

    def _s3(self, how: str, below: str) -> None:
        """A bucket: its listing or its objects spoiled."""
        if "list-type" in self.path or below.count("/") == 0:
            self.spoil(
                how, below, _LISTING.format(keys=_keys("a.png", "bad.png", "z.png")).encode()
            )
        else:
            self.spoil(how, below, GOOD)

    def spoil(self, how: str, below: str, good: bytes) -> None:
        origin = f"http://127.0.0.1:{self.server.other}"
        junk = {
            "empty": b"",
            "text": b"nonsense",
            "null": b"null",
            "list": b"[]",
            "deep": b"[" * 200_000,
            "digits": b"9" * 5000,
            "binary": bytes(range(256)) * 40,
            "html": b"<html>error</html>",
            "control": SAID.replace(b"a room", b"\\u001b[31mred\\u0007\\u202e"),
            "surrogate": b'{"choices": [{"message": {"content": "\\ud800 bed"}}]}',
            "number": b'{"choices": [{"message": {"content": 3}}]}',
            "nochoice": b'{"choices": []}',
            "tokens": SAID.replace(b"{}", b'{"prompt_tokens": 1e400}'),
            "negative": SAID.replace(b"{}", b'{"prompt_tokens": -5}'),
            "models": b'{"data": [{"id": "\\u001b[31ma"}, {"id": "b"}]}',
            "nomodel": b'{"data": []}',
            "long": b'{"choices": [{"message": {"content": "' + b"bed " * 500_000 + b'"}}]}',
            "keys": _LISTING.format(
                keys=_keys("../../etc/passwd", "a\x7f.png", "/abs.png", "..", ".")
            ).encode(),
            "entities": b'<!DOCTYPE a [<!ENTITY b "x"><!ENTITY c "&b;&b;&b;&b;&b;&b;&b;&b;">'
            + b"".join(
                b'<!ENTITY d%d "&%s;&%s;&%s;&%s;&%s;&%s;">'
                % (n, *[b"c" if not n else b"d%d" % (n - 1)] * 6)
                for n in range(12)
            )
            + b"]><ListBucketResult>&d11;</ListBucketResult>",
            "links": self.page(
                "",
                (
                    "../../../etc/passwd",
                    "..%2f..%2fx.png",
                    "%2e%2e/",
                    "/etc/",
                    "//127.0.0.1/x",
                    "a%00.png",
                    "javascript:x",
                    "a%1b[31m.png",
                    "\x1b[31mb.png",
                ),
            ),
        }
        statuses = (
            204,
            206,
            301,
            304,
            400,
            401,
            402,
            403,
            404,
            413,
            418,
            429,
            451,
            500,
            503,
            599,
            999,
        )
        if how == "good":
            self.send(200, good)
        elif how in junk:
            self.send(
                200,
                junk[how],
                "text/html"
                if how == "links"
                else "application/xml"
                if b"List" in junk[how]
                else "application/json",
            )
        elif how.isdigit() and int(how) in statuses:
            self.send(int(how), b"\x1b[31mno\x07", **({"Location": "/"} if how == "301" else {}))
        elif how == "retryafter":
            self.send(429, b"", Retry_After="9" * 30)
        elif how == "retrydate":
            self.send(503, b"", Retry_After="Fri, 31 Dec 9999 23:59:59 GMT")
        elif how == "elsewhere":
            self.send(307, b"", Location=f"{origin}{self.path}")
        elif how == "found":
            self.send(302, b"", Location=f"{origin}{self.path}")
        elif how == "file":
            self.send(302, b"", Location="file:///etc/passwd")
        elif how == "ring":
            self.send(302, b"", Location=self.path)
        elif how == "spiral":
            self.send(302, b"", Location=self.path.split("?")[0] + f"?{time.time()}")
        elif how == "nolocation":
            self.send(302, b"")
        elif how == "crlf":
            self.raw(
                b"HTTP/1.1 302 X\r\nLocation: /x%0d%0aX: \x1b[31m\r\nContent-Length: 0\r\n\r\n"
            )
        else:
            self.broken(how, good)

    def broken(self, how: str, good: bytes) -> None:
        """What is not HTTP, or never ends."""
        start = b"HTTP/1.1 200 OK\r\nContent-Type: text/html\r\n"
        long = str(len(good)).encode()
        once = {
            "hangup": b"",
            "noise": bytes(range(256)) * 10,
            "status": b"HTTP/9.9 abc def\r\n\r\n",
            "length": start + b"Content-Length: abc\r\n\r\n" + good,
            "minus": start + b"Content-Length: -5\r\n\r\n" + good,
            "huge": start + b"Content-Length: 99999999999999999999\r\n\r\n" + good,
            "short": start
            + b"Content-Length: "
            + str(len(good) + 100).encode()
            + b"\r\n\r\n"
            + good,
            "twolengths": start + b"Content-Length: 3\r\nContent-Length: 9\r\n\r\n" + good,
            "chunk": start + b"Transfer-Encoding: chunked\r\n\r\nzzz\r\n" + good,
            "bigchunk": start + b"Transfer-Encoding: chunked\r\n\r\nffffffffffffffff\r\n" + good,
            "headers": start + b"".join(b"X-%d: y\r\n" % n for n in range(5000)) + b"\r\n",
            "longheader": start + b"X: " + b"y" * 10_000_000 + b"\r\n\r\n",
            "badgzip": start
            + b"Content-Encoding: gzip\r\nContent-Length: "
            + long
            + b"\r\n\r\n"
            + good,
            "encoding": start
            + b"Content-Encoding: bogus\r\nContent-Length: "
            + long
            + b"\r\n\r\n"
            + good,
            "charset": b"HTTP/1.1 200 OK\r\nContent-Type: text/html; charset=\x1b[31m\r\n"
            b"Content-Length: " + long + b"\r\n\r\n" + good,
            "half": start + b"Content-Length: " + long + b"\r\n\r\n" + good[: len(good) // 2],
            "reason": b"HTTP/1.1 403 \x1b[31mno\x07\r\nContent-Length: 0\r\n\r\n",
        }
        if how in once:
            self.raw(once[how])
            return
        self.close_connection = True
        if how == "silence":
            time.sleep(3600)
        elif how == "drip":
            self.wfile.write(start + b"Content-Length: 1000000\r\n\r\n")
            while True:
                self.wfile.write(b"x")
                time.sleep(0.5)
        elif how == "dripheaders":
            self.wfile.write(start)
            for number in range(100_000):
                self.wfile.write(b"X-%d: y\r\n" % number)
                time.sleep(0.5)
        elif how == "endless":
            self.wfile.write(start + b"\r\n")
            while True:
                self.wfile.write(good + bytes(1 << 20))
        elif how == "endlesschunks":
            self.wfile.write(start + b"Transfer-Encoding: chunked\r\n\r\n")
            while True:
                self.wfile.write(b"100000\r\n" + bytes(1 << 20) + b"\r\n")
        elif how == "bomb":
            self.wfile.write(start + b"Content-Encoding: gzip\r\n\r\n")
            for _ in range(160):  # members of a gzip file follow each other: 10 GB
                self.wfile.write(BOMB)
        elif how == "deflatebomb":
            self.wfile.write(start + b"Content-Encoding: deflate\r\n\r\n")
            pack = zlib.compressobj(1)
            for _ in range(160):
                self.wfile.write(pack.compress(bytes(1 << 26)))
            self.wfile.write(pack.flush())
        elif how == "folders":
            self.wfile.write(
                start + b"Connection: close\r\n\r\n" + self.page("", ("deeper/", "a.png"))
            )
        elif how == "wide":
            self.wfile.write(start + b"\r\n")
            for number in range(10**8):
                self.wfile.write(b'<a href="%d.png">x</a>\n' % number)
        elif how in ("pages", "longpages"):
            count = 1 if how == "pages" else 1000
            names = [f"{time.time_ns()}-{number}.png" for number in range(count)]
            body = _LISTING.format(keys=_keys(*names)).replace(
                "false",
                f"true</IsTruncated><NextContinuationToken>{time.time_ns()}</NextContinuationToken><IsTruncated>true",
            )
            self.wfile.write(
                b"HTTP/1.1 200 OK\r\nContent-Type: application/xml\r\nConnection: close\r\n\r\n"
                + body.encode()
            )
        else:
            self.wfile.write(b"HTTP/1.1 501 unknown attack\r\nContent-Length: 0\r\n\r\n")


_LISTING = (
    '<?xml version="1.0"?><ListBucketResult xmlns="http://s3.amazonaws.com/doc/2006-03-01/">'
    "<Name>bucket</Name><IsTruncated>false</IsTruncated>{keys}</ListBucketResult>"
)


def _keys(*names: str) -> str:
    about = "<LastModified>2024-01-01T00:00:00.000Z</LastModified><ETag>x</ETag><Size>300</Size>"
    return "".join(f"<Contents><Key>{name}</Key>{about}</Contents>" for name in names)


class Server(ThreadingHTTPServer):
    daemon_threads = True
    request_queue_size = 64

    def __init__(self, role: str):
        super().__init__(("127.0.0.1", 0), Handler)
        self.role, self.other = role, 0

    def handle_error(self, request: socket.socket, address: object) -> None:  # type: ignore[override]
        pass


def main() -> None:
    first, other = Server("first"), Server("other")
    first.other = other.server_address[1]
    for server in (first, other):
        threading.Thread(target=server.serve_forever, daemon=True).start()
    print(json.dumps([first.server_address[1], other.server_address[1]]), flush=True)
    threading.Event().wait()


if __name__ == "__main__":
    main()

"""A proxy that makes bad weather between a client and a server on this machine."""

import http.client
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer


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
        self.signed: list[bool] = []
        self.daemon_threads = True


class Forward(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: Weather

    def forward(self) -> None:
        body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
        trouble = self.server.troubles.pop(0) if self.server.troubles else ""
        self.server.seen.append(f"{self.command} {trouble}".strip())
        self.server.signed.append("Authorization" in self.headers)
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


@contextmanager
def weather_before(port: int) -> Iterator[Weather]:
    """The proxy before the server on `port`, for as long as the context lasts."""
    proxy = Weather(port)
    thread = threading.Thread(target=proxy.serve_forever, daemon=True)
    thread.start()
    try:
        yield proxy
    finally:
        proxy.shutdown()
        proxy.server_close()

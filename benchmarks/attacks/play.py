"""The playground: others' pages and names, sockets, uploads that are none or too large."""

import http.client
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from .harness import ACCEPTED, Attack
from .images import encoded, picture, png
from .world import World

# What a browser would send: (name, path, headers) that must be refused with 403.
STRANGERS: dict[str, dict[str, str]] = {
    "another host": {"Host": "evil.example"},
    "another host with the port": {"Host": "evil.example:{port}"},
    "another port": {"Host": "127.0.0.1:1"},
    "no port": {"Host": "127.0.0.1"},
    "a longer name": {"Host": "127.0.0.1:{port}.evil.example"},
    "another origin": {"Origin": "http://evil.example"},
    "no origin": {"Origin": "null"},
    "an origin by https": {"Origin": "https://127.0.0.1:{port}"},
    "an origin of another port": {"Origin": "http://127.0.0.1:1"},
}
_PLAY = ("play", "--work", "work", "--head", "head", "--no-show")
PATHS = {
    "page": "/",
    "socket": "/_nicegui_ws/socket.io/?EIO=4&transport=websocket",
    "polling": "/_nicegui_ws/socket.io/?EIO=4&transport=polling",
    "upload": "/_nicegui/client/0/upload/0",
}


class Page:
    """A page of its own process, for all attacks of this surface."""

    def __init__(self, world: World):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.log = (world.place / "play.log").open("wb")
        self.process = subprocess.Popen(
            [sys.executable, "-m", "rsa_data", *_PLAY, "--port", str(self.port)],
            cwd=world.base,
            stdout=self.log,
            stderr=self.log,
            start_new_session=True,
        )
        for _ in range(240):
            time.sleep(0.5)
            if self.ask("GET", "/", {})[0] == 200:
                return
            if self.process.poll() is not None:
                break
        raise SystemExit((world.place / "play.log").read_text()[-2000:])

    def ask(
        self, method: str, path: str, headers: dict[str, str], body: bytes = b""
    ) -> tuple[int, bytes]:
        """Status and body; 0 where the connection was shut."""
        sent = {"Host": f"127.0.0.1:{self.port}"}
        sent |= {name: value.format(port=self.port) for name, value in headers.items()}
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=20)
        try:
            connection.request(method, path, body, sent)
            answer = connection.getresponse()
            # A socket that was opened says nothing more.
            return answer.status, b"" if answer.status == 101 else answer.read()
        except (OSError, http.client.HTTPException):
            return 0, b""
        finally:
            connection.close()

    def stop(self) -> None:
        os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        self.log.close()


def attacks(world: World) -> Iterator[Attack]:
    """Each attack asks the page from a process of its own, and looks whether it still answers."""
    page = Page(world)
    upgrade = {
        "Connection": "Upgrade",
        "Upgrade": "websocket",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
    }

    def asked(name: str, expected: set[int], *call: object) -> Attack:
        def prepare(box: Path) -> None:
            status, body = page.ask(*call)  # type: ignore[arg-type]
            status = -1 if b"root:x:" in body else status
            alive, _ = page.ask("GET", "/favicon.ico", {})
            (box / "answer.json").write_text(json.dumps([status, alive]))

        def check(box: Path, said: str) -> str | None:
            status, alive = json.loads((box / "answer.json").read_text())
            if alive != 200:
                return f"the page answers {alive} afterwards"
            return None if status in expected else f"the page answers {status}, not {expected}"

        # The command is a formality: what is attacked is the page.
        return Attack(name, ("--version",), prepare, may=ACCEPTED, check=check)

    world.started.append(page.stop)
    yield asked("control: its own page", {200}, "GET", "/", {})
    yield asked(
        "control: its own socket", {101}, "GET", PATHS["socket"],
        {**upgrade, "Origin": "http://127.0.0.1:{port}"},
    )  # fmt: skip
    for place, path in PATHS.items():
        for name, headers in STRANGERS.items():
            method = "POST" if place == "upload" else "GET"
            given = {**upgrade, **headers} if place == "socket" else headers
            yield asked(f"{place}: {name}", {403, 0}, method, path, given)
    yield from uploads(asked)


def uploads(asked) -> Iterator[Attack]:  # type: ignore[no-untyped-def]
    """Bodies of requests to the place where pictures go."""
    kind = {"Content-Type": "multipart/form-data; boundary=x"}

    def form(data: bytes, name: str = "a.png") -> bytes:
        head = f'--x\r\nContent-Disposition: form-data; name="f"; filename="{name}"\r\n\r\n'
        return head.encode("utf-8", "surrogateescape") + data + b"\r\n--x--\r\n"

    bodies: dict[str, bytes] = {
        "nothing": b"",
        "no form": b"nonsense",
        "no end": form(b"x")[:-8],
        "no picture": form(b"nonsense"),
        "a picture": form(encoded(picture(), "PNG")),
        "60,000 x 60,000": form(png(60_000, 60_000)),
        "a name out of the folder": form(b"x", "../../../x.png"),
        "a name with NUL": form(b"x", "a\0.png"),
        "a name of control characters": form(b"x", "\x1b[31m.png"),
    }
    # Every address shows the page: an upload that nobody awaits is dropped.
    for name, body in bodies.items():
        yield asked(
            f"upload: {name}", {200, 400, 404, 405, 422, 500}, "POST", PATHS["upload"], kind, body
        )
    large = form(bytes(60_000_000))
    yield asked("upload: 60 MB", {413, 0}, "POST", PATHS["upload"], kind, large)
    lies = {**kind, "Content-Length": "99999999999999999999"}
    yield asked("upload: a length without end", {413, 400, 0}, "POST", PATHS["upload"], lies, b"x")
    yield asked(
        "upload: a length that is none",
        {413, 400, 0},
        "POST",
        PATHS["upload"],
        {**kind, "Content-Length": "abc"},
        b"x",
    )
    for path in (
        "/../../etc/passwd",
        "/%2e%2e/%2e%2e/etc/passwd",
        "/_nicegui/x/../../../etc/passwd",
        "/" + "a" * 60_000,
    ):
        yield asked(f"path {path[:20]}", {200, 400, 404, 414, 431, 0}, "GET", path, {})

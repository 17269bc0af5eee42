"""A stand-in for the Hugging Face hub on loopback."""

import http.server
import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest


class Hub(http.server.BaseHTTPRequestHandler):
    """As much of the hub as a data set needs: its commit, its tree, its files."""

    protocol_version = "HTTP/1.1"
    root: Path
    name = "owner/name"
    commit = "c" * 40

    def do_GET(self) -> None:
        self.answer(self.command == "GET")

    do_HEAD = do_GET

    def answer(self, body: bool) -> None:
        path = self.path.partition("?")[0]
        files = sorted(p.relative_to(self.root).as_posix() for p in self.root.rglob("*.*"))
        data, headers = b"", {"X-Repo-Commit": self.commit}
        api = f"/api/datasets/{self.name}"
        if path == api or path.startswith(f"{api}/revision/"):
            data = json.dumps({"id": self.name, "sha": self.commit}).encode()
        elif path.startswith(f"{api}/tree/{self.commit}"):
            tree = [
                {"type": "file", "path": f, "size": (self.root / f).stat().st_size, "oid": "0"}
                for f in files
            ]
            data = json.dumps(tree).encode()
        elif (name := path.rpartition(f"/resolve/{self.commit}/")[2]) in files:
            data = (self.root / name).read_bytes()
            headers["ETag"] = f'"{len(data)}-{name}"'.replace("/", "-")
        else:
            self.send_response(404)
            self.send_header("X-Error-Code", "RepoNotFound" if "/api/" in path else "EntryNotFound")
            self.send_header("Content-Length", "0")
            self.end_headers()
            return
        self.send_response(200)
        for key, value in {**headers, "Content-Length": str(len(data))}.items():
            self.send_header(key, value)
        self.end_headers()
        if body:
            self.wfile.write(data)

    def log_message(self, *_: object) -> None:
        pass


@contextmanager
def hub(root: Path, name: str = "owner/name") -> Iterator[str]:
    """Serves the files below `root` as the data set `name`; gives the address."""
    handler = type("Here", (Hub,), {"root": root, "name": name})
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_address[1]}"
        server.shutdown()


def surroundings(address: str, cache: Path) -> dict[str, str]:
    """Variables by which a new process finds it."""
    return {
        "HF_ENDPOINT": address,
        "HF_HOME": str(cache),
        "HF_HUB_DISABLE_XET": "1",
        "HF_HUB_DISABLE_PROGRESS_BARS": "1",
    }


def here(patch: pytest.MonkeyPatch, address: str, cache: Path) -> None:
    """Lets huggingface_hub find it in this process, where it may be loaded already."""
    from huggingface_hub import constants

    patch.setattr(constants, "ENDPOINT", address)
    patch.setattr(
        constants,
        "HUGGINGFACE_CO_URL_TEMPLATE",
        address + "/{repo_id}/resolve/{revision}/{filename}",
    )
    patch.setattr(constants, "HF_HUB_CACHE", str(cache))
    patch.setattr(constants, "HF_HUB_DISABLE_XET", True)

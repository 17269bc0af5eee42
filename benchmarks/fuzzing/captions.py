"""Captions from files and servers."""

import json
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from PIL import Image

from rsa_data.captions import imports, natural, served
from rsa_data.common import tokenizers
from rsa_data.common.errors import RsaDataError
from rsa_data.heads import checkpoint
from rsa_data.heads.predict import asking, from_captions, predict, prediction

from .forms import (
    Importer,
    One,
    cut,
    is_text,
    js,
    put,
    samples,
    shared,
)
from .heads import features_of, stand_in


def text_seeds() -> list[bytes]:
    files = [
        {"a.json": {"folder/train/a": ["a bed", "two beds"], "a": "An image."}},
        {"a.json": [{"key": "a.jpg", "text": "a room with a caf\u00e9"}]},
        {"a.csv": 'key,text\na,a bed\na.jpg,"a, b"\n'},
        {"texts/a.txt": "a bed\n\ntwo beds"},
    ]
    real = [cut(json.loads(d), 2) for d in shared("captions_nyu/*.json", most=3_000_000)]
    real = [dict(list(r.items())[:3]) if isinstance(r, dict) else r for r in real]
    return [js(file) for file in [*files, *({"a.json": r} for r in real)]]


def texts(here: Path) -> One:
    def one(data: bytes) -> None:
        put(here, data, ("a.json", "a.csv", "texts/a.txt"))
        for name in ("a.json", "a.csv", "texts"):
            try:
                read = imports.import_texts(str(here / name))
                made = natural.step(f"import:{name}", read, tokenizers.clip(), None)(samples())
            except RsaDataError:
                continue
            assert made["sample_id"].unique().to_pylist() == ["folder/train/a"]

    return one


def caption(here: Path) -> One:
    work, _ = stand_in(here)
    head = checkpoint.ScaleHead.load(f"{work.store.location}/heads/head")
    path = here / "captions.txt"

    def one(data: bytes) -> None:
        path.write_bytes(data)
        for text in [data.decode()] if is_text(data) else []:
            (found,) = from_captions.from_captions(head, [text], encoder=features_of)
            assert np.isfinite([found.scale, found.shift]).all() and found.lines
        with patch.object(asking, "from_scenes", just_texts):
            list(predict.predict(work, head="head", captions=path))

    return one


def just_texts(head: Any, scenes: list[Any], *_: object) -> list[Any]:
    return [prediction.Prediction(scene.text, 1.0, 1.0) for scene in scenes]


def answer_seeds() -> list[bytes]:
    message = {"choices": [{"message": {"role": "assistant", "content": "a bed\nand a lamp"}}]}
    usage = {"usage": {"prompt_tokens": 9, "completion_tokens": 4}}
    return [js({**message, **usage}), js({"data": [{"id": "m", "object": "model"}]})]


def answer(here: Path) -> One:
    """What a vision-language model's server answers."""
    said = b""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.rfile.read(int(self.headers.get("Content-Length") or 0))
            self.send_response(200)
            self.send_header("Content-Length", str(len(said)))
            self.end_headers()
            self.wfile.write(said)

        do_POST = do_GET

        def log_message(self, *_: object) -> None:
            pass

    web = HTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=web.serve_forever, daemon=True).start()
    server = served.Server(f"http://127.0.0.1:{web.server_port}", "?", wait=0.0)
    count = 0

    def one(data: bytes) -> None:
        nonlocal said, count
        said = data
        count += 1
        pixels = np.frombuffer(count.to_bytes(12, "big"), np.uint8).reshape(2, 2, 3)
        Image.fromarray(pixels).save(here / "a.png")  # a new one: answers are kept
        for act in (lambda: server.model(""), lambda: server.ask("m", here / "a.png")):
            try:
                act()
            except RsaDataError:
                continue
        for kept in (here.parent / "cache").rglob("*.json"):
            kept.unlink()

    return one


IMPORTERS = {
    "texts": Importer(text_seeds, texts),
    "caption": Importer(
        lambda: [
            b"a small bathroom with a sink, a mirror and a towel",
            b"An image.",
            "caf\u00e9 with 3 \U0001f6cf, x and y".encode(),
        ],
        caption,
        "text",
    ),
    "vlm-answer": Importer(answer_seeds, answer),
}

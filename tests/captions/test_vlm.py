"""Captions by a vision-language model, against a server on this machine that also misbehaves."""

import base64
import io
import json
import threading
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from PIL import Image
from rooms import NoBar, sample_rows

from rsa_data.captions import served, vlm, write
from rsa_data.captions.write import identity, notes
from rsa_data.common import options as options_of
from rsa_data.common.errors import RsaDataError, TransientError, UsageError
from rsa_data.runner import chains, stages
from rsa_data.runner.chains import RunOptions
from rsa_data.store import schemas
from rsa_data.store.tables import WorkDir, to_json

NAMES = ("a", "b", "c")


def said(text: str) -> tuple[int, bytes]:
    """A good answer."""
    usage = {"prompt_tokens": 300, "completion_tokens": 9}
    body = {"choices": [{"message": {"content": text}}], "usage": usage}
    return 200, json.dumps(body).encode()


class Fake:
    """A server whose answers are given by `reply(count, shade)`: status and body.

    count : questions so far about this picture, from 1. shade : of the picture, 0 to 255.
    """

    def __init__(self, reply: Callable, models: tuple[str, ...] = ("eyes",)):
        self.asked: list[dict] = []
        self.at_once = self.most_at_once = 0
        self.lock = threading.Lock()
        outer, counts = self, {}

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self):
                data = json.dumps({"data": [{"id": name} for name in models]}).encode()
                self.answer(200, data)

            def do_POST(self):
                body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
                url = body["messages"][0]["content"][1]["image_url"]["url"]
                pixels = Image.open(io.BytesIO(base64.b64decode(url.partition(",")[2])))
                shade = int(np.asarray(pixels).mean().round())
                with outer.lock:
                    outer.asked.append({**body, "key": self.headers["Authorization"]})
                    counts[shade] = counts.get(shade, 0) + 1
                    count = counts[shade]
                    outer.at_once += 1
                    outer.most_at_once = max(outer.most_at_once, outer.at_once)
                try:
                    self.answer(*reply(count, shade))
                finally:
                    with outer.lock:
                        outer.at_once -= 1

            def answer(self, status: int, data: bytes):
                if status == 0:  # hangs up
                    self.close_connection = True
                    return
                self.send_response(status)
                self.send_header("Content-Length", str(len(data)))
                self.send_header("Retry-After", "0")
                self.end_headers()
                self.wfile.write(data)

            def log_message(self, *_):
                pass

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        threading.Thread(target=self.server.serve_forever, daemon=True).start()
        self.address = f"http://127.0.0.1:{self.server.server_port}"


@pytest.fixture
def fake(monkeypatch, tmp_path):
    """Makes servers; their answers are cached below tmp_path, and nobody waits between tries."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(served.time, "sleep", lambda seconds: None)
    made = []

    def make(reply: Callable, **options) -> Fake:
        made.append(Fake(reply, **options))
        return made[-1]

    yield make
    for one in made:
        one.server.shutdown()
        one.server.server_close()


@pytest.fixture
def root(tmp_path) -> Path:
    for k, name in enumerate(NAMES):
        shade = np.full((8, 9, 3), 50 * k + 50, np.uint8)
        (tmp_path / "files").mkdir(exist_ok=True)
        Image.fromarray(shade).save(tmp_path / "files" / f"{name}.png")
    return tmp_path / "files"


def samples(names=NAMES) -> pa.Table:
    rows = sample_rows([f"rooms/train/0/{name}" for name in names])
    image = rows.schema.get_field_index("image")
    return rows.set_column(image, "image", pa.array([f"{name}.png" for name in names]))


def texts(root: Path, server: Fake, names=NAMES, **options) -> list[str]:
    made = options_of.call(write.build, style="vlm", endpoint=server.address, root=root, **options)(
        samples(names)
    )
    schemas.check("captions", made)
    return made["text"].to_pylist()


def test_each_image_gets_what_the_model_says(root, fake):
    server = fake(lambda count, shade: said(f"A room\n of shade {shade}. "))
    assert texts(root, server) == [f"A room of shade {shade}." for shade in (50, 100, 150)]
    asked = server.asked[0]
    assert (asked["model"], asked["temperature"], asked["key"]) == ("eyes", 0, None)
    assert asked["seed"] == 0  # always the same: with temperature 0, the same answer again
    assert asked["messages"][0]["content"][0]["text"] == vlm.prompt_of(None)


def test_no_picture_is_asked_about_twice(root, fake, tmp_path):
    server = fake(lambda count, shade: said(f"Answer {count}"))
    assert texts(root, server) == texts(root, server) == ["Answer 1"] * 3
    assert len(server.asked) == 3
    question = tmp_path / "question.txt"
    question.write_text("What is this?")
    assert texts(root, server, prompt=question) == ["Answer 2"] * 3


@pytest.mark.parametrize(
    "bad",
    [(500, b"oops"), (429, b"slow down"), (503, b""), (200, b"not JSON"), (0, b"")],
    ids=["500", "429", "503", "garbage", "hangs-up"],
)
def test_a_server_in_trouble_is_asked_again(root, fake, bad):
    server = fake(lambda count, shade: bad if count < 3 else said("A room."))
    assert texts(root, server) == ["A room."] * 3


def test_a_server_that_stays_in_trouble_leaves_the_part_undone(root, fake):
    server = fake(lambda count, shade: (503, b""))
    with pytest.raises(TransientError, match="status 503, 5 times"):
        texts(root, server)


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        # RFC 9110: bad, too large, of an unsupported kind, or not to be processed.
        *(((n, b""), f"the server refused the picture: status {n}") for n in (400, 413, 415, 422)),
        (said("  "), "the model gave no text"),
        ((200, b'{"choices": []}'), "the model gave no text"),
        ((200, b'[1]'), "the model gave no text"),
    ],
    ids=["400", "413", "415", "422", "empty", "no-choices", "a-list"],
)  # fmt: skip
def test_an_image_without_an_answer_is_set_aside(root, fake, bad, reason):
    server = fake(lambda count, shade: bad if shade == 100 else said("A room."))
    made = options_of.call(write.build, style="vlm", endpoint=server.address, root=root)(samples())
    assert made["text"].to_pylist() == ["A room.", "An image.", "A room."]
    audit = json.loads(made.schema.metadata[b"audit"])
    assert audit["failed"] == {"rooms/train/0/b": reason}
    assert (audit["prompt_tokens"], audit["text_tokens"]) == (600, 18)


def test_a_broken_image_is_set_aside_and_not_sent(root, fake):
    (root / "b.png").write_bytes(b"not an image")
    server = fake(lambda count, shade: said("A room."))
    made = options_of.call(write.build, style="vlm", endpoint=server.address, root=root)(samples())
    assert made["text"].to_pylist()[1] == "An image."
    assert len(server.asked) == 2


def test_wrong_key_or_address_ends_the_run(root, fake, monkeypatch):
    monkeypatch.setenv(served.KEY, "secret")
    server = fake(lambda count, shade: (401, b""))
    with pytest.raises(RsaDataError, match=r"status 401.*RSA_DATA_VLM_KEY") as error:
        texts(root, server)
    assert "secret" not in str(error.value)
    assert server.asked[0]["key"] == "Bearer secret"


def test_model_must_be_named_where_there_are_several(root, fake):
    server = fake(lambda count, shade: said("x"), models=("one", "two"))
    with pytest.raises(UsageError, match="serves one, two: name one"):
        texts(root, server)
    options_of.call(write.build, style="vlm:two", endpoint=server.address, root=root)(samples())
    assert {asked["model"] for asked in server.asked} == {"two"}


def test_asks_no_more_at_once_than_allowed(root, fake):
    server = fake(lambda count, shade: said("A room."))
    texts(root, server, concurrency=1)
    assert server.most_at_once == 1


def test_rate_gives_each_question_its_turn(root, fake, monkeypatch):
    waits: list[float] = []
    monkeypatch.setattr(served.time, "sleep", waits.append)
    monkeypatch.setattr(served.time, "monotonic", lambda: 100.0)
    server = served.Server(fake(lambda count, shade: said("x")).address, "q", rate=2.0)
    for picture in sorted(root.glob("*.png"))[:3]:
        server.ask("eyes", picture)
    assert waits == [0.0, 0.5, 1.0]


def test_model_and_prompt_decide_what_the_texts_are(root, fake, tmp_path):
    server = fake(lambda count, shade: said("x"))
    about = identity(style="vlm", endpoint=server.address)
    assert about["vlm_model"] == "eyes"
    question = tmp_path / "question.txt"
    question.write_text("What is this?")
    assert identity(style="vlm", endpoint=server.address, prompt=question) != about


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "needs --endpoint"),
        ({"endpoint": "localhost:1"}, "expected http"),
        (
            {"endpoint": "http://127.0.0.1:9", "concurrency": 0},
            "concurrency: expected a whole",
        ),
        ({"endpoint": "http://127.0.0.1:9", "prompt": Path("none.txt")}, "--prompt none.txt"),
    ],
)
def test_wrong_options_are_refused(root, options, message):
    with pytest.raises(UsageError, match=message):
        options_of.call(write.build, style="vlm", root=root, **options)


def test_through_the_pipeline_with_costs_in_the_summary(root, fake, tmp_path):
    server = fake(lambda count, shade: said("x") if shade != 100 else (400, b""))
    work = WorkDir(tmp_path / "work")
    how = RunOptions(NoBar, lambda *a: None)
    name = chains.samples(work, "folder:rooms", {}, root=root)
    options = {"style": "vlm", "endpoint": server.address, "prices": "1000,2000"}
    asked = stages.bind("captions", options)
    summary = chains.chain(work, asked, name, how, root=root)
    assert summary.notes[0] == (
        "The model read 600 tokens, images included, and wrote 18. At --prices 1000,2000 that is "
        "0.636."
    )
    assert summary.notes[1].startswith("1 image has no text and got 'An image.'")
    assert work.tables(name) == ["captions/vlm", "samples"]
    about = work.table(name, "captions/vlm").description()
    assert about.identity["vlm_model"] == "eyes"
    assert server.address not in to_json(about).decode()
    receipt = work.table(name, "captions/vlm").receipt(0)
    assert list(receipt.audit["failed"]) == ["rooms/train/b"]
    again = chains.chain(work, asked, name, how, root=root)
    assert again.done == 0


def test_notes_name_texts_that_are_too_long(root, fake):
    server = fake(lambda count, shade: said("word " * 100))
    made = options_of.call(write.build, style="vlm", endpoint=server.address, root=root)(samples())
    lines = notes([made], samples(), style="vlm", endpoint=server.address)
    assert any("3 of 3 texts are longer than the 77 tokens" in line for line in lines)

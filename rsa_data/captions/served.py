"""A vision-language model behind an OpenAI-compatible address (vLLM, llama.cpp, Ollama, ...)."""

import base64
import hashlib
import io
import json
import os
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..common import bounded, files, http, requests
from ..common.errors import RowError, RsaDataError, TransientError, UsageError

# px of the longer side that a model is shown; most resize to less.
_SIDE = 1024
_TRIES, _SECONDS, _LONGEST_WAIT = 5, 120.0, 30.0
_MOST_TOKENS = 160
KEY = "RSA_DATA_VLM_KEY"


@dataclass(frozen=True)
class Answer:
    """What a model said of a picture. tokens : of prompt with picture, and of the text."""

    text: str
    prompt_tokens: int
    text_tokens: int


class Server:
    """An address to ask; its answers are kept on disk, so that no picture is asked about twice.

    address : such as http://127.0.0.1:8000/v1, with or without /v1.
    rate : most requests a second, 0 for no limit; over all threads of this process.
    """

    def __init__(self, address: str, prompt: str, rate: float = 0.0, wait: float = 1.0):
        base = address.rstrip("/")
        if not http.is_address(base):
            raise UsageError(
                "--endpoint: expected http://HOST... or https://HOST... without a user name; found "
                f"{http.hidden(address)!r}"
            )
        self.base = base if base.endswith("/v1") else base + "/v1"
        self.prompt, self.rate, self.wait = prompt, rate, wait
        # Once a request, and redirects are not followed: the key goes to this address alone.
        self.client = http.client(self.base, tries=0, read=_SECONDS)
        self.lock, self.next = threading.Lock(), 0.0

    def model(self, wanted: str) -> str:
        """The model asked for, or the only one that is served."""
        if wanted:
            return wanted
        try:
            names = [str(entry["id"]) for entry in self._send("/models", None)["data"]]
        except (KeyError, TypeError, RowError) as error:
            raise RsaDataError(
                f"{self.base}/models: expected a list of models; name one: --style vlm:MODEL"
            ) from error
        if len(names) != 1:
            raise UsageError(f"{self.base} serves {', '.join(names) or 'no model'}: name one: "
                             "--style vlm:MODEL")  # fmt: skip
        return names[0]

    def ask(self, model: str, path: Path) -> Answer:
        """What the model says of an image file, from the cache where it was asked before.

        Raises RowError when this image cannot be asked about, or the model has no answer to it;
        TransientError when the server does not answer in time; RsaDataError when it will not.
        """
        from ..datasets.images import read_bytes, read_image

        # Models of the same name at two servers may differ.
        identity = [_MOST_TOKENS, _SIDE, self.base, model, self.prompt]
        key = hashlib.sha256(json.dumps(identity).encode() + read_bytes(path)).hexdigest()
        kept = files.cache_folder("vlm") / key[:2] / f"{key}.json"
        if kept.is_file():
            try:
                return Answer(**json.loads(kept.read_text("utf-8")))
            except (ValueError, TypeError):
                kept.unlink(missing_ok=True)  # cut off by a crash
        answer = self._answer(model, _jpeg(read_image(path)))
        files.write(kept, json.dumps(vars(answer)).encode())
        return answer

    def _answer(self, model: str, jpeg: bytes) -> Answer:
        url = "data:image/jpeg;base64," + base64.b64encode(jpeg).decode()
        content = [
            {"type": "text", "text": self.prompt},
            {"type": "image_url", "image_url": {"url": url}},
        ]
        request = {
            "model": model,
            "messages": [{"role": "user", "content": content}],
            "temperature": 0,
            "seed": 0,
            "max_tokens": _MOST_TOKENS,
        }
        for _ in range(2):  # a model that answers nonsense twice will do so again
            found = self._send("/chat/completions", request)
            try:
                text = " ".join(found["choices"][0]["message"]["content"].split())
                usage = found.get("usage") or {}
                if text:
                    return Answer(text, int(usage.get("prompt_tokens") or 0),
                                  int(usage.get("completion_tokens") or 0))  # fmt: skip
            except (KeyError, IndexError, TypeError, AttributeError, ValueError,
                    OverflowError):  # fmt: skip
                continue
        raise RowError("the model gave no text")

    def _send(self, path: str, body: dict[str, Any] | None) -> Any:
        """JSON of one request, tried again while the server is busy or away."""
        from urllib3.exceptions import HTTPError

        headers = {**self.client.headers, "Content-Type": "application/json"}
        if key := os.environ.get(KEY):
            if not (key.isascii() and key.isprintable() and len(key) < 8192):
                raise RsaDataError(f"{KEY}: expected a key of printable ASCII characters")
            headers["Authorization"] = f"Bearer {key}"
        data = None if body is None else json.dumps(body).encode()
        why = ""
        for attempt in range(_TRIES):
            self._take_turn()
            asked = self.wait * 2**attempt
            try:
                answer = requests.once(
                    self.client,
                    "GET" if data is None else "POST",
                    self.base + path,
                    "answer",
                    headers=headers,
                    body=data,
                )
                if answer.status == 200:
                    return bounded.parse_json(answer.data)
                why = f"status {answer.status}"
                if answer.status in (400, 413, 415, 422):
                    raise RowError(f"the server refused the picture: {why}")
                if answer.status not in (408, 409, 425, 429) and answer.status < 500:
                    raise RsaDataError(
                        f"{self.base}{path}: {why}. Is the address right, the model's name, and "
                        f"the key in {KEY}?"
                    )
                asked = max(asked, _retry_after(answer.headers))
            except bounded.Refused as error:
                raise RowError(f"the model's answer: {error}") from error
            except (HTTPError, OSError) as error:
                why = http.reason(error)
            except ValueError:
                why = "an answer that is not JSON"
            if attempt < _TRIES - 1:
                time.sleep(min(asked, _LONGEST_WAIT))
        raise TransientError(f"{self.base}{path}: {why}, {_TRIES} times; the part can be run again")

    def _take_turn(self) -> None:
        if not self.rate:
            return
        with self.lock:
            now = time.monotonic()
            turn = max(now, self.next)
            self.next = turn + 1 / self.rate
        time.sleep(turn - now)


def _retry_after(headers: Mapping[str, str]) -> float:
    try:
        return max(0.0, float(headers.get("Retry-After", "0")))
    except ValueError:
        return 0.0


def _jpeg(pixels: Any) -> bytes:
    from PIL import Image

    image = Image.fromarray(pixels)
    image.thumbnail((_SIDE, _SIDE), Image.Resampling.LANCZOS)
    file = io.BytesIO()
    image.save(file, "JPEG", quality=90)
    return file.getvalue()

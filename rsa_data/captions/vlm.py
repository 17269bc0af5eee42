"""Captions that a vision-language model writes of each image: the style `vlm`."""

import hashlib
import json
import math
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa

from ..common import bounded
from ..common.errors import RowError, UsageError
from ..common.numbers import reals
from ..common.progress import advance
from ..common.ranges import Amount, AtOnce
from ..common.tokenizers import Tokenizer
from . import natural
from .served import Server


@dataclass(frozen=True, kw_only=True)
class Asked:
    """The model of the style vlm, and how to ask it.

    endpoint : address of an OpenAI-compatible server, for the style vlm.
    prompt : file with the question to the model; a shipped one by default.
    concurrency : questions to the model at once.
    rate : most questions a second; 0 for no limit.
    prices : of a million tokens of questions and answers, as IN,OUT, for the summary.
    """

    endpoint: str | None = None
    prompt: Path | None = None
    concurrency: AtOnce = 4
    rate: Amount = 0.0
    prices: str | None = None


class Style:
    """vlm, or vlm:MODEL: what a model at --endpoint says of each picture.

    A server that serves one model needs no name. The key, where one is needed, stands in the
    environment variable RSA_DATA_VLM_KEY.
    """

    version = 1

    def model(self, argument: str, asked: Asked) -> tuple[Server, str]:
        """The server and its model; raises UsageError without an address."""
        if not asked.endpoint:
            raise UsageError("captions: the style vlm needs --endpoint, such as "
                             "http://127.0.0.1:8000/v1")  # fmt: skip
        if asked.prices is not None:
            parse_prices(asked.prices)  # wrong ones are not found out after the last answer
        server = Server(asked.endpoint, prompt_of(asked.prompt), asked.rate)
        return server, server.model(argument)

    def identity(self, argument: str, asked: Asked) -> dict[str, str]:
        """What the texts follow from: model and prompt."""
        server, model = self.model(argument, asked)
        prompt = hashlib.sha256(server.prompt.encode()).hexdigest()
        return {"vlm_model": model, "vlm_prompt": prompt}

    def step(
        self, argument: str, asked: Asked, tokenizer: Tokenizer, root: Path | None
    ) -> Callable[..., pa.Table]:
        """A step from samples to captions, one text an image."""
        if root is None:
            raise UsageError("captions: the style vlm looks at the images: give --root")
        server, model = self.model(argument, asked)

        def write(*inputs: pa.Table) -> pa.Table:
            samples = inputs[-1]
            ids, images = samples["sample_id"].to_pylist(), samples["image"].to_pylist()
            texts: dict[str, list[str]] = {}
            failed: dict[str, str] = {}
            spent = [0, 0]

            def one(image: str | None) -> Any:
                try:
                    if image is None:
                        raise RowError("the index names no image")
                    return server.ask(model, root / image)
                except RowError as error:
                    return error
                finally:
                    advance(1)

            with ThreadPoolExecutor(asked.concurrency) as pool:
                for sample_id, found in zip(ids, pool.map(one, images), strict=True):
                    if isinstance(found, RowError):
                        failed[sample_id] = str(found)
                        continue
                    texts[sample_id] = [found.text]
                    spent = [spent[0] + found.prompt_tokens, spent[1] + found.text_tokens]
            table = natural.write_texts("vlm", samples, [texts.get(i) for i in ids], tokenizer)
            audit = {"prompt_tokens": spent[0], "text_tokens": spent[1], "failed": failed}
            about = {b"audit": json.dumps(audit, sort_keys=True).encode()}
            return table.replace_schema_metadata({**(table.schema.metadata or {}), **about})

        return write


vlm = Style()


def prompt_of(file: Path | None) -> str:
    """The question: of a file, or the one that is shipped."""
    place = file or Path(__file__).with_name("vlm_prompt.txt")
    try:
        text = bounded.read_text(place).strip()
    except OSError as error:
        raise UsageError(f"--prompt {place}: expected a text file in UTF-8: {error}") from error
    if not text:
        raise UsageError(f"--prompt {place}: expected a question; found an empty file")
    return text


def cost_lines(captions: Iterable[pa.Table], prices: str | None) -> list[str]:
    """Tokens and cost of parts, from what their steps left in the metadata.

    prices : of a million tokens of questions and of answers, as IN,OUT in any currency.
    """
    asked = answered = 0
    for table in captions:
        audit = json.loads((table.schema.metadata or {}).get(b"audit", b"{}"))
        asked += audit.get("prompt_tokens", 0)
        answered += audit.get("text_tokens", 0)
    lines = [f"The model read {asked:,} tokens, images included, and wrote {answered:,}."]
    if prices:
        one, other = parse_prices(prices)
        lines[0] += f" At --prices {prices} that is {(asked * one + answered * other) / 1e6:,.4g}."
    return lines


def parse_prices(text: str) -> tuple[float, float]:
    """The two prices of --prices IN,OUT."""
    try:
        one, other = reals(text, 2)
        if 0 <= one < math.inf and 0 <= other < math.inf:
            return one, other
    except ValueError:
        pass
    raise UsageError(f"--prices: expected IN,OUT as in 0.15,0.60; found {text!r}")

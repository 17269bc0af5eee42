"""The server of a vision-language model: answers that are none, and a key that must not leave."""

from collections.abc import Callable, Iterator
from pathlib import Path

from .harness import ACCEPTED, CONTAINED, KEY, REFUSED, Attack
from .images import folder, picture
from .roots import PATIENCE
from .world import World

ANSWERS = (
    "empty",
    "text",
    "null",
    "list",
    "deep",
    "digits",
    "binary",
    "html",
    "control",
    "surrogate",
    "number",
    "nochoice",
    "tokens",
    "negative",
    "long",
    "204",
    "400",
    "401",
    "403",
    "404",
    "413",
    "429",
    "500",
    "503",
    "999",
    "retryafter",
    "retrydate",
    "elsewhere",
    "found",
    "file",
    "ring",
    "spiral",
    "nolocation",
    "crlf",
    "hangup",
    "noise",
    "status",
    "length",
    "minus",
    "huge",
    "short",
    "twolengths",
    "chunk",
    "bigchunk",
    "headers",
    "longheader",
    "badgzip",
    "encoding",
    "half",
    "reason",
    "silence",
    "drip",
    "dripheaders",
    "endless",
    "endlesschunks",
    "bomb",
    "deflatebomb",
)
MODELS = (
    "empty",
    "text",
    "null",
    "list",
    "deep",
    "digits",
    "binary",
    "nomodel",
    "models",
    "401",
    "500",
    "elsewhere",
    "found",
    "file",
    "ring",
    "hangup",
    "noise",
    "length",
    "silence",
    "drip",
    "endless",
    "bomb",
)


def attacks(world: World) -> Iterator[Attack]:
    environment = {"RSA_DATA_VLM_KEY": KEY, "RSA_DATA_LIMITS": "request=6s"}

    def words(name: str, model: bool) -> tuple[str, ...]:
        return (
            "captions",
            "--work",
            "work",
            "--dataset",
            "folder:own",
            "--root",
            "in",
            "--style",
            "vlm:eyes" if model else "vlm",
            "--endpoint",
            f"http://127.0.0.1:{world.port}/vlm-{name}",
            "--concurrency",
            "3",
        )

    def leaked(name: str) -> Callable[[Path, str], str | None]:
        def check(box: Path, said: str) -> str | None:
            led = [seen for seen in world.told(f"/vlm-{name}/") if seen["origin"] == "other"]
            if any(KEY in seen["key"] for seen in led):
                return "the key went to another origin"
            return "a picture went to another origin" if led else None

        return check

    def pictures(box: Path) -> None:
        folder(box, lambda p: picture().save(p))

    yield Attack(
        "control: a good server",
        words("good", False),
        pictures,
        may=ACCEPTED,
        environment=environment,
    )
    fine = {
        "control",
        "surrogate",
        "tokens",
        "negative",
        "long",
        "twolengths",
        "length",
        "minus",
        "encoding",
    }
    for name in ANSWERS:
        yield Attack(
            f"answer: {name}",
            words(name, True),
            pictures,
            may=CONTAINED | ACCEPTED if name in fine else CONTAINED,
            check=leaked(name),
            deadline=PATIENCE,
            environment=environment,
        )
    for name in MODELS:
        yield Attack(
            f"models: {name}",
            words(f"m_{name}", False),
            pictures,
            may=REFUSED | ACCEPTED if name == "length" else REFUSED,
            check=leaked(f"m_{name}"),
            deadline=PATIENCE,
            environment=environment,
        )
    for number, key in enumerate(("a\nb", "\x1b[31m", "k" * 100_000, "ключ", "a\r\nX: y")):
        yield Attack(
            f"key {number}",
            words("good", True),
            pictures,
            may=CONTAINED,
            environment={"RSA_DATA_VLM_KEY": key},
        )
    for number, address in enumerate(
        (
            "",
            "x",
            "file:///etc/passwd",
            "ftp://x/",
            "http://",
            "http://127.0.0.1:1/",
            f"http://u:{KEY}@127.0.0.1:1/",
            "http://a\x1b[31m/",
            "http://[::1/",
        )
    ):
        yield Attack(
            f"address {number}",
            (*words("x", True)[:-4], "--endpoint", address),
            pictures,
            deadline=PATIENCE,
            environment={"RSA_DATA_VLM_KEY": KEY + "2"},
            may=CONTAINED,
        )
    prompts = {"not UTF-8": b"\xff", "empty": b"", "NUL": b"\0"}
    for name, data in prompts.items():
        yield Attack(
            f"prompt: {name}",
            (*words("good", True), "--prompt", "p.txt"),
            lambda b, d=data: (pictures(b), (b / "p.txt").write_bytes(d)),
            environment=environment,
            may=CONTAINED | ACCEPTED if name == "NUL" else CONTAINED,
        )

"""Roots on web servers: answers that are none, lie, lead elsewhere or never end."""

from collections.abc import Iterator

from .harness import ACCEPTED, ANY, CONTAINED, Attack
from .world import World

# A client goes on for about a minute and a half while a server fails; what drips has its deadline.
PATIENCE = 200.0
# Shorter deadlines, as a user may set them, so that a run of all attacks ends in minutes.
SHORT = {"RSA_DATA_LIMITS": "request=6s"}

FILES = (
    "empty",
    "text",
    "binary",
    "html",
    "control",
    "deep",
    "204",
    "206",
    "304",
    "400",
    "401",
    "403",
    "404",
    "418",
    "451",
    "999",
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
    "503",
    "retryafter",
    "retrydate",
)
LISTS = (
    "empty",
    "text",
    "binary",
    "html",
    "204",
    "403",
    "404",
    "500",
    "elsewhere",
    "file",
    "ring",
    "spiral",
    "links",
    "charset",
    "hangup",
    "noise",
    "length",
    "silence",
    "drip",
    "endless",
    "endlesschunks",
    "bomb",
    "folders",
    "wide",
)


def attacks(world: World) -> Iterator[Attack]:
    def words(name: str) -> tuple[str, ...]:
        root = f"http://127.0.0.1:{world.port}/root-{name}"
        return (
            "embed-images",
            "--work",
            "work",
            "--dataset",
            "folder:own",
            "--root",
            root,
            "--encoder",
            "thumbnail",
        )

    yield Attack(
        "control: a good server", words("good"), may=CONTAINED | ACCEPTED, says="3 samples ok"
    )
    # Another origin may hold an image as well as this one: no key goes there. What has no length
    # may be whole.
    fine = {"elsewhere", "found", "206", "twolengths", "length", "minus", "encoding"}
    for name in FILES:
        yield Attack(
            f"file: {name}",
            words(name),
            may=CONTAINED | ACCEPTED if name in fine else CONTAINED,
            deadline=PATIENCE,
            environment=SHORT,
        )
    for name in LISTS:
        yield Attack(
            f"listing: {name}",
            words(f"list_{name}"),
            may=ANY if name in ("links", "charset") else CONTAINED,
            deadline=PATIENCE,
            environment=SHORT,
        )
    for number, root in enumerate(
        (
            "http://",
            "https://user:secret@127.0.0.1/x",
            "http://127.0.0.1:1/x",
            "http://127.0.0.1:99999/x",
            "http://[::1/x",
            "http://127.0.0.1/x?y=1",
            "http://127.0.0.1/#x",
            "file:///etc",
            "gopher://x/",
            "http://a\x1b[31m/",
            "http://a b/",
            f"https://127.0.0.1:{world.port}/root-good",
            "http://" + "a" * 300 + "/",
            "http://.../",
            "://x",
        )
    ):
        yield Attack(
            f"address {number}",
            (
                "embed-images",
                "--work",
                "work",
                "--dataset",
                "folder:own",
                "--root",
                root,
                "--encoder",
                "thumbnail",
            ),
            deadline=PATIENCE,
            environment=SHORT,
        )

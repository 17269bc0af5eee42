"""Buckets: work dirs and roots at an S3 endpoint that fails, lies or never ends."""

from collections.abc import Iterator

from .harness import ANY, CONTAINED, KEY, Attack
from .roots import PATIENCE
from .world import World

HOW = (
    "empty",
    "text",
    "null",
    "deep",
    "binary",
    "entities",
    "keys",
    "204",
    "301",
    "400",
    "401",
    "403",
    "500",
    "503",
    "999",
    "elsewhere",
    "found",
    "file",
    "ring",
    "spiral",
    "hangup",
    "noise",
    "length",
    "huge",
    "short",
    "chunk",
    "bigchunk",
    "longheader",
    "silence",
    "drip",
    "endless",
    "bomb",
    "pages",
    "longpages",
    "retryafter",
)


def attacks(world: World) -> Iterator[Attack]:
    def environment(name: str) -> dict[str, str]:
        address = f"http://127.0.0.1:{world.port}/s3-{name}"
        return {
            "AWS_ENDPOINT_URL_S3": address,
            "AWS_ENDPOINT_URL": address,
            "AWS_ACCESS_KEY_ID": "test",
            "AWS_SECRET_ACCESS_KEY": KEY,
            "AWS_DEFAULT_REGION": "us-east-1",
            "AWS_ALLOW_HTTP": "true",
            "RSA_DATA_LIMITS": "request=6s",
        }

    for name in HOW:
        yield Attack(
            f"work dir: {name}",
            ("status", "--work", "s3://bucket/work"),
            deadline=PATIENCE,
            environment=environment(name),
            may=ANY if name in ("keys", "elsewhere", "found") else CONTAINED,
        )
        yield Attack(
            f"root: {name}",
            (
                "embed-images",
                "--work",
                "work",
                "--dataset",
                "folder:own",
                "--root",
                "s3://bucket/root",
                "--encoder",
                "thumbnail",
            ),
            deadline=PATIENCE,
            environment=environment(name),
            may=ANY if name in ("keys", "elsewhere", "found") else CONTAINED,
            check=lambda box, said: "it wrote outside" if (box / "esc").exists() else None,
        )
    for number, place in enumerate(
        (
            "s3://",
            "s3:///x",
            "s3://b/../x",
            "s3://a b/",
            "s3://\x1b[31m/",
            "s3://" + "b" * 300,
            "gs://",
            "az://",
            "s3x://b/x",
            "S3://b",
        )
    ):
        yield Attack(
            f"place {number}",
            ("status", "--work", place),
            environment=environment("empty"),
            deadline=PATIENCE,
        )

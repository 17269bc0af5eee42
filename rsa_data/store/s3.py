"""A store in an S3 bucket: one PUT a file, and a conditional PUT where only the first may win."""

import time
from collections.abc import Callable
from typing import Any, TypeVar

import pyarrow as pa

from ..common.errors import RsaDataError, TransientError
from ..common.extras import extras
from .failpoints import failpoint

T = TypeVar("T")

# Tries of one request, with back-off that doubles up to 20 s (botocore's standard mode): about a
# minute and a half in all, longer than S3 takes to scale a prefix up.
_TRIES = 10

# Tries of a request whose answer broke off in its body, which botocore leaves to its caller.
_BODY_TRIES = 5

# A log is one object that grows: it is put again at most this often, in seconds.
_LOG_EVERY = 30.0

_PASSING = frozenset(
    {"RequestTimeout", "SlowDown", "InternalError", "ServiceUnavailable", "OperationAborted"}
)


class S3Store:
    """Objects under s3://BUCKET/PREFIX, by boto3.

    Credentials, region and endpoint come from where boto3 looks for them: the environment
    (AWS_ACCESS_KEY_ID, AWS_ENDPOINT_URL_S3 ...), ~/.aws, or the machine's role.
    """

    at_once = 32

    def __init__(self, location: str, option: str = "--work"):
        self.location = location.rstrip("/")
        bucket, _, prefix = location.removeprefix("s3://").rstrip("/").partition("/")
        if not bucket:
            raise RsaDataError(f"{option} {location}: expected s3://BUCKET/PREFIX")
        self.bucket, self.prefix = bucket, prefix + "/" if prefix else ""
        self.client = _client(option)
        self.logs: dict[str, tuple[list[bytes], float]] = {}

    def read(self, path: str) -> bytes | None:
        def get() -> bytes:
            # The body is read in here, so that a connection cut half-way is tried again.
            return self.client.get_object(**self._at(path))["Body"].read()

        return self._ask("read", path, get, missing=None)

    def head(self, path: str, most: int) -> bytes | None:
        """The first `most` bytes of the file, or None when there is none."""

        def get() -> bytes:
            given = {**self._at(path), "Range": f"bytes=0-{most - 1}"}
            return self.client.get_object(**given)["Body"].read()

        return self._ask("read", path, get, missing=None, empty=b"")

    def open(self, path: str) -> pa.NativeFile:
        data = self.read(path)
        if data is None:
            raise FileNotFoundError(f"{self.location}/{path}")
        return pa.BufferReader(data)

    def size(self, path: str) -> int | None:
        def head() -> int:
            return self.client.head_object(**self._at(path))["ContentLength"]

        return self._ask("read", path, head, missing=None)

    def write(self, path: str, data: bytes | memoryview) -> None:
        failpoint("write")
        self._ask("write", path, lambda: self.client.put_object(**self._at(path), Body=bytes(data)))
        failpoint("renamed")

    def create(self, path: str, data: bytes) -> bool:
        def put() -> bool:
            self.client.put_object(**self._at(path), Body=data, IfNoneMatch="*")
            return True

        failpoint("write")
        created = self._ask("write", path, put, taken=False)
        failpoint("renamed")
        # A request whose answer was lost is sent again, and then finds its own object.
        return created or self.read(path) == data

    def append(self, path: str, data: bytes) -> None:
        lines, last = self.logs.setdefault(path, ([], time.monotonic()))
        lines.append(data)
        if time.monotonic() - last > _LOG_EVERY:
            self.write(path, b"".join(lines))
            self.logs[path] = lines, time.monotonic()

    def finish(self, path: str) -> None:
        lines, _ = self.logs.pop(path, ([], 0.0))
        if lines:
            self.write(path, b"".join(lines))

    def delete(self, path: str) -> None:
        self._ask("delete", path, lambda: self.client.delete_object(**self._at(path)))

    def list(self, folder: str) -> list[str]:
        prefix = self.prefix + (folder.rstrip("/") + "/" if folder.strip("/") else "")

        def pages() -> list[str]:
            pages = self.client.get_paginator("list_objects_v2").paginate(
                Bucket=self.bucket, Prefix=prefix, Delimiter="/"
            )
            return [
                name.removeprefix(prefix)
                for page in pages
                for name in (
                    *(found["Key"] for found in page.get("Contents", [])),
                    *(found["Prefix"] for found in page.get("CommonPrefixes", [])),
                )
            ]

        return sorted(name for name in self._ask("list", folder, pages) if name)

    def sweep(self, folder: str) -> None:
        """A PUT that did not end leaves nothing."""

    def free(self) -> int | None:
        return None

    def _at(self, path: str) -> dict[str, str]:
        return {"Bucket": self.bucket, "Key": self.prefix + path}

    def _ask(self, verb: str, path: str, request: Callable[[], T], **answers: Any) -> T:
        """The answer to a request; `missing`, `taken`, `empty`: what 404, 412, 416 mean here."""
        from botocore import exceptions

        broken_off = (exceptions.HTTPClientError, exceptions.IncompleteReadError, ConnectionError)
        where = f"{self.location}/{path}"
        for again in range(_BODY_TRIES):
            try:
                return request()
            except exceptions.ClientError as error:
                status = error.response.get("ResponseMetadata", {}).get("HTTPStatusCode", 0)
                code = error.response.get("Error", {}).get("Code", "")
                if status == 404 and code != "NoSuchBucket" and "missing" in answers:
                    return answers["missing"]
                if status == 412 and "taken" in answers:
                    return answers["taken"]
                if status == 416 and "empty" in answers:
                    return answers["empty"]
                text = f"cannot {verb} {where}: {error}"
                # 409: another conditional PUT of this key is under way; S3 asks to try again.
                if status < 500 and status != 409 and code not in _PASSING:
                    raise RsaDataError(text) from error
                if status != 409 or again == _BODY_TRIES - 1:
                    raise TransientError(f"{text}. Run the same command again") from error
            except (*broken_off, exceptions.ConnectionError) as error:
                if again == _BODY_TRIES - 1 or not isinstance(error, broken_off):
                    raise TransientError(
                        f"cannot {verb} {where}: {error}. Run the same command again"
                    ) from error
            except exceptions.BotoCoreError as error:
                raise RsaDataError(f"cannot {verb} {where}: {error}") from error
            time.sleep(0.2 * 2**again)
        raise AssertionError("unreachable")


def _client(option: str) -> Any:
    with extras(f"{option} s3://"):
        import boto3
        import botocore
        from botocore.config import Config
    session = boto3.Session()
    # Public datasets are read without an account.
    unsigned = option == "--root" and session.get_credentials() is None
    config = Config(
        retries={"mode": "standard", "total_max_attempts": _TRIES},
        max_pool_connections=S3Store.at_once,
        connect_timeout=10,
        read_timeout=60,
        # Parts are compared by sha256 already; not every S3-like store knows S3's own checksums.
        request_checksum_calculation="when_required",
        response_checksum_validation="when_required",
        signature_version=botocore.UNSIGNED if unsigned else None,
    )
    return session.client("s3", config=config)

"""Stores of objects by obstore: S3, Google Cloud Storage, Azure.

A file is one PUT, and a conditional PUT where only the first may win.
"""

import re
import time
from collections.abc import Callable
from typing import Any, TypeVar

import pyarrow as pa

from ..common import bounded
from ..common.errors import RowError, RsaDataError, TransientError
from ..common.extras import extras
from ..common.failpoints import failpoint
from .bucket_listing import listed
from .object_clients import TRIES as TRIES
from .object_clients import open_client

T = TypeVar("T")

# Tries of what obstore leaves to its caller, such as a list whose answer broke off.
_AGAIN = 5

# A log is one object that grows: it is put again at most this often, in seconds.
_LOG_EVERY = 30.0

# The object by which a work dir finds out whether its store creates objects conditionally.
_PROBE = ".conditional-creation"

_FORMS = {"s3": "s3://BUCKET/PREFIX", "gs": "gs://BUCKET/PREFIX", "az": "az://CONTAINER/PREFIX"}
_STATUS = re.compile(r"status code: (\d{3})")


class ObjectStore:
    """Objects below s3://BUCKET/PREFIX, gs://BUCKET/PREFIX or az://CONTAINER/PREFIX.

    Credentials, region and endpoint come from the environment (AWS_ACCESS_KEY_ID,
    AWS_ENDPOINT_URL_S3, GOOGLE_APPLICATION_CREDENTIALS, AZURE_STORAGE_ACCOUNT_NAME ...) or the
    machine's role; those of S3 also from ~/.aws where boto3 is installed.

    option : the user's option that names the location. Roots are read without signing requests
    where there are no credentials, as public buckets want it.
    """

    at_once = 32
    writable = True

    def __init__(self, location: str, option: str = "--work"):
        self.location = location.rstrip("/")
        scheme, _, rest = location.partition("://")
        if not rest.partition("/")[0]:
            raise RsaDataError(f"{option} {location}: expected {_FORMS[scheme]}")
        with extras(f"{option} {scheme}://"):
            import obstore
        self.obstore: Any = obstore
        self.store: Any = open_client(scheme, self.location, option)
        self.logs: dict[str, tuple[list[bytes], float]] = {}
        self.probed = False

    def read(self, path: str) -> bytes | None:
        return self._ask("read", path, lambda: self._whole(path), missing=None)

    def _whole(self, path: str) -> bytes:
        """An object, given up where it is over the limit `record`."""
        parts, size = [], 0
        for part in self.store.get(path).stream():
            parts.append(bytes(part))
            if (size := size + len(part)) > bounded.limit("record"):
                raise RowError(str(bounded.over("record", size)))
        return b"".join(parts)

    def head(self, path: str, most: int) -> bytes | None:
        """The first `most` bytes of the file, or None when there is none."""

        def get() -> bytes:
            return bytes(self.obstore.get_range(self.store, path, start=0, length=most))

        return self._ask("read", path, get, missing=None, empty=b"")

    def span(self, path: str, start: int, length: int) -> bytes | None:
        """`length` bytes of the file from `start`, fewer at its end; None when there is none."""

        def get() -> bytes:
            return bytes(self.obstore.get_range(self.store, path, start=start, length=length))

        return self._ask("read", path, get, missing=None, empty=b"")

    def open(self, path: str) -> pa.NativeFile:
        data = self.read(path)
        if data is None:
            raise FileNotFoundError(f"{self.location}/{path}")
        return pa.BufferReader(data)

    def size(self, path: str) -> int | None:
        return self._ask("read", path, lambda: int(self.store.head(path)["size"]), missing=None)

    def write(self, path: str, data: bytes | memoryview) -> None:
        failpoint("write")
        self._ask("write", path, lambda: self._put(path, data, "overwrite"))
        failpoint("renamed")

    def create(self, path: str, data: bytes) -> bool:
        if not self.probed:
            self._probe()
        failpoint("write")
        created = self._ask("write", path, lambda: self._put(path, data, "create"), taken=False)
        failpoint("renamed")
        # A request whose answer was lost is sent again, and then finds its own object.
        return bool(created) or self.read(path) == data

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
        self._ask("delete", path, lambda: self.store.delete(path), missing=None)

    def list(self, folder: str) -> list[str]:
        below = folder.strip("/")
        found = self._ask("list", folder, lambda: listed(self.store, below))
        start = len(below) + 1 if below else 0
        return sorted(name for path in found if (name := path[start:]) and name[0] != ".")

    def sweep(self, folder: str) -> None:
        """A PUT that did not end leaves nothing."""

    def free(self) -> int | None:
        return None

    def _put(self, path: str, data: bytes | memoryview, mode: str) -> bool:
        # One request, whatever the size: an object is there whole or not at all.
        self.store.put(path, bytes(data), mode=mode, use_multipart=False)
        return True

    def _probe(self) -> None:
        """Refuses a store that puts an object over one that is there although it must not."""

        def put() -> bool:
            return self._put(_PROBE, b"rsa-data\n", "create")

        if self._ask("write", _PROBE, put, taken=False) and self._ask(
            "write", _PROBE, put, taken=False
        ):
            raise RsaDataError(
                f"{self.location}: expected a store that creates an object only where there is "
                "none; this one replaced it, so two runs at once could mix. Use another store for "
                "--work"
            )
        self.probed = True

    def _ask(self, verb: str, path: str, request: Callable[[], T], **answers: T) -> T:
        """The answer to a request; `missing`, `taken`, `empty`: what 404, 412, 416 mean here."""
        errors = self.obstore.exceptions
        for again in range(_AGAIN):
            try:
                return request()
            except (errors.BaseError, OSError, ValueError) as error:
                what = str(error).partition("\n\nDebug source")[0].strip()[:500]
                no_bucket = "NoSuchBucket" in what or "ContainerNotFound" in what
                if isinstance(error, FileNotFoundError) and not no_bucket and "missing" in answers:
                    return answers["missing"]
                if isinstance(error, errors.AlreadyExistsError) and "taken" in answers:
                    return answers["taken"]
                match = _STATUS.search(what)
                status = int(match[1]) if match else 0
                if status == 416 and "empty" in answers:
                    return answers["empty"]
                text = f"cannot {verb} {self.location}/{path}: {what}"
                lasting = (FileNotFoundError, PermissionError, ValueError)
                # 409: another conditional PUT of this key is under way.
                if isinstance(error, lasting) or (400 <= status < 500 and status not in _PASSING):
                    raise RsaDataError(text) from error
                # obstore has tried those with a status again already.
                if (status and status != 409) or again == _AGAIN - 1:
                    raise TransientError(f"{text}. Run the same command again") from error
            time.sleep(0.2 * 2**again)
        raise AssertionError("unreachable")


_PASSING = frozenset({408, 409, 425, 429})

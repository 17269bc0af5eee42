"""Data sets of the Hugging Face hub, to read, by huggingface_hub with its cache and token."""

import re
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

from ..common.errors import RsaDataError, TransientError

T = TypeVar("T")

_ADDRESS = re.compile(r"hf://datasets/([\w.-]+/[\w.-]+?)(?:@([^@]*[^@/]))?/?")
_COMMIT = re.compile(r"[0-9a-f]{40}")


class HubFiles:
    """The files of hf://datasets/OWNER/NAME[@REVISION].

    A revision that may move, such as main, is looked up once and becomes a commit in `location`,
    which is what the work dir keeps. Files are downloaded whole into the hub's cache and stay
    there; a token is taken from where huggingface_hub looks for it. Raises RsaDataError for a data
    set that is not there or may not be read, TransientError when the hub cannot be reached.
    """

    def __init__(self, location: str, option: str = "--root"):
        match = _ADDRESS.fullmatch(location)
        if match is None:
            raise RsaDataError(
                f"{option} {location}: expected hf://datasets/OWNER/NAME or "
                "hf://datasets/OWNER/NAME@REVISION"
            )
        self.name, revision = match[1], match[2] or "main"
        if not _COMMIT.fullmatch(revision):
            from huggingface_hub import HfApi

            def look() -> str | None:
                return HfApi().dataset_info(self.name, revision=revision, timeout=30).sha

            revision = self._ask(f"{location}", look) or revision
        self.revision = revision
        self.location = f"hf://datasets/{self.name}@{revision}"

    def read(self, path: str) -> bytes | None:
        """The whole file, or None when there is none."""
        file = self._local(path)
        return None if file is None else file.read_bytes()

    def head(self, path: str, most: int) -> bytes | None:
        """The first `most` bytes of the file, or None when there is none."""
        return self.span(path, 0, most)

    def span(self, path: str, start: int, length: int) -> bytes | None:
        """`length` bytes of the file from `start`, fewer at its end; None when there is none."""
        file = self._local(path)
        if file is None:
            return None
        with file.open("rb") as opened:
            opened.seek(start)
            return opened.read(length)

    def size(self, path: str) -> int | None:
        """Bytes of the file, or None when there is none."""
        file = self._local(path)
        return None if file is None else file.stat().st_size

    def list(self, folder: str) -> list[str]:
        """Names of the files and folders (with a slash at their end) in `folder`, sorted."""
        start = folder.strip("/") + "/" if folder.strip("/") else ""
        below = (path[len(start) :] for path in self._paths if path.startswith(start))
        return sorted({name.partition("/")[0] + "/" * ("/" in name) for name in below})

    @cached_property
    def _paths(self) -> tuple[str, ...]:
        from huggingface_hub import HfApi
        from huggingface_hub.hf_api import RepoFile

        def tree() -> tuple[str, ...]:
            found = HfApi().list_repo_tree(
                self.name, recursive=True, revision=self.revision, repo_type="dataset"
            )
            return tuple(entry.path for entry in found if isinstance(entry, RepoFile))

        return self._ask(self.location, tree)

    def _local(self, path: str) -> Path | None:
        """The file in the hub's cache, where it is put when it is not there yet."""
        from huggingface_hub import hf_hub_download
        from huggingface_hub.errors import EntryNotFoundError, LocalEntryNotFoundError

        def get() -> Path | None:
            given: dict[str, Any] = {"repo_type": "dataset", "revision": self.revision}
            try:
                return Path(hf_hub_download(self.name, path, **given))
            except LocalEntryNotFoundError:  # the hub is away, and the file is not in the cache
                raise
            except EntryNotFoundError:
                return None

        return self._ask(f"{self.location}/{path}", get) if path else None

    def _ask(self, where: str, request: Callable[[], T]) -> T:
        from huggingface_hub import errors

        try:
            return request()
        except (errors.RepositoryNotFoundError, errors.RevisionNotFoundError) as error:
            raise RsaDataError(
                f"{where}: expected a data set of the hub, found: {_first(error)}. Check the name, "
                "and `hf auth login` or HF_TOKEN where it is private or gated"
            ) from error
        except errors.HFValidationError as error:
            raise RsaDataError(f"{where}: {_first(error)}") from error
        # The layers below (HTTP, Xet, the disk) raise errors of many unrelated kinds.
        except Exception as error:
            if isinstance(error, RsaDataError):
                raise
            raise TransientError(
                f"cannot read {where}: {_first(error)}. Run the same command again"
            ) from error


def _first(error: Exception) -> str:
    lines = str(error).strip().splitlines()
    return lines[0] if lines else type(error).__name__

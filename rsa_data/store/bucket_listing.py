"""What lies in one folder of a bucket, by listings that a server may never end."""

import asyncio
import os
import time
from pathlib import Path
from typing import Any

from ..common import bounded
from ..common.errors import RsaDataError, TransientError

# Seconds between two looks at time and memory.
_LOOK = 0.1


def listed(store: Any, folder: str) -> list[str]:
    """Paths of the objects and of the folders (with a slash at their end) in a folder.

    store : obstore's, which follows the pages of a listing by itself. Raises TransientError when
    they do not end within the limit `request`, RsaDataError when their names take more memory than
    the limit `listing`, and obstore's own errors.
    """
    return asyncio.run(_listed(store, folder))


async def _listed(store: Any, folder: str) -> list[str]:
    asking = asyncio.ensure_future(store.list_with_delimiter_async(folder or None))
    ends, before = time.monotonic() + bounded.limit("request"), _held()
    try:
        while not (await asyncio.wait({asking}, timeout=_LOOK))[0]:
            if (taken := _held() - before) > bounded.limit("listing"):
                raise RsaDataError(f"listing of {folder or 'the bucket'}: "
                                   f"{bounded.over('listing', taken)}")  # fmt: skip
            if time.monotonic() > ends:
                raise TransientError(
                    f"listing of {folder or 'the bucket'}: no end within "
                    f"{bounded.limit('request'):g} s, the limit request"
                )
    finally:
        asking.cancel()  # no page more is asked for
    found = asking.result()
    folders = [prefix + "/" for prefix in found["common_prefixes"]]
    return [*(entry["path"] for entry in found["objects"]), *folders]


def _held() -> int:
    """Bytes of memory that this process holds; 0 where that cannot be known."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except OSError:
        return 0
    return pages * os.sysconf("SC_PAGE_SIZE")

"""Reading files from a web server: GET with retries, folders as the server's pages list them."""

import html.parser
import importlib.metadata
import ssl
import urllib.parse
import urllib.request
from typing import Any

from ..common.errors import RowError, RsaDataError, TransientError

# Tries of one request, with back-off that doubles up to 20 s: about a minute and a half in all.
_TRIES = 8
# Of these, connections that fail: a quarter of a minute, since a wrong name is more likely.
_CONNECTS = 5

# Answers that may pass by themselves: timeout, too early, too many requests, server trouble.
_PASSING = frozenset({408, 425, 429, 500, 502, 503, 504})
_MISSING = frozenset({404, 410})


class HttpFiles:
    """Files below an http:// or https:// address, to read.

    Paths are plain names, which are percent-encoded here. Proxies are those of the environment
    (HTTPS_PROXY ...). Raises RowError for a file that the server refuses, TransientError when it
    cannot be reached or goes on failing.
    """

    at_once = 32

    def __init__(self, location: str):
        import urllib3

        self.location = location.rstrip("/")
        parts = urllib.parse.urlsplit(self.location)
        if not parts.hostname or parts.query or parts.fragment or parts.username:
            raise RsaDataError(
                f"--root {location}: expected https://HOST/PATH without user name, ? and #: it is "
                "written into the work dir"
            )
        given: dict[str, Any] = {
            "maxsize": self.at_once,
            "headers": {"User-Agent": f"rsa-data/{importlib.metadata.version('rsa-data')}"},
            "timeout": urllib3.Timeout(connect=10, read=60),
            "retries": urllib3.Retry(
                _TRIES,
                connect=min(_TRIES, _CONNECTS),
                status_forcelist=_PASSING,
                raise_on_status=False,
                backoff_factor=0.5,
                backoff_max=20,
                retry_after_max=60,
            ),
        }
        proxy = urllib.request.getproxies().get(parts.scheme)
        if proxy and not urllib.request.proxy_bypass(parts.hostname):
            self.pool: Any = urllib3.ProxyManager(proxy, **given)
        else:
            self.pool = urllib3.PoolManager(**given)

    def read(self, path: str) -> bytes | None:
        """The whole file, or None when there is none."""
        answer = self._file("GET", path)
        return None if answer is None else answer.data

    def head(self, path: str, most: int) -> bytes | None:
        """The first `most` bytes of the file, or None when there is none."""
        answer = self._file("GET", path, {"Range": f"bytes=0-{most - 1}"})
        return None if answer is None else b"" if answer.status == 416 else answer.data[:most]

    def size(self, path: str) -> int | None:
        """Bytes of the file, or None when there is none; 0 where the server does not tell."""
        answer = self._file("HEAD", path)
        return None if answer is None else int(answer.headers.get("Content-Length", 0))

    def list(self, folder: str) -> list[str]:
        """Names of the files and folders (with a slash at their end) in `folder`, sorted.

        They are the links of the page that the server makes of a folder, as nginx, Apache and
        Python do; none where there is no such folder. Raises RsaDataError when it makes none.
        """
        try:
            answer = self._ask("GET", f"{folder.rstrip('/')}/".lstrip("/"))
        except RowError as error:
            raise RsaDataError(f"{self._url(folder)}: {error}; {_WAY_OUT}") from error
        if answer is None:
            return []
        if "html" not in answer.headers.get("Content-Type", ""):
            raise RsaDataError(f"{self._url(folder)}: expected a page of links, found a file")
        page = _Links()
        page.feed(answer.data.decode("utf-8", "replace"))
        here = urllib.parse.urljoin(self._url(folder) + "/", answer.geturl() or "")
        found = set()
        for link in page.links:
            target = urllib.parse.urljoin(here, link)
            name = urllib.parse.unquote(target.removeprefix(here))
            # Neither up nor out, one step at a time, and not the links that sort the page.
            inside = target.startswith(here) and name.strip("/") and "/" not in name[:-1]
            if inside and "?" not in link and "#" not in link:
                found.add(name)
        return sorted(found)

    def _url(self, path: str) -> str:
        return f"{self.location}/{urllib.parse.quote(path)}".rstrip("/")

    def _file(self, method: str, path: str, headers: dict[str, str] | None = None) -> Any:
        """The answer, or None when there is nothing, or a folder: servers add the slash to it."""
        answer = self._ask(method, path, headers)
        return None if answer is None or (answer.geturl() or "").endswith("/") else answer

    def _ask(self, method: str, path: str, headers: dict[str, str] | None = None) -> Any:
        """The answer, or None when the server says that there is nothing."""
        from urllib3 import exceptions

        url = f"{self.location}/{urllib.parse.quote(path)}"
        try:
            answer = self.pool.request(
                method, url, headers={**self.pool.headers, **(headers or {})}
            )
        except (exceptions.HTTPError, ssl.SSLError) as error:
            reason = getattr(error, "reason", None) or error
            raise TransientError(
                f"cannot read {url}: {reason}. Run the same command again"
            ) from error
        if answer.status in _MISSING:
            return None
        if answer.status in _PASSING:
            raise TransientError(
                f"cannot read {url}: the server answers {answer.status} {answer.reason}. Run the "
                "same command again"
            )
        if answer.status >= 400 and answer.status != 416:  # the range of an empty file
            raise RowError(f"the server answers {answer.status} {answer.reason}")
        return answer


_WAY_OUT = "name the files by --dataset-option file_list=FILE"


class _Links(html.parser.HTMLParser):
    """Collects the targets of a page's links."""

    def __init__(self) -> None:
        super().__init__()
        self.links: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "a":
            self.links += [value for key, value in attrs if key == "href" and value]

"""Reading files from a web server: GET with retries, folders as the server's pages list them."""

import html.parser
import urllib.parse

from ..common import forms
from ..common.errors import RowError, RsaDataError, TransientError
from ..common.http import PASSING, TRIES, client, hidden, is_address
from ..common.requests import Answer, Asking, ask

# Answers that mean that there is nothing.
_MISSING = frozenset({404, 410})


class HttpFiles:
    """Files below an http:// or https:// address, to read.

    Paths are plain names, which are percent-encoded here. Proxies are those of the environment
    (HTTPS_PROXY ...). Raises RowError for a file that the server refuses, TransientError when it
    cannot be reached or goes on failing.
    """

    at_once = 32

    def __init__(self, location: str, option: str = "--root"):
        self.location = location.rstrip("/")
        parts = urllib.parse.urlsplit(self.location)
        if not is_address(self.location) or parts.query or parts.fragment:
            raise RsaDataError(
                f"{option} {hidden(location)}: expected https://HOST/PATH without user name, "
                "? and #: it is written into the work dir"
            )
        self.pool = client(self.location)

    def read(self, path: str) -> bytes | None:
        """The whole file, or None when there is none."""
        answer = self._file("GET", path)
        return None if answer is None else answer.data

    def head(self, path: str, most: int) -> bytes | None:
        """The first `most` bytes of the file, or None when there is none."""
        return self.span(path, 0, most)

    def span(self, path: str, start: int, length: int) -> bytes | None:
        """`length` bytes of the file from `start`, fewer at its end; None when there is none."""
        answer = self._file("GET", path, {"Range": f"bytes={start}-{start + length - 1}"})
        if answer is None or answer.status == 416:
            return None if answer is None else b""
        # 200: a server that knows no ranges sends the whole file.
        first = 0 if answer.status == 206 else start
        return answer.data[first : first + length]

    def size(self, path: str) -> int | None:
        """Bytes of the file, or None when there is none; 0 where the server does not tell."""
        answer = self._file("HEAD", path)
        told = "0" if answer is None else answer.headers.get("Content-Length", "0")
        return None if answer is None else int(told) if told.isdecimal() and len(told) < 19 else 0

    def list(self, folder: str) -> list[str]:
        """Names of the files and folders (with a slash at their end) in `folder`, sorted.

        They are the links of the page that the server makes of a folder, as nginx, Apache and
        Python do; none where there is no such folder. Raises RsaDataError when it makes none.
        """
        try:
            answer = self._ask("GET", f"{folder.rstrip('/')}/".lstrip("/"), most="answer")
        except RowError as error:
            raise RsaDataError(f"{self._url(folder)}: {error}; {_WAY_OUT}") from error
        if answer is None:
            return []
        if "html" not in answer.headers.get("Content-Type", ""):
            raise RsaDataError(f"{self._url(folder)}: expected a page of links, found a file")
        return names(answer.data, urllib.parse.urljoin(self._url(folder) + "/", answer.url))

    def _url(self, path: str) -> str:
        return f"{self.location}/{urllib.parse.quote(path)}".rstrip("/")

    def _file(self, method: str, path: str, headers: dict[str, str] | None = None) -> Answer | None:
        """The answer, or None when there is nothing, or a folder: servers add the slash to it."""
        answer = self._ask(method, path, headers)
        return None if answer is None or answer.url.endswith("/") else answer

    def _ask(
        self, method: str, path: str, headers: dict[str, str] | None = None, most: str = "image"
    ) -> Answer | None:
        """The answer, or None when the server says that there is nothing."""
        url = f"{self.location}/{urllib.parse.quote(path)}"
        how = Asking(most, tries=TRIES + 1, anywhere=True)
        answer = ask(self.pool, method, url, how, headers=headers)
        if answer.status in _MISSING:
            return None
        if answer.status in PASSING:
            raise TransientError(
                f"cannot read {url}: the server answers {answer.said()}. Run the same command again"
            )
        if answer.status not in (200, 203, 206, 416):  # the last is of an empty file's range
            raise RowError(f"the server answers {answer.said()}")
        return answer


_WAY_OUT = "name the files by --dataset-option file_list=FILE"


def names(page: bytes, here: str) -> list[str]:
    """Names of the files and folders that a page at the address `here` links to, sorted.

    Neither up nor out, one step at a time, no links that sort the page, no names that a file
    could not have.
    """
    links = _Links()
    links.feed(page.decode("utf-8", "replace"))
    found = set()
    for link in links.links:
        if "?" in link or "#" in link:
            continue
        try:
            target = urllib.parse.urljoin(here, link)
        except ValueError:  # such as half an address in brackets
            continue
        name = urllib.parse.unquote(target.removeprefix(here))
        step = name.removesuffix("/")
        one = "/" not in step and step not in ("", ".", "..") and forms.is_path(step)
        if target.startswith(here) and one:
            found.add(name)
    return sorted(found)


class _Links(html.parser.HTMLParser):
    """Collects the targets of a page's links."""

    def __init__(self) -> None:
        super().__init__()
        self.links: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "a":
            self.links += [value for key, value in attrs if key == "href" and value]

"""One request to a server that may be anybody's: how long it may take, how much it may answer.

A request ends after the limit `request` of common.bounded in all, tries and waits included, also
where a server sends a byte now and then; an answer over its limit is given up; redirects end.
"""

import http
import time
import urllib.parse
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from . import bounded
from .errors import RowError, TransientError
from .http import CONNECTS, PASSING, TRIES, deadline, reason

if TYPE_CHECKING:
    import urllib3

_REDIRECTS, _LONGEST_WAIT, _SILENCE = 5, 20.0, 60.0
_LED_ON = frozenset({301, 302, 303, 307, 308})


@dataclass(frozen=True)
class Answer:
    """status : of HTTP. headers : whatever their case. data : the body, unpacked. url : whose."""

    status: int
    headers: Mapping[str, str]
    data: bytes
    url: str

    def said(self) -> str:
        """The status with its standard name; a server's own words are not repeated."""
        known = {status.value: status.phrase for status in http.HTTPStatus}
        return f"{self.status} {known.get(self.status, '')}".strip()


@dataclass(frozen=True)
class Asking:
    """How to ask.

    most : name of the limit on the answer's bytes. tries : how often in all, where it may pass.
    wait : seconds before the second try, doubled each time. anywhere : whether redirects may lead
        to another origin (scheme, host and port); never with a secret among the headers.
    """

    most: str = "answer"
    tries: int = TRIES
    wait: float = 0.5
    anywhere: bool = False


def ask(
    pool: "urllib3.PoolManager",
    method: str,
    url: str,
    how: Asking,
    *,
    headers: Mapping[str, str] | None = None,
    body: bytes | None = None,
) -> Answer:
    """The answer to a request, of whatever status.

    Raises TransientError when there is no whole one in time, RowError for one that is too large or
    that redirects lead away from.
    """
    from urllib3 import exceptions

    ends = time.monotonic() + bounded.limit("request")
    given = {**pool.headers, **(headers or {})}
    why = ""
    for again in range(how.tries):
        try:
            answer = _follow(pool, method, url, how, given, body, ends)
            if answer.status not in PASSING or again == how.tries - 1:
                return answer
            why, pause = answer.said(), _asked_for(answer.headers)
        except (exceptions.HTTPError, OSError, ValueError) as error:
            if isinstance(error, bounded.Refused):
                raise RowError(f"the server's answer: {error}") from error
            why, pause = reason(error), 0.0
            connecting = isinstance(
                error, exceptions.ConnectTimeoutError | exceptions.NewConnectionError
            )
            if connecting and again >= CONNECTS - 1:
                break
        pause = max(min(how.wait * 2**again, _LONGEST_WAIT), min(pause, 3 * _LONGEST_WAIT))
        if time.monotonic() + pause > ends:
            why += f" (given up after {bounded.limit('request'):g} s, the limit request)"
            break
        if again < how.tries - 1:
            time.sleep(pause)
    raise TransientError(f"cannot read {url}: {why}. Run the same command again")


def _follow(
    pool: "urllib3.PoolManager", method: str, url: str, how: Asking, headers: dict[str, str],
    body: bytes | None, ends: float,
) -> Answer:  # fmt: skip
    first = _origin(url)
    for _ in range(_REDIRECTS + 1):
        answer = once(pool, method, url, how.most, headers=headers, body=body, ends=ends)
        if answer.status not in _LED_ON or not (target := answer.headers.get("Location")):
            return answer
        url = urllib.parse.urljoin(url, target)
        if _origin(url) != first and not how.anywhere:
            raise RowError("the server leads to another origin, which is not followed")
        if not url.startswith(("http://", "https://")):
            raise RowError("the server leads to an address that is not http:// or https://")
        if method not in ("GET", "HEAD") and answer.status not in (307, 308):
            raise RowError(f"the server answers {answer.said()} and leads elsewhere")
    raise RowError(f"the server leads on more than {_REDIRECTS} times")


def _origin(url: str) -> tuple[str, str | None, int | None]:
    parts = urllib.parse.urlsplit(url)
    return parts.scheme, parts.hostname, parts.port or {"http": 80, "https": 443}.get(parts.scheme)


def once(
    pool: "urllib3.PoolManager",
    method: str,
    url: str,
    most: str,
    *,
    headers: Mapping[str, str],
    body: bytes | None = None,
    ends: float | None = None,
) -> Answer:
    """The answer to one request, not sent again and led nowhere.

    most : name of the limit on its bytes. ends : of time.monotonic; by default after the limit
        `request`. Raises urllib3's HTTPError or OSError without a whole answer in time, Refused
        for one over the limit.
    """
    import urllib3

    left = max(ends - time.monotonic(), 0.01) if ends else bounded.limit("request")
    timeout = urllib3.Timeout(connect=min(10, left), read=min(_SILENCE, left))
    with deadline(left):
        answer: Any = pool.urlopen(
            method, url, headers=headers, body=body, redirect=False, retries=False,
            preload_content=False, timeout=timeout,
        )  # fmt: skip
        try:
            parts, size, limit = [], 0, bounded.limit(most)
            # Not read(n), which waits for n bytes however long they take.
            while part := answer.read1(1 << 18):
                parts.append(part)
                if (size := size + len(part)) > limit:
                    raise bounded.over(most, size)
            answer.release_conn()
        except BaseException:
            answer.close()
            raise
    return Answer(answer.status, answer.headers, b"".join(parts), url)


def _asked_for(headers: Mapping[str, str]) -> float:
    """Seconds of Retry-After; 0 without one that is a number."""
    try:
        return max(0.0, float(headers.get("Retry-After", "0")))
    except ValueError:
        return 0.0

"""The one HTTP client: urllib3, by the proxies of the environment, with retries and time limits."""

import importlib.metadata
import re
import socket
import threading
import time
import urllib.parse
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import urllib3

# Answers that may pass by themselves: timeout, too early, too many requests, server trouble.
PASSING = frozenset({408, 425, 429, 500, 502, 503, 504})

# Tries of one request, with back-off that doubles up to 20 s: about a minute and a half in all.
TRIES = 8
# Of these, connections that fail: a quarter of a minute, since a wrong name is more likely.
CONNECTS = 5


def client(address: str, *, tries: int = TRIES, read: float = 60.0) -> "urllib3.PoolManager":
    """A pool of connections for one address; thread-safe.

    address : http:// or https://; decides which proxy (HTTPS_PROXY ..., NO_PROXY) is used.
    tries : how often a request is sent again when it fails or its answer is one of PASSING; such an
        answer is returned in the end. 0: once, and redirects are not followed.
    read : seconds without a byte after which an answer is given up.
    """
    import urllib3

    retries = urllib3.Retry(
        tries,
        connect=min(tries, CONNECTS),
        redirect=min(tries, CONNECTS),
        status_forcelist=PASSING,
        raise_on_status=False,
        raise_on_redirect=False,
        backoff_factor=0.5,
        backoff_max=20,
        retry_after_max=60,
    )
    parts = urllib.parse.urlsplit(address)
    proxy = urllib.request.getproxies().get(parts.scheme)
    headers = {"User-Agent": f"rsa-data/{importlib.metadata.version('rsa-data')}"}
    timeout = urllib3.Timeout(connect=10, read=read)
    given: dict[str, Any] = {"headers": headers, "timeout": timeout, "retries": retries}
    if proxy and not urllib.request.proxy_bypass(parts.hostname or ""):
        pool: urllib3.PoolManager = urllib3.ProxyManager(proxy, maxsize=32, **given)
    else:
        pool = urllib3.PoolManager(maxsize=32, **given)
    pool.pool_classes_by_scheme = _timed_pools()
    return pool


# Of this thread: the watch on the answer that it waits for.
_waiting = threading.local()


class _Watch:
    """Shuts a connection when its time is over."""

    def __init__(self, seconds: float):
        self.ends, self.over = time.monotonic() + seconds, False
        self.timer: threading.Timer | None = None

    def begin(self, sock: Any) -> None:
        self.cancel()  # that of the connection which a redirect has left
        left = max(0.0, self.ends - time.monotonic())
        self.timer = threading.Timer(left, self._end, [sock])
        self.timer.daemon = True
        self.timer.start()

    def cancel(self) -> None:
        if self.timer is not None:
            self.timer.cancel()

    def _end(self, sock: Any) -> None:
        self.over = True
        with suppress(OSError):
            sock.shutdown(socket.SHUT_RDWR)


@contextmanager
def deadline(seconds: float) -> Iterator[None]:
    """Whoever reads an answer inside has so long for all of it, headers included.

    Time limits between bytes never end a server that sends one now and then: the connection is
    shut when the time is over. Raises TimeoutError then.
    """
    watch = _waiting.watch = _Watch(seconds)
    try:
        yield
    finally:
        _waiting.watch = None
        watch.cancel()
        if watch.over:  # headers and bodies without a length look whole where they were cut
            raise TimeoutError(f"no whole answer within {seconds:.3g} s")


def _watch(connection: Any) -> None:
    if (watch := getattr(_waiting, "watch", None)) is not None and connection.sock is not None:
        watch.begin(connection.sock)


@cache
def _timed_pools() -> dict[str, Any]:
    """urllib3's pools, whose connections keep to `deadline`."""
    from urllib3 import connection, connectionpool

    class Plain(connection.HTTPConnection):
        def getresponse(self) -> Any:
            _watch(self)
            return super().getresponse()

    class Secure(connection.HTTPSConnection):
        def getresponse(self) -> Any:
            _watch(self)
            return super().getresponse()

    class PlainPool(connectionpool.HTTPConnectionPool):
        ConnectionCls = Plain

    class SecurePool(connectionpool.HTTPSConnectionPool):
        ConnectionCls = Secure

    return {"http": PlainPool, "https": SecurePool}


def is_address(address: str) -> bool:
    """Whether a client can ask there: http:// or https://, a host, a port, no user name."""
    try:
        parts = urllib.parse.urlsplit(address)
        port = parts.port
    except ValueError:
        return False
    host = parts.hostname or ""
    known = parts.scheme in ("http", "https") and port != 0 and "@" not in parts.netloc
    return known and address.isprintable() and " " not in address and 0 < len(host) <= 253


def hidden(address: str) -> str:
    """An address for messages, without what may be a password in it."""
    scheme, slashes, rest = address.partition("://")
    host, slash, path = rest.partition("/")
    return (
        f"{scheme}{slashes}***@{host.rpartition('@')[2]}{slash}{path}" if "@" in host else address
    )


def reason(error: Exception) -> str:
    """What a failed request says, without the names of urllib3's own objects where it can be."""
    text = str(getattr(error, "reason", None) or error) or type(error).__name__
    text = re.sub(r"^\w+\(host=[^()]*\): ", "", text)
    return re.sub(r"^Failed to resolve '([^']*)' \(.*\)$", r"cannot resolve \1", text)

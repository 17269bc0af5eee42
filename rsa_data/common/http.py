"""The one HTTP client: urllib3, by the proxies of the environment, with retries and time limits."""

import importlib.metadata
import urllib.parse
import urllib.request
from typing import TYPE_CHECKING

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
    if proxy and not urllib.request.proxy_bypass(parts.hostname or ""):
        return urllib3.ProxyManager(
            proxy, maxsize=32, headers=headers, timeout=timeout, retries=retries
        )
    return urllib3.PoolManager(maxsize=32, headers=headers, timeout=timeout, retries=retries)


def reason(error: Exception) -> str:
    """What a failed request says, without the names of urllib3's own objects where it can be."""
    return str(getattr(error, "reason", None) or error) or type(error).__name__

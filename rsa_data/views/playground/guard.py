"""Who may talk to the page: a browser on this machine that was given this page, and nobody else.

A page on the internet can make a visitor's browser send requests to 127.0.0.1, and a name that
resolves to it makes them look like the page's own. So Host and Origin are checked, for requests and
for sockets; and no request may send more than a picture.
"""

from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]

# Bytes of a request: a picture, and the form around it.
MOST = 51_000_000


class Guard:
    """ASGI middleware before the page, which listens on `port` of 127.0.0.1."""

    def __init__(self, app: Any, port: int, most: int = MOST):
        self.app, self.most = app, most
        hosts = [f"{name}:{port}" for name in ("127.0.0.1", "localhost")]
        if port == 80:
            hosts += ["127.0.0.1", "localhost"]
        self.hosts = {host.encode() for host in hosts}
        self.origins = {f"http://{host}".encode() for host in hosts}

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        """Answers what is refused itself; passes on the rest."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
        elif not self._own(scope["headers"]):
            await _refuse(scope, receive, send, 403, b"This page answers its own machine only.")
        elif scope["type"] == "websocket":
            await self.app(scope, receive, send)
        else:
            await self._limited(scope, receive, send)

    def _own(self, headers: list[tuple[bytes, bytes]]) -> bool:
        """Whether a request was sent to this page's address, and by this page if by any."""
        hosts = [value.lower() for name, value in headers if name == b"host"]
        origins = [value.lower() for name, value in headers if name == b"origin"]
        return len(hosts) == 1 and hosts[0] in self.hosts and self.origins.issuperset(origins)

    async def _limited(self, scope: Message, receive: Receive, send: Send) -> None:
        told = dict(scope["headers"]).get(b"content-length", b"0")
        too_large = b"Expected at most 50 MB."
        if not (told.isascii() and told.isdigit()) or len(told) > 18 or int(told) > self.most:
            await _refuse(scope, receive, send, 413, too_large)
            return
        size, answered, over = 0, False, False

        async def counted() -> Message:
            nonlocal size, over
            message = await receive()
            size += len(message.get("body", b""))
            if size > self.most:
                over = True
                return {"type": "http.disconnect"}
            return message

        async def passed(message: Message) -> None:
            nonlocal answered
            if not over:
                answered = True
                await send(message)

        try:
            await self.app(scope, counted, passed)
        except Exception:
            if not over:
                raise
        if over and not answered:
            await _refuse(scope, receive, send, 413, too_large)


async def _refuse(scope: Message, receive: Receive, send: Send, status: int, why: bytes) -> None:
    if scope["type"] == "websocket":
        await receive()  # the attempt to connect
        await send({"type": "websocket.close", "code": 1008})
        return
    headers = [(b"content-type", b"text/plain"), (b"connection", b"close")]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": why})

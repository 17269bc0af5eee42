"""Who the playground's page answers: Host and Origin, for requests and sockets, and how much."""

import asyncio

import pytest

from rsa_data.views.playground.guard import Guard


def talk(headers, kind="http", bodies=(b"",), most=100):
    """What a page that reads its whole request answers through the guard."""
    said, waiting = [], list(bodies)

    async def page(scope, receive, send):
        if scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.accept"})
            return
        while True:
            message = await receive()
            if message["type"] == "http.disconnect":
                raise ConnectionError("the visitor left")
            if not message.get("more_body"):
                break
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": b"page"})

    async def receive():
        if kind == "websocket":
            return {"type": "websocket.connect"}
        body = waiting.pop(0)
        return {"type": "http.request", "body": body, "more_body": bool(waiting)}

    async def send(message):
        said.append(message.get("status", message["type"]))

    given = [(name.lower().encode(), value.encode()) for name, value in headers]
    scope = {"type": kind, "headers": given}
    asyncio.run(Guard(page, 8080, most)(scope, receive, send))
    return said[0]


OWN = ("Host", "127.0.0.1:8080")


@pytest.mark.parametrize("host", ["127.0.0.1:8080", "localhost:8080", "LOCALHOST:8080"])
def test_the_page_answers_at_its_own_address(host):
    assert talk([("Host", host)]) == 200
    assert talk([("Host", host), ("Origin", "http://127.0.0.1:8080")]) == 200
    socket = [("Host", host), ("Origin", "http://localhost:8080")]
    assert talk(socket, "websocket") == "websocket.accept"


@pytest.mark.parametrize(
    "headers",
    [
        [],
        [("Host", "evil.example")],
        [("Host", "evil.example:8080")],
        [("Host", "127.0.0.1:8081")],
        [("Host", "127.0.0.1")],
        [("Host", "127.0.0.1:8080.evil.example")],
        [OWN, ("Host", "evil.example")],
        [OWN, ("Origin", "http://evil.example")],
        [OWN, ("Origin", "null")],
        [OWN, ("Origin", "https://127.0.0.1:8080")],
        [OWN, ("Origin", "http://127.0.0.1:8081")],
        [OWN, ("Origin", "http://127.0.0.1:8080"), ("Origin", "http://evil.example")],
    ],
)
def test_others_are_refused_also_at_sockets(headers):
    assert talk(headers) == 403
    assert talk(headers, "websocket") == "websocket.close"


def test_uploads_are_limited_by_what_they_say_and_by_what_they_send():
    assert talk([OWN, ("Content-Length", "100")], bodies=(b"x" * 100,)) == 200
    assert talk([OWN, ("Content-Length", "101")]) == 413
    assert talk([OWN, ("Content-Length", "abc")]) == 413
    assert talk([OWN, ("Content-Length", "9" * 5000)]) == 413
    assert talk([OWN], bodies=[b"x" * 30] * 4) == 413

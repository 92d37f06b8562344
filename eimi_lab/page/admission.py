"""Refuse requests to the live web page that come from other web sites or from other users of the computer.

A request needs a token (a random secret text). A WebSocket sends the token in its first message.
"""

# Two other parties might try to receive data from the page: a page of another site that is open in the same browser,
# and another user of the same computer, who can connect to every port of 127.0.0.1. A request is therefore answered
# only if all of these conditions are fulfilled:
# - Its Host is a name of this page. (Under DNS rebinding, a foreign name resolves to this computer.)
# - It carries the token in the header `X-Eimi-Token`, which a browser never adds to a request of another page.
# - If it is a POST or a WebSocket, its Origin is this page, and the browser does not report another site as its
#   origin.
#
# A script in a browser cannot set a header of a WebSocket. The first message of a WebSocket must therefore be
# `{"token": ...}`; before this message nothing is sent. There is no cookie, because a browser sends a cookie to every
# port of a host.
#
# The token stands in the fragment of the address (after `#`), which a browser does not send. A script moves the token
# to sessionStorage, which belongs to one origin (host and port) and one tab. The empty page, its scripts and its
# styles need no token, because they are part of the program and contain no data. The link to a report contains a
# separate key, see `report_links`.

from __future__ import annotations

import asyncio
import json
import secrets
from contextlib import suppress
from dataclasses import dataclass, field

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from eimi_lab.page.report_links import REPORT

TOKEN_HEADER = "x-eimi-token"
INDEX, STATIC = "/", "/static/"
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
REPORT_POLICY = "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'none'"
"""Content security policy of a report: its styles and images are part of the file, and no script runs."""

HEADERS = {
    "Content-Security-Policy": POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
SAFE = ("GET", "HEAD")
MOST_BODY_BYTES = 1 << 16
RECEIVED_PICTURE = "/api/phone/receive"
"""Path of the route that receives a photograph in the body of a request."""
MOST_PICTURE_BYTES = 1 << 26
CLOSED_BY_POLICY = 1008  # close code of a WebSocket after a violated policy (RFC 6455, 7.4.1)
INTRODUCED_WITHIN_S = 10.0
"""Longest time (s) from the opening of a WebSocket to its message with the token."""


def new_token() -> str:
    """Return a random token of 256 bits: the secret text that every request to the page must carry."""
    return secrets.token_urlsafe(32)


@dataclass(frozen=True)
class Admission:
    """A check of every request of a browser before the web application receives the request (ASGI middleware).

    Parameters
    ----------
    app : ASGIApp
        The application that answers the admitted requests.
    hosts : frozenset of str
        Allowed values of the header Host, with the port.
    token : str
        The secret text that a request or the first message of a WebSocket must carry.
    """

    app: ASGIApp
    hosts: frozenset[str]
    token: str = field(repr=False)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send the application's answer to an allowed request, and refuse any other request."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        refusal = self._refusal(scope)
        if scope["type"] == "websocket":
            connect = await receive()
            if refusal is None and await self._is_introduced(receive, send):
                # `_is_introduced` has already accepted the WebSocket, and the application accepts it again.
                await self.app(scope, _after(connect, receive), _without_accept(send))
            else:
                with suppress(RuntimeError, OSError):  # the other side may have left
                    await send({"type": "websocket.close", "code": CLOSED_BY_POLICY})
        elif refusal is None:
            await self.app(scope, receive, with_headers(send))
        else:
            await refusal(scope, receive, with_headers(send))

    def _refusal(self, scope: Scope) -> Response | None:
        headers = Headers(scope=scope)
        if headers.getlist("host") not in [[host] for host in self.hosts]:
            return PlainTextResponse(
                "the address in the browser has another host name than this page; open the address that `eimi "
                "dashboard` printed",
                421,
            )
        reads = scope["type"] == "http" and scope["method"] in SAFE
        if reads and scope["path"] == INDEX:  # also from another origin: the redirect file
            return _refused_length(scope, headers)
        open_to_all = reads and (scope["path"] == REPORT or scope["path"].startswith(STATIC))
        if scope["type"] == "http" and not open_to_all and not self._is_token(headers.get(TOKEN_HEADER, "")):
            return PlainTextResponse(
                "the token is missing or wrong; open the address that `eimi dashboard` printed when it began", 403
            )
        if headers.get("sec-fetch-site", "none") not in ("same-origin", "none"):
            return PlainTextResponse("refused: the request comes from another site", 403)
        steers = scope["type"] == "websocket" or scope["method"] not in SAFE
        if steers and headers.getlist("origin") != [f"http://{headers['host']}"]:
            return PlainTextResponse("refused: the request comes from another site", 403)
        return _refused_length(scope, headers)

    async def _is_introduced(self, receive: Receive, send: Send) -> bool:
        """Accept a WebSocket, and return whether its first message contains the token (the secret text of the page)."""
        await send({"type": "websocket.accept", "headers": []})
        try:
            message = await asyncio.wait_for(receive(), INTRODUCED_WITHIN_S)
            return self._is_token(str(json.loads(message.get("text") or "")["token"]))
        except (TimeoutError, ValueError, KeyError, TypeError, RecursionError):
            return False

    def _is_token(self, given: str) -> bool:
        return secrets.compare_digest(given.encode("utf-8", "replace"), self.token.encode())


def _refused_length(scope: Scope, headers: Headers) -> Response | None:
    most = MOST_PICTURE_BYTES if scope["path"] == RECEIVED_PICTURE else MOST_BODY_BYTES
    if int(headers.get("content-length", "0") or 0) > most or "transfer-encoding" in headers:
        return PlainTextResponse(f"the request is too long; it should have at most {most} bytes", 413)
    return None


def _after(first: Message, receive: Receive) -> Receive:
    """Return a function that returns ``first`` at its first call, and then receives messages with `receive`."""
    waiting = [first]

    async def received() -> Message:
        return waiting.pop() if waiting else await receive()

    return received


def _without_accept(send: Send) -> Send:
    """Return a function that sends all messages but the acceptance of a WebSocket, which was sent before."""

    async def sent(message: Message) -> None:
        if message["type"] != "websocket.accept":
            await send(message)

    return sent


def with_headers(send: Send) -> Send:
    """Return a function that adds security headers to an answer and sends it with `send`."""

    async def bound(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in HEADERS.items():
                headers.setdefault(name, value)
        await send(message)

    return bound

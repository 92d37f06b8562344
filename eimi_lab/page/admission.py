"""Who may ask the page for anything, and what a browser may do with its answers.

A page of another site that is open in the same browser is the one to fear: it can send requests to this machine, and
sockets are not bound by the same-origin policy. So a request is answered only if

- its Host is one of ours (a foreign name that resolves to this machine, DNS rebinding, has another),
- it carries the cookie, which only the address with the token gives, and which no foreign site's request carries,
- its Origin is ours where it is a POST or a WebSocket, and the browser does not call it one of another site.

The token leaves the address at once, by a redirect: it would stand in the history and in bookmarks.
"""

from __future__ import annotations

import secrets
from dataclasses import dataclass, field
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

TOKEN = "token"
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
REPORT_POLICY = "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'none'"
"""Of a report, whose styles and pictures are in it, and which runs nothing."""

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
CLOSED_BY_POLICY = 1008  # RFC 6455, 7.4.1


def new_token() -> str:
    """256 bits that nobody guesses."""
    return secrets.token_urlsafe(32)


@dataclass(frozen=True)
class Admission:
    """ASGI middleware before everything else.

    hosts: what Host may be, port included. token: what the address must hold once, and the cookie ever after.
    """

    app: ASGIApp
    hosts: frozenset[str]
    token: str = field(repr=False)

    @property
    def cookie(self) -> str:
        """Its name: cookies do not know ports, and there may be two pages on a machine."""
        port = min(self.hosts).rpartition(":")[2]
        return f"eimi_{port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer with a refusal, or with the application's answer and the headers that bind a browser."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        refusal = self._refusal(scope)
        if refusal is None:
            await self.app(scope, receive, with_headers(send))
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": CLOSED_BY_POLICY})
        else:
            await refusal(scope, receive, with_headers(send))

    def _refusal(self, scope: Scope) -> Response | None:
        headers = Headers(scope=scope)
        if headers.getlist("host") not in [[host] for host in self.hosts]:
            return PlainTextResponse("this page is not known by that name", 421)
        given = parse_qs(scope["query_string"].decode("latin-1")).get(TOKEN, [])
        if scope["type"] == "http" and scope["method"] == "GET" and scope["path"] == "/" and given:
            return self._begin(given[-1])
        if not self._same(self._cookie(headers)):
            return PlainTextResponse("open the address that `eimi dashboard` printed when it began", 403)
        if headers.get("sec-fetch-site", "none") not in ("same-origin", "none"):
            return PlainTextResponse("asked by another site", 403)
        steers = scope["type"] == "websocket" or scope["method"] not in SAFE
        if steers and headers.getlist("origin") != [f"http://{headers['host']}"]:
            return PlainTextResponse("asked by another site", 403)
        if int(headers.get("content-length", "0") or 0) > MOST_BODY_BYTES or "transfer-encoding" in headers:
            return PlainTextResponse("too long", 413)
        return None

    def _begin(self, given: str) -> Response:
        if not self._same(given):
            return PlainTextResponse("the token is that of another `eimi dashboard`; take the newest address", 403)
        answer = RedirectResponse("/", 303)
        answer.set_cookie(self.cookie, self.token, httponly=True, samesite="strict")
        return answer

    def _cookie(self, headers: Headers) -> str:
        try:
            sent = SimpleCookie("; ".join(headers.getlist("cookie")))
        except CookieError:
            return ""
        return sent[self.cookie].value if self.cookie in sent else ""

    def _same(self, given: str) -> bool:
        return secrets.compare_digest(given.encode("utf-8", "replace"), self.token.encode())


def with_headers(send: Send) -> Send:
    """Add what binds the browser to every answer that does not say otherwise."""

    async def bound(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in HEADERS.items():
                headers.setdefault(name, value)
        await send(message)

    return bound

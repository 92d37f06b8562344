"""The open browser tabs of the live web page. One tab controls the run; the other tabs watch."""

from __future__ import annotations

import asyncio
import json
import secrets
import time
from collections import deque
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.websockets import WebSocket, WebSocketDisconnect

from eimi_lab.process.errors import InputError

MOST_TABS = 16
FRAME_ACKNOWLEDGED_WITHIN_S = 1.0
KEPT_AGES = 2000
TRY_LATER = 1013  # close code of a WebSocket, "Try Again Later", in the registry of RFC 6455

TAB_HEADER = "x-tab"

Act = Callable[[dict[str, Any]], Awaitable[Any]]


async def body_of(request: Request) -> dict[str, Any]:
    """Return the JSON object in the body of a request. Raises InputError if the body is not a JSON object."""
    try:
        asked = await request.json()
    except (ValueError, RecursionError) as error:
        raise InputError("the body of the request is not JSON; it should be a JSON object") from error
    if not isinstance(asked, dict):
        raise InputError("the body of the request should be a JSON object")
    return asked


def table_of(body: dict[str, Any], key: str) -> dict[str, Any]:
    """Return the JSON object under a key in the body of a request. Raises InputError if there is no JSON object."""
    table = body.get(key)
    if not isinstance(table, dict):
        raise InputError(f"{key} is missing: the request should have a JSON object under this key")
    return table


@dataclass(eq=False)
class Tab:
    """An open browser tab of the page, with the messages that are not sent to it yet.

    ``socket`` is the WebSocket of the tab, and ``name`` identifies the tab. ``frame`` and ``edges`` are the newest
    frame and edges that are not sent yet. ``stale`` tells whether a new state of the page (run, camera and fit) is not
    sent yet. ``wake`` is set when there is something to send. ``waiting`` contains two times (s, monotonic clock) of
    the frame that the tab has not shown yet: when it was sent and when it was captured.
    """

    socket: WebSocket
    name: str = field(default_factory=lambda: secrets.token_urlsafe(16))
    stale: bool = True
    frame: bytes | None = None
    edges: str | None = None
    waiting: tuple[float, float] | None = None
    wake: asyncio.Event = field(default_factory=asyncio.Event)


class Tabs:
    """The open browser tabs of the page, one of which may control the run.

    Parameters
    ----------
    state : callable
        Returns the state of the page (run, camera and fit) as a JSON object.
    """

    def __init__(self, state: Callable[[], dict[str, Any]]) -> None:
        self._state = state
        self._open: set[Tab] = set()
        self._steers: Tab | None = None
        self._at_s = 0.0
        self.ages_s: deque[float] = deque(maxlen=KEPT_AGES)

    def may_steer(self, name: str) -> bool:
        """Return whether the browser tab with this name controls the run."""
        return self._steers is not None and secrets.compare_digest(self._steers.name.encode(), name.encode())

    def check_control(self, request: Request) -> None:
        """Raise InputError if a request does not come from the tab that controls the run."""
        if not self.may_steer(request.headers.get(TAB_HEADER, "")):
            raise InputError(
                'this browser tab only watches the run; take control first, with the button "Take control"'
            )

    def steered(self, act: Act) -> Callable[[Request], Awaitable[Response]]:
        """Return a function that answers a request with the result of `act`, as JSON.

        Only the browser tab that controls the run may send the request. `act` receives the JSON object in the request.
        """

        async def answer(request: Request) -> Response:
            self.check_control(request)
            return JSONResponse(await act(await body_of(request)))

        return answer

    def any_open(self) -> bool:
        """Return whether any tab is open."""
        return bool(self._open)

    def changed(self) -> None:
        """Send the new state of the page (run, camera, fit and the tab that controls the run) to every tab."""
        for tab in self._open:
            tab.stale = True
            tab.wake.set()

    def show(self, about: dict[str, Any], picture: bytes) -> None:
        """Send a frame, or the edges of a frame, to every open tab.

        Parameters
        ----------
        about : dict
            The description of the frame, or the edges, as a JSON object.
        picture : bytes
            The frame as JPEG; empty if `about` contains edges.
        """
        text = json.dumps(about)
        if picture:
            self._at_s = about["at_s"]
            header = text.encode()
            frame = len(header).to_bytes(4, "big") + header + picture
        for tab in self._open:
            if picture:
                tab.frame = frame
            else:
                tab.edges = text
            tab.wake.set()

    async def serve(self, socket: WebSocket) -> None:
        """Exchange messages with a tab over its WebSocket until the tab closes the WebSocket."""
        await socket.accept()
        if len(self._open) >= MOST_TABS:
            await socket.close(
                TRY_LATER, f"{MOST_TABS} browser tabs with this page are open already; close one of them"
            )
            return
        tab = Tab(socket)
        self._open.add(tab)
        self._steers = self._steers or tab
        self.changed()
        sending = asyncio.create_task(self._send(tab))
        try:
            while True:
                self._handle(tab, await socket.receive_json())
        except WebSocketDisconnect:
            pass
        except (ValueError, KeyError, TypeError, RecursionError):  # the client is not this page
            with suppress(WebSocketDisconnect, RuntimeError):
                await socket.close()
        finally:
            sending.cancel()
            self._open.discard(tab)
            if self._steers is tab:
                self._steers = None
            self.changed()

    def _handle(self, tab: Tab, message: Any) -> None:
        """Handle a message of a tab: a request to take control, or the report that a frame was shown."""
        if not isinstance(message, dict):
            raise TypeError(message)
        if message.get("take"):
            self._steers = tab
            self.changed()
        elif "shown" in message and tab.waiting is not None:
            self.ages_s.append(time.monotonic() - tab.waiting[1])
            tab.waiting = None
            tab.wake.set()

    async def _send(self, tab: Tab) -> None:
        with suppress(WebSocketDisconnect, RuntimeError, OSError):
            while True:
                with suppress(TimeoutError):
                    await asyncio.wait_for(tab.wake.wait(), FRAME_ACKNOWLEDGED_WITHIN_S)
                tab.wake.clear()
                if tab.stale:
                    tab.stale = False
                    await tab.socket.send_text(json.dumps(self._state_for(tab)))
                if tab.edges is not None:
                    text, tab.edges = tab.edges, None
                    await tab.socket.send_text(text)
                now = time.monotonic()
                late = tab.waiting is not None and now - tab.waiting[0] > FRAME_ACKNOWLEDGED_WITHIN_S
                if tab.frame is not None and (tab.waiting is None or late):
                    frame, tab.frame = tab.frame, None
                    tab.waiting = now, self._at_s
                    await tab.socket.send_bytes(frame)

    def _state_for(self, tab: Tab) -> dict[str, Any]:
        control = "nobody" if self._steers is None else "you" if self._steers is tab else "other"
        return {"kind": "state", "tab": tab.name, "control": control, "tabs": len(self._open), **self._state()}

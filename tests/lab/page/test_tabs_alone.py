"""The server exchanges the right messages with each tab; replacements take the place of WebSockets."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any

import pytest
from starlette.websockets import WebSocketDisconnect

from eimi_lab.page import tabs as tabs_module
from eimi_lab.page.tabs import MOST_TABS, TRY_LATER, Tabs, body_of, table_of
from eimi_lab.process.errors import InputError
from tests.patience import PATIENCE_S


class Socket:
    def __init__(self) -> None:
        self.accepted, self.closed = False, ()
        self.sent: list[Any] = []
        self.messages: asyncio.Queue[Any] = asyncio.Queue()

    async def accept(self) -> None:
        self.accepted = True

    async def close(self, *reasons: Any) -> None:
        self.closed = (*reasons, "closed")

    async def receive_json(self) -> Any:
        message = await self.messages.get()
        if isinstance(message, Exception):
            raise message
        return message

    async def send_text(self, text: str) -> None:
        self.sent.append(json.loads(text))

    async def send_bytes(self, data: bytes) -> None:
        self.sent.append(data)

    async def until(self, true: Callable[[], bool]) -> None:
        async with asyncio.timeout(PATIENCE_S):
            while not true():
                await asyncio.sleep(0.001)

    async def next(self) -> Any:
        await self.until(lambda: bool(self.sent))
        return self.sent.pop(0)


def run(test: Callable[[], Awaitable[None]]) -> None:
    # Run a coroutine in a new thread.
    # The browser of another test may still have an event loop in this thread.

    async def whole() -> None:
        await test()

    with ThreadPoolExecutor(1) as thread:
        thread.submit(asyncio.run, whole()).result()


def test_a_frame_is_sent_after_the_frame_before_was_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    # Of the frames since then, the tab gets the newest.
    monkeypatch.setattr(tabs_module, "time", SimpleNamespace(monotonic=lambda: 105.0))

    async def test() -> None:
        tabs, socket = Tabs(lambda: {"run": 7}), Socket()
        assert not tabs.any_open()
        serving = asyncio.create_task(tabs.serve(socket))  # type: ignore[arg-type]
        state = await socket.next()
        assert (socket.accepted, tabs.any_open()) == (True, True)
        assert state == {"kind": "state", "tab": state["tab"], "control": "you", "tabs": 1, "run": 7}
        assert tabs.may_steer(state["tab"])
        tabs.show({"kind": "edges", "seen": 1}, b"")
        assert await socket.next() == {"kind": "edges", "seen": 1}
        frames = [{"kind": "frame", "at_s": 100.0 + k} for k in range(3)]
        for about in frames[:1]:
            tabs.show(about, b"JPEG")
        first = await socket.next()
        size = int.from_bytes(first[:4], "big")
        assert (json.loads(first[4 : 4 + size]), first[4 + size :]) == (frames[0], b"JPEG")
        for about in frames[1:]:
            tabs.show(about, b"JPEG")
        tabs.changed()
        assert (await socket.next())["kind"] == "state"
        assert socket.sent == []  # the tab has not shown the first frame yet
        await socket.messages.put({"shown": 1})
        second = await socket.next()
        assert json.loads(second[4 : 4 + int.from_bytes(second[:4], "big")]) == frames[2]
        assert list(tabs.ages_s) == [5.0]
        await socket.messages.put({"shown": 2})
        await socket.until(lambda: len(tabs.ages_s) == 2)
        assert list(tabs.ages_s) == [5.0, 3.0]
        await socket.messages.put({"shown": 3})  # nothing is under way
        await socket.messages.put(WebSocketDisconnect())
        await serving
        assert (len(tabs.ages_s), tabs.any_open(), tabs.may_steer(state["tab"]), socket.closed) == (2, False, False, ())

    run(test)


def test_a_tab_that_does_not_answer_gets_the_next_frame_after_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    now = {"s": 50.0}
    monkeypatch.setattr(tabs_module, "time", SimpleNamespace(monotonic=lambda: now["s"]))

    async def test() -> None:
        tabs, socket = Tabs(dict), Socket()
        serving = asyncio.create_task(tabs.serve(socket))  # type: ignore[arg-type]
        await socket.next()
        tabs.show({"at_s": 1.0}, b"a")
        assert (await socket.next()).endswith(b"a")
        for late_s, sent in ((1.0, False), (1.01, True)):
            now["s"] = 50.0 + late_s
            tabs.show({"at_s": 2.0}, b"b")
            tabs.changed()
            await socket.next()
            await asyncio.sleep(0)
            assert bool(socket.sent) is sent
        await socket.messages.put(WebSocketDisconnect())
        await serving

    run(test)


def test_the_control_passes_to_the_tab_that_takes_it() -> None:
    async def test() -> None:
        tabs, sockets = Tabs(dict), [Socket(), Socket()]
        serving = [asyncio.create_task(tabs.serve(socket)) for socket in sockets]  # type: ignore[arg-type]
        states = [await socket.next() for socket in sockets]
        assert [state["control"] for state in states] == ["you", "other"]
        await sockets[1].messages.put({"take": False})
        await sockets[1].messages.put({"take": True})
        for socket, control in zip(sockets, ("other", "you"), strict=True):
            while (state := await socket.next())["control"] != control:
                pass
            assert state["tabs"] == 2
        assert tabs.may_steer(states[1]["tab"])
        await sockets[1].messages.put(["no object"])
        await serving[1]
        assert sockets[1].closed == ("closed",)
        while (state := await sockets[0].next())["control"] != "nobody":
            pass
        assert state["tabs"] == 1
        await sockets[0].messages.put(WebSocketDisconnect())
        await serving[0]

    run(test)


def test_one_tab_more_than_sixteen_is_refused() -> None:
    async def test() -> None:
        tabs, sockets = Tabs(dict), [Socket() for _ in range(MOST_TABS + 1)]
        serving = [asyncio.create_task(tabs.serve(socket)) for socket in sockets]  # type: ignore[arg-type]
        await serving[-1]
        words = "16 browser tabs with this page are open already; close one of them"
        assert sockets[-1].closed == (TRY_LATER, words, "closed")
        assert sockets[-1].sent == []
        for socket in sockets[:-1]:
            assert (socket.accepted, socket.closed) == (True, ())
            await socket.messages.put(WebSocketDisconnect())
        await asyncio.gather(*serving)

    run(test)


def test_the_body_of_a_request_is_a_json_object() -> None:
    def request(answer: Any) -> Any:
        async def read() -> Any:
            if isinstance(answer, Exception):
                raise answer
            return answer

        return SimpleNamespace(json=read)

    async def test() -> None:
        assert await body_of(request({"a": {"b": 1}})) == {"a": {"b": 1}}
        for answer, words in (
            (ValueError(), "the body of the request is not JSON; it should be a JSON object"),
            (RecursionError(), "the body of the request is not JSON; it should be a JSON object"),
            ([1], "the body of the request should be a JSON object"),
        ):
            with pytest.raises(InputError) as refused:
                await body_of(request(answer))
            assert str(refused.value) == words

    run(test)
    assert table_of({"a": {"b": 1}}, "a") == {"b": 1}
    for body in ({}, {"a": [1]}, {"a": None}):
        with pytest.raises(InputError, match=r"^a is missing: the request should have a JSON object under this key$"):
            table_of(body, "a")

"""The server closes a WebSocket that does not behave like a browser tab of the page, and logs no error."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from typing import Any

import pytest

from tests.patience import PATIENCE_S


class Said(logging.Handler):
    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.lines.append(record.getMessage())


@pytest.fixture
def logged() -> Iterator[list[str]]:
    handler = Said()
    logger = logging.getLogger("uvicorn.error")
    logger.addHandler(handler)
    yield handler.lines
    logger.removeHandler(handler)


def without_tabs(served: Any) -> None:
    # Wait until the server has noticed that its last tab was closed.
    with served.socket() as socket:
        while '"tabs": 1' not in socket.recv(timeout=PATIENCE_S):
            pass


@pytest.mark.parametrize("message", ["{", "null", "[1]", '"take"', b"\x00\xff", "[" * 30_000])
def test_a_socket_with_an_unknown_message_is_closed_silently(
    served: Any, logged: list[str], message: str | bytes
) -> None:
    with served.socket() as socket:
        socket.send(message)
        for _ in socket:  # until the page closes the socket
            pass
    without_tabs(served)
    assert logged == []


def test_a_tab_that_closes_leaves_no_message_on_the_terminal(served: Any, logged: list[str]) -> None:
    for _ in range(3):
        with served.socket():
            pass
    with served.socket() as torn:
        torn.socket.close()
    without_tabs(served)
    assert logged == []


def state_with(socket: Any, **expected: Any) -> dict[str, Any]:
    # Return the next message about the state of the page that has the values `expected`.
    while True:
        message = socket.recv(timeout=PATIENCE_S)
        if isinstance(message, str):
            state: dict[str, Any] = json.loads(message)
            if state.get("kind") == "state" and expected.items() <= state.items():
                return state


def test_one_tab_is_in_control_and_control_ends_with_its_tab(served: Any) -> None:
    with served.socket() as watching:
        with served.socket() as second:
            first_name = state_with(watching, control="you", tabs=2)["tab"]
            assert state_with(second, control="other", tabs=2)["tab"] != first_name
            second.send('{"take": true}')
            name = state_with(second, control="you")["tab"]
            state_with(watching, control="other")
            assert [served.page.tabs.may_steer(tab) for tab in (name, first_name, "", "x")] == [
                True,
                False,
                False,
                False,
            ]
        state_with(watching, control="nobody", tabs=1)
        assert not served.page.tabs.may_steer(name)
        watching.send('{"take": true}')
        state_with(watching, control="you", tabs=1)
        assert served.page.tabs.may_steer(first_name)


def test_when_a_tab_without_control_closes_the_control_stays_with_its_tab(served: Any) -> None:
    with served.socket() as steering:
        with served.socket() as watching:
            state_with(watching, control="other", tabs=2)
        name = state_with(steering, control="you", tabs=1)["tab"]
        assert served.page.tabs.may_steer(name)

"""WebSockets that do not behave like a tab are closed, without a message on the terminal."""

from __future__ import annotations

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
def said() -> Iterator[list[str]]:
    """Collect the messages of the server's log."""
    handler = Said()
    logger = logging.getLogger("uvicorn.error")
    logger.addHandler(handler)
    yield handler.lines
    logger.removeHandler(handler)


def without_tabs(served: Any) -> None:
    """Wait until the server has noticed that the last tab has closed."""
    with served.socket() as socket:
        while '"tabs": 1' not in socket.recv(timeout=PATIENCE_S):
            pass


@pytest.mark.parametrize("message", ["{", "null", "[1]", '"take"', b"\x00\xff", "[" * 30_000])
def test_a_socket_with_an_unknown_message_is_closed_silently(
    served: Any, said: list[str], message: str | bytes
) -> None:
    with served.socket() as socket:
        socket.send(message)
        for _ in socket:  # until the page closes it
            pass
    without_tabs(served)
    assert said == []


def test_a_tab_that_closes_leaves_no_message_on_the_terminal(served: Any, said: list[str]) -> None:
    for _ in range(3):
        with served.socket():
            pass
    with served.socket() as torn:
        torn.socket.close()
    without_tabs(served)
    assert said == []

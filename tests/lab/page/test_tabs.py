"""Sockets that are not a tab's: closed, and no word of them on the terminal."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from typing import Any

import pytest
from websockets.sync.client import ClientConnection, connect

from tests.patience import PATIENCE_S


class Said(logging.Handler):
    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.lines.append(record.getMessage())


@pytest.fixture
def said() -> Iterator[list[str]]:
    """What the server tells the terminal."""
    handler = Said()
    logger = logging.getLogger("uvicorn.error")
    logger.addHandler(handler)
    yield handler.lines
    logger.removeHandler(handler)


def opened(served: Any) -> ClientConnection:
    headers = {"Cookie": f"eimi_{served.port}={'t' * 43}"}
    return connect(f"ws://{served.host}/live", origin=f"http://{served.host}", additional_headers=headers, proxy=None)


def without_tabs(served: Any) -> None:
    """Waits until the last one's end has reached the server."""
    with opened(served) as socket:
        while '"tabs": 1' not in socket.recv(timeout=PATIENCE_S):
            pass


@pytest.mark.parametrize("message", ["{", "null", "[1]", '"take"', b"\x00\xff"])
def test_who_speaks_another_language_is_hung_up_on(served: Any, said: list[str], message: str | bytes) -> None:
    with opened(served) as socket:
        socket.send(message)
        for _ in socket:  # until the page closes it
            pass
    without_tabs(served)
    assert said == []


def test_a_tab_that_closes_is_not_worth_a_word(served: Any, said: list[str]) -> None:
    for _ in range(3):
        with opened(served):
            pass
    with opened(served) as torn:
        torn.socket.close()
    without_tabs(served)
    assert said == []

"""Sockets that are not a tab's: closed, and no word of them on the terminal."""

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
    """What the server tells the terminal."""
    handler = Said()
    logger = logging.getLogger("uvicorn.error")
    logger.addHandler(handler)
    yield handler.lines
    logger.removeHandler(handler)


def without_tabs(served: Any) -> None:
    """Waits until the last one's end has reached the server."""
    with served.socket() as socket:
        while '"tabs": 1' not in socket.recv(timeout=PATIENCE_S):
            pass


@pytest.mark.parametrize("message", ["{", "null", "[1]", '"take"', b"\x00\xff", "[" * 30_000])
def test_who_speaks_another_language_is_hung_up_on(served: Any, said: list[str], message: str | bytes) -> None:
    with served.socket() as socket:
        socket.send(message)
        for _ in socket:  # until the page closes it
            pass
    without_tabs(served)
    assert said == []


def test_a_tab_that_closes_is_not_worth_a_word(served: Any, said: list[str]) -> None:
    for _ in range(3):
        with served.socket():
            pass
    with served.socket() as torn:
        torn.socket.close()
    without_tabs(served)
    assert said == []

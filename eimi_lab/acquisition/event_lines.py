"""Events as lines of JSON: one object a line, with the name of the event under the key `event`.

A thread writes them, so that a reader who is slow or gone never holds up a run.
"""

from __future__ import annotations

import json
import logging
import math
import os
import queue
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from typing import Any

from eimi_lab.acquisition.events import EVENTS, Event, OnEvent

LAST_LINES_S = 1.0
"""At the end the reader has so long to take what is left."""

_log = logging.getLogger(__name__)


def to_line(event: Event) -> str:
    """Return the event as one line of JSON without a line end. A number that is not finite becomes null."""
    return json.dumps({"event": event.event, **_finite(asdict(event))}, ensure_ascii=False)


def from_line(line: str | bytes) -> Event | None:
    """Return the event of a line; None for an event that this release does not have.

    Keys that this release does not have are ignored.

    Raises
    ------
    ValueError
        The line is not a JSON object of an event, or a field has the wrong type.
    """
    from pydantic import TypeAdapter  # slow to import, and the guardian, which starts with every run, only writes

    fields = json.loads(line)
    if not isinstance(fields, dict) or not isinstance(fields.get("event"), str):
        raise ValueError(f"{line!r} is no event: a JSON object with the key 'event' would be")
    kind = EVENTS.get(fields.pop("event"))
    return None if kind is None else TypeAdapter(kind).validate_python(fields)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


class EventLines:
    """Writes events to a file descriptor in a thread of its own: whoever sends one never waits."""

    def __init__(self, descriptor: int) -> None:
        """Start the thread, which closes the descriptor at the end."""
        self._descriptor = descriptor
        self._waiting: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._writer = threading.Thread(target=self._write, name="events", daemon=True)
        self._writer.start()

    def __call__(self, event: Event) -> None:
        """Send an event; returns at once."""
        self._waiting.put(to_line(event) + "\n")

    def finish(self) -> None:
        """Send what is left, for a moment at most."""
        self._waiting.put(None)
        self._writer.join(LAST_LINES_S)

    def _write(self) -> None:
        try:
            with open(self._descriptor, "w", encoding="utf-8") as lines:
                while line := self._waiting.get():
                    lines.write(line)
                    lines.flush()
        except OSError as error:
            _log.info("nobody reads the events any more: %s", error)


@contextmanager
def heard_by(listener: OnEvent, descriptor: int | None) -> Iterator[OnEvent]:
    """Yield where to send events: to `listener`, and as lines to a copy of `descriptor`, unless that is None."""
    if descriptor is None:
        yield listener
        return
    lines = EventLines(os.dup(descriptor))

    def heard(event: Event) -> None:
        lines(event)
        listener(event)

    try:
        yield heard
    finally:
        lines.finish()

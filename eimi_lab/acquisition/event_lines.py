"""Write and read events as lines of JSON: one object per line, with the name of the event under the key `event`.

A thread writes the lines, so that a slow or missing reader never delays a run.
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
"""Time that the reader has at the end to take the remaining lines."""

_log = logging.getLogger(__name__)


def to_line(event: Event) -> str:
    """Return the event as one line of JSON, without a newline. A number that is not finite becomes null."""
    return json.dumps({"event": event.event, **_finite(asdict(event))}, ensure_ascii=False)


def from_line(line: str | bytes) -> Event | None:
    """Return the event of a line, or None if this release has no event of that name.

    Keys that this release does not have are ignored.

    Raises
    ------
    ValueError
        If the line is not a JSON object of an event, or if a field has the wrong type.
    """
    from pydantic import TypeAdapter  # slow to import, and the guardian, which starts with every run, only writes

    fields = json.loads(line)
    if not isinstance(fields, dict) or not isinstance(fields.get("event"), str):
        raise ValueError(f"{line!r} is no event; it should be a JSON object with the key 'event'")
    kind = EVENTS.get(fields.pop("event"))
    return None if kind is None else TypeAdapter(kind).validate_python(fields)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


class EventLines:
    """Writes events to a file descriptor in a thread, so that the sender never waits.

    The thread closes the descriptor at the end.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._waiting: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._writer = threading.Thread(target=self._write, name="events", daemon=True)
        self._writer.start()

    def __call__(self, event: Event) -> None:
        """Send an event. Returns at once."""
        self._waiting.put(to_line(event) + "\n")

    def finish(self) -> None:
        """Write the remaining events, for at most `LAST_LINES_S`."""
        self._waiting.put(None)
        self._writer.join(LAST_LINES_S)

    def _write(self) -> None:
        try:
            with open(self._descriptor, "w", encoding="utf-8") as lines:
                while line := self._waiting.get():
                    lines.write(line)
                    lines.flush()
        except OSError as error:
            _log.info("the reader of the events is gone: %s", error)


@contextmanager
def sending_events(listener: OnEvent, descriptor: int | None) -> Iterator[OnEvent]:
    """Yield a function that sends an event to `listener` and writes it as a line of JSON.

    Parameters
    ----------
    listener : OnEvent
        Receives every event.
    descriptor : int or None
        File descriptor to whose copy the lines are written. None writes no lines.
    """
    if descriptor is None:
        yield listener
        return
    lines = EventLines(os.dup(descriptor))

    def send(event: Event) -> None:
        lines(event)
        listener(event)

    try:
        yield send
    finally:
        lines.finish()

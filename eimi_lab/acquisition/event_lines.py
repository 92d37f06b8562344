"""Write and read the events of a run (records of what happened) as lines of JSON.

The key `event` of a line gives the name of the event.
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
"""Longest time (s) for which `finish` waits until a reader has taken the remaining lines."""

_log = logging.getLogger(__name__)


def to_line(event: Event) -> str:
    """Return an event (a record of what happened in a run) as one line of JSON, without a newline.

    A number that is not finite becomes null.
    """
    return json.dumps({"event": event.event, **_finite(asdict(event))}, ensure_ascii=False)


def from_line(line: str | bytes) -> Event | None:
    """Return the event (a record of what happened in a run) in a line of JSON; None if its name is unknown.

    Unknown keys are ignored.

    Raises
    ------
    ValueError
        If the line is not a JSON object with the key `event`, or if a field has the wrong type.
    """
    from pydantic import TypeAdapter  # slow to import; the guardian process only writes events and does not need it

    fields = json.loads(line)
    if not isinstance(fields, dict) or not isinstance(fields.get("event"), str):
        raise ValueError(f"{line!r} is no event; an event is a JSON object with the key 'event'")
    kind = EVENTS.get(fields.pop("event"))
    return None if kind is None else TypeAdapter(kind).validate_python(fields)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


class EventLines:
    """A function that writes events (records of what happened in a run) as lines of JSON to a file descriptor.

    Another thread writes the lines, so that the caller never waits. After `finish`, the descriptor is closed.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._waiting: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._writer = threading.Thread(target=self._write, name="events", daemon=True)
        self._writer.start()

    def __call__(self, event: Event) -> None:
        """Pass an event to the thread that writes it. Returns at once."""
        self._waiting.put(to_line(event) + "\n")

    def finish(self) -> None:
        """Wait until the remaining events are written, but at most for one second."""
        self._waiting.put(None)
        self._writer.join(LAST_LINES_S)

    def _write(self) -> None:
        try:
            # The backslash notation of a character without an UTF-8 form is also that of JSON.
            with open(self._descriptor, "w", encoding="utf-8", errors="backslashreplace") as lines:
                while line := self._waiting.get():
                    lines.write(line)
                    lines.flush()
        except OSError as error:
            _log.info("the program that read the events has closed its pipe: %s", error)


@contextmanager
def sending_events(listener: OnEvent, descriptor: int | None) -> Iterator[OnEvent]:
    """Yield a function that passes an event (a record of what happened) to `listener` and writes it as a line of JSON.

    Parameters
    ----------
    listener : OnEvent
        Receives every event.
    descriptor : int or None
        File descriptor for the lines; None writes no lines.
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

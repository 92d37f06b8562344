"""Report that the coil may still be on if switching it off takes long."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from eimi_lab.acquisition.events import OffNotConfirmed, OnEvent


@contextmanager
def doubted_after(seconds: float, doubt: OffNotConfirmed | None, on_event: OnEvent) -> Iterator[None]:
    """Send an event if the body of the with statement, which switches the coil off, takes longer than a given time.

    Parameters
    ----------
    seconds : float
        Time after which the event is sent, s.
    doubt : OffNotConfirmed or None
        The event: the coil may still be on. None sends nothing.
    on_event : OnEvent
        Receives the event, in another thread.
    """
    if doubt is None:
        yield
        return
    timer = threading.Timer(seconds, on_event, (doubt,))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
        timer.join()

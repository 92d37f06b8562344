"""Report that the coil may still be on if switching it off takes long."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from eimi_lab.acquisition.events import OffNotConfirmed, OnEvent


@contextmanager
def doubted_after(seconds: float, doubt: OffNotConfirmed | None, on_event: OnEvent) -> Iterator[None]:
    """Report that the coil may still be on, if the body of a with statement takes longer than a given time.

    The body contains an attempt to switch the coil off. If the connection to the supply has failed, the attempt can
    take several seconds before it raises an error.

    Parameters
    ----------
    seconds : float
        Time after which the report is sent, s.
    doubt : OffNotConfirmed or None
        The event that is sent after this time, from another thread; None sends nothing.
    on_event : OnEvent
        Receives the event.
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

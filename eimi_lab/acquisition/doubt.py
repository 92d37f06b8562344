"""Report that the coil may still be on while an attempt to switch it off takes long."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from eimi_lab.acquisition.events import OffNotConfirmed, OnEvent


@contextmanager
def doubted_after(seconds: float, doubt: OffNotConfirmed | None, on_event: OnEvent) -> Iterator[None]:
    """Send `doubt` from another thread if the context lasts longer than this time (s); None sends nothing.

    On a line that has failed, several seconds can pass until an attempt fails too.
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

"""React to signals during an operation of a run.

An `Interruption` belongs to a bench. Long operations call its methods at points where they can be interrupted: the line
to the supply between two messages, the camera while it waits for its driver, the writer of the dataset while it stores
a state. These calls do nothing unless a run is inside `heeding`.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol


class Heeded(Protocol):
    """A run that reacts to signals. The first two methods may raise `Stopped` and InstrumentError."""

    def stop_if_asked(self) -> None:
        """Interrupt the present operation if a signal has come."""

    def leave_in_haste(self) -> None:
        """Interrupt the present operation if a second signal has come, or if the run stood still for too long."""

    def switch_off_in_haste(self) -> None:
        """Switch the coil off, once, if a second signal has come; the operation continues. Raises nothing."""


class Interruption:
    """Connects the instruments and files of a bench with the run that uses them; without a run, calls do nothing."""

    def __init__(self) -> None:
        self._run: Heeded | None = None

    @contextmanager
    def heeding(self, run: Heeded) -> Iterator[None]:
        """Pass the calls of instruments and files to this run until the context ends."""
        self._run = run
        try:
            yield
        finally:
            self._run = None

    def between_messages(self) -> None:
        """Interrupt the exchange with the supply after a second signal, or if the run stood still for too long.

        The line to the supply calls this before each message, because the read-backs of a set-point take long on a
        slow line.
        """
        if self._run:
            self._run.leave_in_haste()

    def while_waiting(self) -> None:
        """End the wait for the camera after a signal, and report to the guardian that the run is alive.

        The camera calls this repeatedly while it waits for its driver.
        """
        if self._run:
            self._run.stop_if_asked()

    def while_storing(self) -> None:
        """Switch the coil off after a second signal, while the writer finishes the storage of a state."""
        if self._run:
            self._run.switch_off_in_haste()

"""What a run does about signals while one of its operations is under way.

An `Interruption` belongs to a bench. What takes long is given one of its methods when it is made, and calls it where it
may be broken off: the line to the supply between two messages, the camera while a call of its driver lasts, the writer
of the dataset while it stores a state. Outside `heeding` these calls do nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol


class Heeded(Protocol):
    """A run that heeds signals. Each method may raise `Stopped`."""

    def stop_if_asked(self) -> None:
        """Leave what is under way after the first signal."""

    def leave_in_haste(self) -> None:
        """Leave what is under way after the second signal."""

    def switch_off_in_haste(self) -> None:
        """Switch the coil off after the second signal, once, and go on with what is under way. Raises nothing."""


class Interruption:
    """Passes what a bench's instruments and files ask on to the run that is under way, if one is."""

    def __init__(self) -> None:
        self._run: Heeded | None = None

    @contextmanager
    def heeding(self, run: Heeded) -> Iterator[None]:
        """Ask this run while the context lasts."""
        self._run = run
        try:
            yield
        finally:
            self._run = None

    def between_messages(self) -> None:
        """For the line to the supply, before each message: a second signal leaves the rest of the exchanges out.

        A run that stood still for long does not send another set-point either.

        On a slow line the read-backs of a set-point are most of what it takes.
        """
        if self._run:
            self._run.leave_in_haste()

    def while_waiting(self) -> None:
        """For the camera, again and again while a call lasts: the run moves on, and a signal ends the wait."""
        if self._run:
            self._run.stop_if_asked()

    def while_storing(self) -> None:
        """For the writer: a state is stored to its end, with the coil switched off meanwhile after a second signal."""
        if self._run:
            self._run.switch_off_in_haste()

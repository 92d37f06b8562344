"""React to signals such as Ctrl-C during a long operation of a run.

The supply, the camera and the writer of the dataset call methods of an `Interruption` during their operations. Inside
`with heeding(run)`, these methods let the run react; otherwise they do nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol


class Heeded(Protocol):
    """A run that reacts to signals such as Ctrl-C.

    The first signal asks the run to stop, a second signal asks it to stop at once.
    """

    def stop_if_asked(self) -> None:
        """Raise an error if a signal has asked the run to stop."""

    def leave_in_haste(self) -> None:
        """Raise an error if a second signal (Ctrl-C again) has come, or the run took no step for too long."""

    def switch_off_in_haste(self) -> None:
        """Switch the coil off, at most once, if a second signal (Ctrl-C again) has come or the current is wrong.

        Raises no error.
        """


class Interruption:
    """Methods that the instruments and the writer of the dataset call during long operations.

    Inside `with heeding(run)`, each call lets the run react to a signal such as Ctrl-C; otherwise it does nothing.
    """

    def __init__(self) -> None:
        self._run: Heeded | None = None

    @contextmanager
    def heeding(self, run: Heeded) -> Iterator[None]:
        """Let the run `run` react to signals, such as Ctrl-C, inside the with statement."""
        self._run = run
        try:
            yield
        finally:
            self._run = None

    def between_messages(self) -> None:
        """Raise an error if a second signal (Ctrl-C again) has come, or the run took no step for too long.

        The connection to the supply calls the method before each message.
        """
        if self._run:
            self._run.leave_in_haste()

    def while_waiting(self) -> None:
        """Raise an error if a signal has come. The camera calls the method while it waits."""
        if self._run:
            self._run.stop_if_asked()

    def while_storing(self) -> None:
        """Switch the coil off if a second signal (Ctrl-C again) has come or the current is wrong.

        The writer of the dataset calls the method while it stores a state (load step).
        """
        if self._run:
            self._run.switch_off_in_haste()

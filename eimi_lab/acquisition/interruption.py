"""React to signals such as Ctrl-C during an operation of a run.

An `Interruption` belongs to a bench (the open instruments of a run). Long operations call its methods at points where
they can be interrupted:

- the line to the supply, between two messages;
- the camera, while it waits for its driver;
- the writer of the dataset, while it stores a state (load step).

A run enters the context `heeding`. Outside this context, the methods do nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol


class Heeded(Protocol):
    """A run that reacts to signals such as Ctrl-C.

    The first signal asks the run to stop, and a second signal asks it to stop at once. `stop_if_asked` and
    `leave_in_haste` interrupt the run by raising `Stopped` or InstrumentError.
    """

    def stop_if_asked(self) -> None:
        """Interrupt the present operation of the run if a signal, such as Ctrl-C, has asked the run to stop."""

    def leave_in_haste(self) -> None:
        """Interrupt the present operation at once, if a second signal (Ctrl-C again) has asked the run to stop.

        The operation is also interrupted if the run took no step for too long.
        """

    def switch_off_in_haste(self) -> None:
        """Switch the coil off, at most once, if a second signal (Ctrl-C again) has come or the current is wrong.

        The operation that called this method continues. The method raises no error.
        """


class Interruption:
    """Methods that long operations call at points where a signal may interrupt them.

    The open instruments and the writer of the dataset call these methods. Inside `with heeding(run)`, each call is
    passed to the run, which may raise an error to interrupt the operation. Outside, the methods do nothing.
    """

    def __init__(self) -> None:
        self._run: Heeded | None = None

    @contextmanager
    def heeding(self, run: Heeded) -> Iterator[None]:
        """Let a run react to signals, such as Ctrl-C, during long operations in the body of the with statement.

        During a long operation, the instruments and the writer of the dataset repeatedly call the other methods of this
        object. In the body of the with statement, these methods pass each call to `run`, which then reacts to a signal.
        """
        self._run = run
        try:
            yield
        finally:
            self._run = None

    def between_messages(self) -> None:
        """Interrupt the exchange with the supply if a second signal (Ctrl-C again) has asked the run to stop.

        The exchange is also interrupted if the run took no step for too long. The method raises an error to interrupt,
        and otherwise does nothing. The connection to the supply calls the method before each message, because sending a
        set-point and reading it back take long on a slow connection.
        """
        if self._run:
            self._run.leave_in_haste()

    def while_waiting(self) -> None:
        """End the wait for the camera with an error if a signal has come. The camera calls this method while it waits.

        The call also tells the guardian process, which switches the coil off if the run dies, that the run is alive.
        """
        if self._run:
            self._run.stop_if_asked()

    def while_storing(self) -> None:
        """Switch the coil off now if a second signal (Ctrl-C again) has come or the current is wrong.

        The writer of the dataset calls this method repeatedly while it stores a state (load step). Storing the state
        then continues to its end. The method is also called before each sensor is read.
        """
        if self._run:
            self._run.switch_off_in_haste()

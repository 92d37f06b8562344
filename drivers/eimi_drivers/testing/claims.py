"""Run checks of a driver, and raise an error that describes each failure."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager
from typing import TypeVar

Value = TypeVar("Value")
Bench = TypeVar("Bench")
Check = Callable[[Bench], None]

LONGEST = 60
"""Largest number of characters of a returned value that a message contains."""


def claim(holds: bool, otherwise: str) -> None:
    """Raise AssertionError with the message `otherwise` if `holds` is false."""
    if not holds:
        raise AssertionError(otherwise)


def must_raise(errors: tuple[type[Exception], ...], doing: str, act: Callable[[], object]) -> Exception:
    """Call `act`, which must raise an error of one of the given types, and return this error.

    Parameters
    ----------
    errors : tuple of exception classes
        Permitted types.
    doing : str
        Description of the call, for messages.
    act : callable
        Function that is called.

    Raises
    ------
    AssertionError
        `act` raised no error or an error of another type.
    """
    wanted = " or ".join(error.__name__ for error in errors)
    try:
        answer = act()
    except errors as error:
        return error
    except AssertionError:  # raised by `within`
        raise
    except Exception as error:
        raise AssertionError(f"{doing} should raise {wanted}, but raised {type(error).__name__}: {error}") from error
    raise AssertionError(f"{doing} should raise {wanted}, but returned {_shortened(repr(answer))}")


def within(seconds: float, doing: str, act: Callable[[], Value]) -> Value:
    """Call `act`, and return its value or raise its error.

    Parameters
    ----------
    seconds : float
        Time limit, s.
    doing : str
        Description of the call, for messages.
    act : callable
        Function that is called in a new thread.

    Raises
    ------
    AssertionError
        `act` did not end within the time limit.
    """
    ends: queue.SimpleQueue[tuple[list[Value], BaseException | None]] = queue.SimpleQueue()

    def run() -> None:
        try:
            ends.put(([act()], None))
        except BaseException as error:  # raised again in the waiting thread
            ends.put(([], error))

    threading.Thread(target=run, name=doing, daemon=True).start()
    try:
        answers, error = ends.get(timeout=seconds)
    except queue.Empty:
        raise AssertionError(f"{doing} should end within {seconds:g} s, but did not") from None
    if error is not None:
        raise error
    return answers[0]


def run_checks(
    subject: str, checks: Iterable[Check[Bench]], open_bench: Callable[[], AbstractContextManager[Bench]]
) -> None:
    """Run all checks, and raise one error that lists the failed checks.

    Parameters
    ----------
    subject : str
        Name of the driver, for the message.
    checks : iterable of functions
        Functions that take an open instrument (a bench) and raise an error if the check fails.
    open_bench : callable
        Returns a context manager that opens the instrument for one check.

    Raises
    ------
    AssertionError
        At least one check failed; the message lists all failed checks.
    """
    failures: list[str] = []
    cause: Exception | None = None
    for check in checks:
        try:
            with open_bench() as bench:
                check(bench)
        except Exception as error:  # any error of a driver is a failed check
            words = str(error) if isinstance(error, AssertionError) else f"{type(error).__name__}: {error}"
            failures.append(f"{check.__name__}: {' '.join(words.split())}")
            cause = cause or error
    if failures:
        raise AssertionError(f"{subject}: {'; '.join(failures)}") from cause


def _shortened(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= LONGEST else f"{line[:LONGEST]}..."

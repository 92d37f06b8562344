"""The parts of the handling of Windows paths, files in use and console events that can be tested on any system."""

from __future__ import annotations

import errno
import time
from pathlib import Path

import pytest

from eimi_lab.process import console, replacing
from eimi_lab.process.paths import reachable, with_prefix
from tests.shared.changed_module import changed_module

DEEP = "\\folder" * 40


@pytest.mark.parametrize(
    ("absolute", "reached"),
    [
        ("C:\\runs\\run.h5", "run.h5"),
        (f"C:{DEEP}\\run.h5", f"\\\\?\\C:{DEEP}\\run.h5"),
        (f"\\\\server\\share{DEEP}", f"\\\\?\\UNC\\server\\share{DEEP}"),
        (f"\\\\?\\C:{DEEP}\\run.h5", f"\\\\?\\C:{DEEP}\\run.h5"),
        (f"\\\\?\\C:{DEEP}\\runs\\..\\frames/a.png", f"\\\\?\\C:{DEEP}\\frames\\a.png"),
        (f"\\\\?\\UNC\\server\\share{DEEP}\\..\\x", f"\\\\?\\UNC\\server\\share{DEEP[:-7]}\\x"),
        (f"\\\\?\\UNC\\server\\share\\..\\..{DEEP}", f"\\\\?\\UNC\\server\\share{DEEP}"),
        ("\\\\.\\COM10", "run.h5"),
        ("C:\\" + "x" * 157, "run.h5"),
        ("C:\\" + "x" * 158, "\\\\?\\C:\\" + "x" * 158),
    ],
)
def test_a_long_path_of_windows_gets_the_prefix_for_long_paths(absolute: str, reached: str) -> None:
    assert with_prefix(absolute, "run.h5") == reached


def test_only_windows_needs_the_prefix(monkeypatch: pytest.MonkeyPatch) -> None:
    long = Path("/" + "x" * 200)
    monkeypatch.setattr(replacing.sys, "platform", "linux")
    assert reachable(long) is long
    monkeypatch.setattr(replacing.sys, "platform", "win32")
    assert str(reachable(long)) == f"\\\\?\\{long}"
    assert reachable(Path("/short")) == Path("/short")


@pytest.mark.parametrize(("event", "acts"), [(0, False), (1, False), (2, True), (5, True), (6, True), (3, False)])
def test_the_events_that_end_a_process_of_windows_are_handled(
    monkeypatch: pytest.MonkeyPatch, event: int, acts: bool
) -> None:
    # Event 0 is Ctrl-C, 1 Ctrl-Break, 2 closing, 5 log-off and 6 shutdown; 3 is reserved.
    done: list[str] = []
    waits = changed_module(time, sleep=lambda seconds: done.append(f"waits {seconds:g} s"))
    monkeypatch.setattr(console, "time", waits)
    assert console.handled(event, lambda: done.append("acts")) == int(acts)
    assert done == (["acts", f"waits {console.HELD_S:g} s"] if acts else [])


@pytest.mark.parametrize("number", [None, 5, 32, 33])
def test_a_file_that_another_program_of_windows_holds_for_a_moment_is_tried_again(
    monkeypatch: pytest.MonkeyPatch, number: int | None
) -> None:
    monkeypatch.setattr(replacing.sys, "platform", "win32")
    errors = [held(number), held(number)]
    assert replacing.patiently(lambda: raise_first(errors)) == "opened"


@pytest.mark.parametrize(("system", "number"), [("win32", 112), ("linux", 32)])
def test_any_other_error_of_a_file_is_raised_at_once(monkeypatch: pytest.MonkeyPatch, system: str, number: int) -> None:
    monkeypatch.setattr(replacing.sys, "platform", system)
    errors = [held(number), held(number)]
    with pytest.raises(PermissionError):
        replacing.patiently(lambda: raise_first(errors))
    assert len(errors) == 1


def held(number: int | None) -> PermissionError:
    # Return Python's error for a file in use, with an error number of Windows or without one.
    error = PermissionError(errno.EACCES, "Permission denied")
    error.winerror = number  # type: ignore[attr-defined]
    return error


def raise_first(errors: list[PermissionError]) -> str:
    # Raise the first error, and remove it from the list; return "opened" if the list is empty.
    if errors:
        raise errors.pop(0)
    return "opened"

"""A file that needs more than a quarter of the free memory, or too much time, gives an error of one line."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from eimi_lab.process import limits
from eimi_lab.process.errors import InputError

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="has no limits of processes")

FILE = Path("run.h5")
INFINITE = -1
"""RLIM_INFINITY of the replaced module `resource`."""


@pytest.fixture
def soft_limits(monkeypatch: pytest.MonkeyPatch) -> dict[int, tuple[int, int]]:
    # The soft and the hard limits of this process, by number: 7 is the processor time, and 9 the address space.
    kept = {7: (INFINITE, INFINITE), 9: (INFINITE, INFINITE)}
    replaced = SimpleNamespace(RLIMIT_CPU=7, RLIMIT_AS=9, RLIM_INFINITY=INFINITE)
    replaced.getrlimit, replaced.setrlimit = kept.__getitem__, kept.__setitem__
    monkeypatch.setitem(sys.modules, "resource", replaced)
    return kept


@pytest.fixture
def meminfo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    # The path of a file that takes the place of /proc/meminfo.
    if sys.platform != "linux":
        pytest.skip("has no /proc/meminfo")
    asked = {"/proc/meminfo": tmp_path / "meminfo"}
    monkeypatch.setattr(limits, "Path", asked.__getitem__)
    return tmp_path / "meminfo"


def test_the_available_memory_is_read_in_units_of_1024_bytes(
    meminfo: Path, soft_limits: dict[int, tuple[int, int]]
) -> None:
    meminfo.write_text("MemTotal:  9000 kB\nMemFree:  10 kB\nMemAvailable:   3000 kB\nBuffers:  20 kB\n")
    assert limits.free_memory_bytes() == 3_072_000
    soft_limits[9] = (3_072_001, INFINITE)
    assert limits.free_memory_bytes() == 3_072_000
    soft_limits[9] = (2_000_000, INFINITE)
    assert limits.free_memory_bytes() == 2_000_000


@pytest.mark.parametrize("text", [None, "MemTotal: 5 kB\n", "MemAvailable:\n", "MemAvailable: many kB\n"])
def test_an_unreadable_number_is_replaced_by_the_number_of_free_pages(
    meminfo: Path,
    soft_limits: dict[int, tuple[int, int]],
    monkeypatch: pytest.MonkeyPatch,
    text: str | None,
) -> None:
    if text is not None:
        meminfo.write_text(text)
    monkeypatch.setattr(os, "sysconf", {"SC_AVPHYS_PAGES": 700, "SC_PAGE_SIZE": 4096}.__getitem__)
    assert limits.free_memory_bytes() == 2_867_200

    def unknown(name: str) -> int:
        raise ValueError(name)

    monkeypatch.setattr(os, "sysconf", unknown)
    assert limits.free_memory_bytes() == 4 * 1024**3
    monkeypatch.setattr(os, "sysconf", lambda name: 0)
    assert limits.free_memory_bytes() == 4 * 1024**3


@pytest.mark.parametrize(("status", "free"), [(0, 8 << 30), (-1, 4 << 30)])
def test_macos_has_half_of_its_installed_memory(
    monkeypatch: pytest.MonkeyPatch, soft_limits: dict[int, tuple[int, int]], status: int, free: int
) -> None:
    # sysctlbyname(3) writes hw.memsize, 64 bits, and returns 0 if it succeeds.

    def ask(name: bytes, value: Any, length: Any, new: object, new_length: int) -> int:
        assert (name, length._obj.value, new, new_length) == (b"hw.memsize", 8, None, 0)
        value._obj.value = (16 << 30) + 1
        return status

    monkeypatch.setattr(sys, "platform", "darwin")
    monkeypatch.setattr(ctypes, "CDLL", lambda name: SimpleNamespace(sysctlbyname=ask))
    monkeypatch.setattr(os, "sysconf", {"SC_AVPHYS_PAGES": 0, "SC_PAGE_SIZE": 4096}.__getitem__)
    assert limits.free_memory_bytes() == free
    assert isinstance(limits.free_memory_bytes(), int)


def test_a_quarter_of_the_free_memory_is_allowed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "free_memory_bytes", lambda: 4_000_000_003)
    limits.refuse_unpacked(1_000_000_000, "run.h5: frame 3")
    with pytest.raises(InputError) as caught:
        limits.refuse_unpacked(1_000_000_001, "run.h5: frame 3")
    assert str(caught.value) == (
        "run.h5: frame 3 would take 1 GB of memory; at most a quarter of the free memory of this computer is used, "
        "which is 1 GB now"
    )


@pytest.mark.parametrize(
    ("soft", "hard", "asked", "new"),
    [
        (INFINITE, INFINITE, 500, 500),
        (400, INFINITE, 500, 400),
        (600, 700, 500, 500),
        (INFINITE, 450, 500, 450),
    ],
)
def test_a_limit_is_only_lowered(
    soft_limits: dict[int, tuple[int, int]], soft: int, hard: int, asked: int, new: int
) -> None:
    soft_limits[9] = soft_limits[7] = (soft, hard)
    limits.limit_memory(asked)
    assert soft_limits == {7: (soft, hard), 9: (new, hard)}
    limits.obey_processor_limit(str(asked))
    assert soft_limits[7] == (new, hard)


def child(number: int | str) -> list[str]:
    # Return a command that ends with an exit status (int), or sends a signal (text such as "KILL") to itself.
    if isinstance(number, int):
        return ["sh", "-c", f"echo $0; exit {number}"]
    return ["sh", "-c", f"kill -{number} $$"]


@pytest.mark.parametrize("status", [0, 2])
def test_a_child_gets_its_limit_as_last_argument_and_returns_its_status_and_output(status: int) -> None:
    done = limits.run_limited(FILE, child(status), 6.6)
    assert (done.returncode, done.stdout) == (status, b"7\n")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("XCPU", "run.h5: reading the file took longer than 7 s of processor time"),
        ("KILL", "run.h5: the process that read the file was ended by SIGKILL; the memory may not suffice"),
        ("TERM", "run.h5: the process that read the file was ended by SIGTERM; the memory may not suffice"),
        ("HUP", "run.h5: the process that read the file was ended by SIGHUP; the memory may not suffice"),
        ("SEGV", "run.h5: is damaged: the process that read this file crashed (signal SIGSEGV)"),
        ("ABRT", "run.h5: is damaged: the process that read this file crashed (signal SIGABRT)"),
    ],
)
def test_the_signal_that_ended_a_child_is_explained(name: str, words: str) -> None:
    with pytest.raises(InputError) as caught:
        limits.run_limited(FILE, child(name), 7.0)
    assert str(caught.value) == words


def test_a_child_that_waits_for_ever_is_ended_after_an_hour_more(monkeypatch: pytest.MonkeyPatch) -> None:
    def run(command: list[str], timeout: float, **options: Any) -> None:
        raise subprocess.TimeoutExpired(command, timeout)

    monkeypatch.setattr(subprocess, "run", run)
    with pytest.raises(InputError, match=r"^run\.h5: reading the file took longer than 3607 s$"):
        limits.run_limited(FILE, ["reader"], 7.0)


def test_a_child_of_another_release_ends_with_a_message(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["reader", "run.h5", "7"])
    assert limits.child_arguments(2) == ["run.h5", "7"]
    for count in (1, 3):
        with pytest.raises(SystemExit) as caught:
            limits.child_arguments(count)
        assert caught.value.code == 2
        assert "was replaced by another release" in capsys.readouterr().err

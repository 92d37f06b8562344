"""The functions of Windows are called with the numbers that Microsoft documents."""

# Headers: winbase.h, winnt.h, jobapi2.h, namedpipeapi.h and sysinfoapi.h.

from __future__ import annotations

import ctypes
import importlib.util
import os
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from tests.shared.changed_module import changed_module

HANDLE = 0x1_0000_0010
"""A handle of 64 bits. A function whose result is declared as a C int returns only its lower 32 bits."""


class Function:
    # A function of kernel32.dll: it records its arguments, and returns what the test wants.

    def __init__(self, name: str, calls: list[tuple[Any, ...]], does: Callable[..., int]) -> None:
        self.name, self.calls, self.does = name, calls, does
        self.restype: Any = ctypes.c_int

    def __call__(self, *arguments: Any) -> int | None:
        plain = (argument.value if isinstance(argument, ctypes.c_void_p) else argument for argument in arguments)
        self.calls.append((self.name, *plain))
        result = self.does(*arguments)
        return self.restype(result).value


class Kernel:
    # A replacement for kernel32.dll; its functions return 0 unless `does` gives another function.

    def __init__(self) -> None:
        self.calls: list[tuple[Any, ...]] = []
        self.does: dict[str, Callable[..., int]] = {}
        self.functions: dict[str, Function] = {}

    def __getattr__(self, name: str) -> Function:
        does: Callable[..., int] = lambda *arguments: self.does.get(name, lambda *_: 0)(*arguments)  # noqa: E731
        return self.functions.setdefault(name, Function(name, self.calls, does))

    def of(self, name: str) -> list[tuple[Any, ...]]:
        return [call[1:] for call in self.calls if call[0] == name]


@pytest.fixture
def kernel() -> Kernel:
    return Kernel()


@pytest.fixture
def console() -> SimpleNamespace:
    # A replacement for the module msvcrt, with the waiting keys and the shown characters.
    keys: list[str] = []
    shown: list[str] = []
    return SimpleNamespace(
        keys=keys,
        shown=shown,
        kbhit=lambda: bool(keys),
        getwche=lambda: keys.pop(0),
        putwch=shown.append,
        get_osfhandle=lambda descriptor: HANDLE + descriptor,
        open_osfhandle=lambda handle, flags: handle - HANDLE if flags == 0 else -1,
    )


@pytest.fixture
def on_windows(monkeypatch: pytest.MonkeyPatch, kernel: Kernel, console: Any) -> Callable[[str], ModuleType]:
    # A function that loads a module, given by its full name, as on Windows.
    monkeypatch.setattr(ctypes, "WinDLL", lambda name: kernel, raising=False)
    monkeypatch.setattr(ctypes, "WinError", lambda: OSError("not a pipe"), raising=False)
    monkeypatch.setattr(ctypes, "WINFUNCTYPE", ctypes.CFUNCTYPE, raising=False)
    monkeypatch.setattr(ctypes, "windll", SimpleNamespace(kernel32=kernel), raising=False)
    monkeypatch.setitem(sys.modules, "msvcrt", console)
    # winbase.h; Python has these names only on Windows.
    flags = {"CREATE_NO_WINDOW": 0x08000000, "CREATE_NEW_PROCESS_GROUP": 0x200, "CREATE_BREAKAWAY_FROM_JOB": 0x01000000}
    for name, value in flags.items():
        monkeypatch.setattr(subprocess, name, value, raising=False)
    monkeypatch.setattr(subprocess, "STARTUPINFO", SimpleNamespace, raising=False)
    monkeypatch.setattr(sys, "platform", "win32")

    def load(name: str) -> ModuleType:
        spec = importlib.util.find_spec(name)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    return load


Load = Callable[[str], ModuleType]


def in_a_job(flags: int) -> Callable[..., int]:
    # Return a replacement for QueryInformationJobObject, for a process in a job with LimitFlags `flags`.
    # JOBOBJECT_EXTENDED_LIMIT_INFORMATION has number 9, 144 bytes on 64-bit Windows, and LimitFlags after two times of
    # 64 bits.

    def query(job: object, number: int, limits: Any, size: int, length: Any) -> int:
        assert (job, number, size) == (None, 9, 144)
        limits[16:20] = flags.to_bytes(4, "little")
        return 1

    return query


@pytest.mark.parametrize(
    ("flags", "breaks_away", "ended"),
    [(None, False, False), (0x0800, True, False), (0x2000, False, True), (0x2800, True, True), (0x0401, False, False)],
)
def test_a_process_leaves_its_job_if_the_job_permits_it(
    on_windows: Load, kernel: Kernel, flags: int | None, breaks_away: bool, ended: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    # JOB_OBJECT_LIMIT_BREAKAWAY_OK is 0x0800, and JOB_OBJECT_LIMIT_KILL_ON_JOB_CLOSE is 0x2000.
    monkeypatch.setattr(sys, "_base_executable", sys.executable, raising=False)
    if flags is not None:
        kernel.does["QueryInformationJobObject"] = in_a_job(flags)
    module = on_windows("eimi_lab.process.detached")
    assert module.detached() == {"creationflags": 0x08000200 | (0x01000000 if breaks_away else 0)}
    assert module.ended_with_others() is ended


def test_the_interpreter_of_a_virtual_environment_is_started_directly(
    on_windows: Load, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "_base_executable", "C:\\Python\\python.exe", raising=False)
    monkeypatch.setenv("A_VARIABLE", "kept")
    options = on_windows("eimi_lab.process.detached").detached()
    assert options["executable"] == "C:\\Python\\python.exe"
    assert options["env"]["__PYVENV_LAUNCHER__"] == sys.executable
    assert options["env"]["A_VARIABLE"] == "kept"
    assert options["creationflags"] == 0x08000200


@pytest.mark.parametrize(("waited", "runs"), [(0x102, True), (0, False), (-1, False)])
def test_the_starter_of_a_process_is_watched_and_killed(
    on_windows: Load, kernel: Kernel, waited: int, runs: bool
) -> None:
    # WaitForSingleObject returns WAIT_TIMEOUT (0x102) for a process that runs.
    kernel.does = {"OpenProcess": lambda *_: HANDLE, "WaitForSingleObject": lambda *_: waited}
    starter = on_windows("eimi_lab.process.detached").Starter()
    assert kernel.of("OpenProcess") == [(0x00100000 | 0x0001, False, os.getppid())]  # SYNCHRONIZE, PROCESS_TERMINATE
    assert starter.runs() is runs
    assert kernel.of("WaitForSingleObject") == [(HANDLE, 0)]
    starter.kill()
    assert kernel.of("TerminateProcess") == [(HANDLE, 1)]


def test_a_starter_that_has_ended_already_does_not_run(on_windows: Load, kernel: Kernel) -> None:
    kernel.does = {"WaitForSingleObject": lambda *_: 0x102}
    assert not on_windows("eimi_lab.process.detached").Starter().runs()


def test_priority_and_order_of_shutdown(on_windows: Load, kernel: Kernel) -> None:
    # BELOW_NORMAL_PRIORITY_CLASS is 0x4000; 0x100 is the lowest level, reserved for the last applications.
    kernel.does = {"GetCurrentProcess": lambda: HANDLE}
    module = on_windows("eimi_lab.process.detached")
    module.give_way(5)
    module.be_shut_down_last()
    module.resume(SimpleNamespace())  # does nothing
    assert kernel.of("SetPriorityClass") == [(HANDLE, 0x4000)]
    assert kernel.of("SetProcessShutdownParameters") == [(0x100, 0)]
    assert 20_000 < module.LONGEST_ARGUMENT < 32_767 - 3 * 1024  # other arguments and the program need place, too


def test_a_pipe_is_looked_at_until_data_come_or_the_other_end_is_closed(
    on_windows: Load, kernel: Kernel, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = {"s": 0.0, "waiting": 0, "open": 1}

    def peek(pipe: Any, buffer: object, size: int, read: object, waiting: Any, left: object) -> int:
        assert (buffer, size, read, left) == (None, 0, None, None)
        waiting._obj.value = int(clock["waiting"] if clock["s"] >= 0.05 else 0)
        return int(clock["open"])

    kernel.does["PeekNamedPipe"] = peek
    module = on_windows("eimi_lab.process.pipes")
    times = {"monotonic": lambda: clock["s"], "sleep": lambda seconds: clock.update(s=clock["s"] + seconds)}
    monkeypatch.setattr(module, "time", changed_module(time, **times))
    assert module.readable(3, 0.0) is False
    assert clock["s"] == 0.0
    assert not module.readable(3, 0.1)
    assert clock["s"] == pytest.approx(0.1, abs=0.011)
    assert kernel.of("PeekNamedPipe")[0][0] == HANDLE + 3
    clock.update(s=0.0, waiting=1)
    assert module.readable(3, 1.0)
    assert clock["s"] == pytest.approx(0.05, abs=0.005)
    clock.update(s=0.0, waiting=0, open=0)
    assert module.readable(3, 1.0)
    assert clock["s"] == 0.0


@pytest.mark.parametrize("is_pipe", [True, False])
def test_a_pipe_is_set_not_to_wait(on_windows: Load, kernel: Kernel, is_pipe: bool) -> None:
    # PIPE_NOWAIT is 1.
    modes: list[int] = []

    def set_state(pipe: Any, mode: Any, collected: object, timeout: object) -> int:
        assert (collected, timeout) == (None, None)
        modes.append(mode._obj.value)
        return int(is_pipe)

    kernel.does["SetNamedPipeHandleState"] = set_state
    module = on_windows("eimi_lab.process.pipes")
    if is_pipe:
        module.never_wait_to_write(4)
    else:
        with pytest.raises(OSError, match="not a pipe"):
            module.never_wait_to_write(4)
    assert kernel.of("SetNamedPipeHandleState")[0][0] == HANDLE + 4
    assert modes == [1]


def test_handles_are_inherited_only_within_the_context(on_windows: Load, monkeypatch: pytest.MonkeyPatch) -> None:
    inherited: dict[int, bool] = {}
    monkeypatch.setattr(os, "set_handle_inheritable", inherited.__setitem__, raising=False)
    module = on_windows("eimi_lab.process.pipes")
    with module.handed_down(3, 5) as (names, options):
        assert names == [str(HANDLE + 3), str(HANDLE + 5)]
        assert options["startupinfo"].lpAttributeList == {"handle_list": [HANDLE + 3, HANDLE + 5]}
        assert inherited == {HANDLE + 3: True, HANDLE + 5: True}
    assert inherited == {HANDLE + 3: False, HANDLE + 5: False}
    assert module.received(str(HANDLE + 5)) == 5


def test_a_line_is_put_together_from_its_keys(on_windows: Load, console: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(isatty=lambda: True))
    module = on_windows("eimi_lab.process.console")
    console.keys += "stop"
    assert module.typed_line() is None
    console.keys += "q\b \rgo\n"
    assert module.typed_line() == "stop"
    assert module.typed_line() == "go"
    assert console.shown == ["\n", "\n"]
    assert module.typed_line() is None
    console.keys += "\b\bx\r"
    assert module.typed_line() == "x"


@pytest.mark.parametrize("stdin", [None, SimpleNamespace(isatty=lambda: False)])
def test_no_keys_are_read_without_a_console(
    on_windows: Load, console: Any, monkeypatch: pytest.MonkeyPatch, stdin: object
) -> None:
    monkeypatch.setattr(sys, "stdin", stdin)
    console.keys += "x\r"
    assert on_windows("eimi_lab.process.console").typed_line() is None
    assert console.keys == ["x", "\r"]


def test_a_handler_of_the_console_is_added_and_acts(
    on_windows: Load, kernel: Kernel, monkeypatch: pytest.MonkeyPatch
) -> None:
    # SetConsoleCtrlHandler adds a handler if its second argument is 1. The handler must stay alive.
    slept_s: list[float] = []
    acted: list[str] = []
    module = on_windows("eimi_lab.process.console")
    monkeypatch.setattr(module, "time", changed_module(time, sleep=slept_s.append))
    module.when_closed(lambda: acted.append("acts"))
    ((handler, add),) = kernel.of("SetConsoleCtrlHandler")
    assert add == 1
    assert module._handlers == [handler]
    assert (handler(0), acted) == (0, [])
    assert (handler(2), acted) == (1, ["acts"])
    assert slept_s == [60.0]  # longer than the 5 s for which Windows lets the process live


def test_sleep_is_inhibited_by_two_flags_and_allowed_again(on_windows: Load, kernel: Kernel) -> None:
    # ES_CONTINUOUS is 0x80000000 and ES_SYSTEM_REQUIRED is 1; ES_CONTINUOUS alone clears the other flag.
    module = on_windows("eimi_lab.process.awake")
    with suppress(KeyError), module.kept_awake("a run"):
        assert kernel.of("SetThreadExecutionState") == [(0x80000001,)]
        raise KeyError
    assert kernel.of("SetThreadExecutionState") == [(0x80000001,), (0x80000000,)]


def test_the_clock_counts_milliseconds_beyond_49_days(on_windows: Load, kernel: Kernel) -> None:
    # GetTickCount64 returns milliseconds as 64 bits; 32 bits would begin anew after 49.7 days.
    kernel.does["GetTickCount64"] = lambda: (1 << 32) + 2500
    assert on_windows("eimi_lab.process.awake").awake_s() == pytest.approx(4294967.296 + 2.5)


@pytest.mark.parametrize(("answer", "free"), [(1, 3 << 30), (0, 4 << 30)])
def test_the_free_memory_is_the_available_physical_memory(
    on_windows: Load, kernel: Kernel, answer: int, free: int
) -> None:
    # MEMORYSTATUSEX has 64 bytes: two numbers of 32 bits, then ullTotalPhys and ullAvailPhys of 64 bits.

    def status(reference: Any) -> int:
        place = ctypes.addressof(reference._obj)
        assert ctypes.sizeof(reference._obj) == 64
        assert ctypes.c_uint32.from_address(place).value == 64
        ctypes.c_uint64.from_address(place + 8).value = 16 << 30
        ctypes.c_uint64.from_address(place + 16).value = 3 << 30
        return answer

    kernel.does["GlobalMemoryStatusEx"] = status
    assert on_windows("eimi_lab.process.limits").free_memory_bytes() == free


@pytest.mark.parametrize(
    ("status", "crashed"), [(0xC0000000, True), (0xC0000005, True), (0xBFFFFFFF, False), (2, False)]
)
def test_a_process_that_crashed_has_read_a_damaged_file(
    on_windows: Load, monkeypatch: pytest.MonkeyPatch, status: int, crashed: bool
) -> None:
    # NTSTATUS numbers of errors begin with 0xC ([MS-ERREF], Microsoft); 0xC0000005 is an access violation.
    given: dict[str, Any] = {}

    def run(command: list[str], **options: Any) -> SimpleNamespace:
        given.update(options, command=command)
        return SimpleNamespace(returncode=status)

    monkeypatch.setattr(subprocess, "run", run)
    module = on_windows("eimi_lab.process.limits")
    if crashed:
        with pytest.raises(Exception, match=rf"frames\.mp4: is damaged: .*crashed \(exit status {status:#x}\)"):
            module.run_limited("frames.mp4", ["reader"], 20.4)
    else:
        assert module.run_limited("frames.mp4", ["reader"], 20.4).returncode == status
    assert given == {"command": ["reader", "20"], "capture_output": True, "timeout": 20.4, "check": False}


def test_closing_the_console_interrupts_and_then_terminates(on_windows: Load, monkeypatch: pytest.MonkeyPatch) -> None:
    # The last signal of `TERMINATION` comes first; the first one follows in time before Windows ends the process.
    done: list[object] = []
    module = on_windows("eimi_lab.process.stopping")
    monkeypatch.setattr(module, "TERMINATION", (15, 21))
    monkeypatch.setattr(module, "signal_main_thread", done.append)
    waits = changed_module(time, sleep=lambda seconds: done.append(f"waits {seconds} s"))
    monkeypatch.setattr(module, "time", waits)
    module._leave_the_console()
    assert [done[0], done[2]] == [21, 15]
    assert 0.0 < float(str(done[1]).split()[1]) < 5.0
    assert not module.SIGNALS_BETWEEN_PROCESSES

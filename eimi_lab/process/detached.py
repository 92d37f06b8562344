"""Start processes that outlive the process and the terminal that started them, and set the priority of processes."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

if sys.platform == "win32":
    _kernel = ctypes.WinDLL("kernel32")
    _kernel.OpenProcess.restype = ctypes.c_void_p
    _kernel.GetCurrentProcess.restype = ctypes.c_void_p

    # Constants of the Windows API (Microsoft, winnt.h and winbase.h).
    _SYNCHRONIZE, _PROCESS_TERMINATE = 0x00100000, 0x0001
    _WAIT_TIMEOUT = 0x102
    _BELOW_NORMAL_PRIORITY = 0x4000
    _SHUT_DOWN_LAST = 0x100
    _EXTENDED_LIMITS, _LIMITS_BYTES, _FLAGS_AT = 9, 144, 16
    """JobObjectExtendedLimitInformation: its number, its size (bytes) on 64-bit Windows, and the offset (bytes) of its
    field LimitFlags."""
    _BREAKAWAY_OK, _KILL_ON_JOB_CLOSE = 0x0800, 0x2000

    def _job_limits() -> int:
        """Return the flags of the Windows job object (group of processes) of this process; 0 if there is none."""
        limits, length = ctypes.create_string_buffer(_LIMITS_BYTES), ctypes.c_ulong()
        asked = _kernel.QueryInformationJobObject(None, _EXTENDED_LIMITS, limits, _LIMITS_BYTES, ctypes.byref(length))
        return int.from_bytes(limits.raw[_FLAGS_AT : _FLAGS_AT + 4], "little") if asked else 0


SESSION_ATTEMPTS, SESSION_AGAIN_AFTER_S = 5, 0.1

LONGEST_ARGUMENT = 24_000 if sys.platform == "win32" else 120_000
"""Largest number of characters of one argument.

A command line of Windows has at most 32767 (CreateProcessW), and an argument of Linux at most 131072 (execve(2)).
"""


def detached() -> dict[str, Any]:
    """Return the options of `subprocess.Popen` for a Python process that signals of the terminal do not reach.

    On POSIX, the process has a separate session (setsid(2)). On Windows, it has an invisible console and a separate
    process group, and leaves the job object (a group of processes that end together) of this process if permitted.
    """
    if sys.platform == "win32":
        flags = subprocess.CREATE_NO_WINDOW | subprocess.CREATE_NEW_PROCESS_GROUP
        if _job_limits() & _BREAKAWAY_OK:
            flags |= subprocess.CREATE_BREAKAWAY_FROM_JOB
        # The python.exe of a virtual environment puts the real interpreter into a job object.
        real = getattr(sys, "_base_executable", sys.executable)
        if real == sys.executable:
            return {"creationflags": flags}
        environment = os.environ | {"__PYVENV_LAUNCHER__": sys.executable}
        return {"creationflags": flags, "executable": real, "env": environment}
    return {"start_new_session": True}


def ended_with_others() -> bool:
    """Return whether this process belongs to a group of processes (job object) that Windows ends together."""
    if sys.platform == "win32":
        return bool(_job_limits() & _KILL_ON_JOB_CLOSE)
    return False


def be_shut_down_last() -> None:
    """Ask Windows to end this process after other processes when the user logs off or the computer is shut down."""
    if sys.platform == "win32":
        _kernel.SetProcessShutdownParameters(_SHUT_DOWN_LAST, 0)


class Starter:
    """The process that started this process."""

    def __init__(self) -> None:
        """Store the number of the process that started this process."""
        self._process = os.getppid()
        if sys.platform == "win32":
            self._handle = ctypes.c_void_p(_kernel.OpenProcess(_SYNCHRONIZE | _PROCESS_TERMINATE, False, self._process))

    def runs(self) -> bool:
        """Return whether the process that started this process is still running."""
        if sys.platform == "win32":
            return bool(self._handle) and _kernel.WaitForSingleObject(self._handle, 0) == _WAIT_TIMEOUT
        return os.getppid() == self._process

    def kill(self) -> None:
        """Kill the process, if it is still running."""
        if sys.platform == "win32":
            _kernel.TerminateProcess(self._handle, 1)
        elif self.runs():
            with suppress(ProcessLookupError):
                os.kill(self._process, signal.SIGKILL)


def resume(process: subprocess.Popen[bytes]) -> None:
    """Let a process that was stopped by SIGSTOP continue. On Windows, do nothing."""
    if sys.platform != "win32":
        process.send_signal(signal.SIGCONT)


def give_way(steps: int) -> None:
    """Lower the priority of this process, and of its session if this process is the leader of the session.

    Parameters
    ----------
    steps
        The number that is added to the nice value (nice(2)). On Windows every number sets the priority class "below
        normal".
    """
    if sys.platform == "win32":
        _kernel.SetPriorityClass(ctypes.c_void_p(_kernel.GetCurrentProcess()), _BELOW_NORMAL_PRIORITY)
        return
    nice = os.nice(steps)
    if os.getsid(0) == os.getpid():
        _lower_session(nice)


def _lower_session(nice: int) -> None:
    """Set the nice value (priority) of this process's session, if Linux shares the processor among sessions."""
    for _ in range(SESSION_ATTEMPTS):
        try:
            Path("/proc/self/autogroup").write_text(str(nice))
        except BlockingIOError:  # without privileges, Linux accepts one change in a tenth of a second
            time.sleep(SESSION_AGAIN_AFTER_S)
        except OSError:  # another system, or Linux without autogroups
            return
        else:
            return

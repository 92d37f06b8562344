"""Every module can be imported on a system without POSIX, such as Windows."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from tests.patience import PATIENCE_S

IMPORT_ALL = """
import importlib, pkgutil, sys
import asyncio, concurrent.futures.process, multiprocessing.resource_tracker, subprocess, tempfile  # the library's own
import cma, cv2, filelock, h5py, matplotlib.pyplot, meshio, numpy, pydantic, pyvisa_py, rich, scipy, serial, typer
import uvicorn
import serial.tools.list_ports

for name in ("fcntl", "termios", "tty", "pty", "resource", "pwd", "grp", "syslog", "readline"):
    sys.modules[name] = None  # an import of it raises ImportError
import os, select, signal, socket, time
for module, names in {
    os: "fork forkpty openpty getuid geteuid getpgrp tcgetpgrp setsid nice pread pwrite mkfifo O_NONBLOCK",
    select: "epoll poll",
    signal: "SIGHUP SIGKILL SIGCONT SIGTSTP SIGPIPE SIGXCPU pthread_kill pthread_sigmask",
    socket: "AF_UNIX",
    time: "clock_gettime CLOCK_BOOTTIME CLOCK_MONOTONIC",
}.items():
    for name in names.split():
        if hasattr(module, name):
            delattr(module, name)

count = 0
for package in ("eimi_fitting", "eimi_drivers", "eimi_lab"):
    for found in pkgutil.walk_packages(importlib.import_module(package).__path__, package + "."):
        if not found.name.endswith("__main__"):
            importlib.import_module(found.name)
            count += 1
print(count)
"""


def test_every_module_is_imported_without_the_modules_and_functions_of_posix(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", IMPORT_ALL],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout.split()[-1]) > 300

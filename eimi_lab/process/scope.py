"""Move a process into a separate systemd scope, so that the process outlives the program that started it.

A scope is a group of processes that systemd, the service manager of Linux, ends together.
"""

from __future__ import annotations

import getpass
import os
import shutil
import subprocess
from pathlib import Path

WITHIN_S = 3.0
_MANAGER = ("org.freedesktop.systemd1", "/org/freedesktop/systemd1", "org.freedesktop.systemd1.Manager")
_LINGER = Path("/var/lib/systemd/linger")
_OWN_GROUP = Path("/proc/self/cgroup")


def move_to_own_scope(name: str, description: str) -> bool:
    """Move this process into a new scope of systemd, so that the process outlives the program that started it.

    A scope is a group of processes that systemd, the service manager of Linux, ends together. The process is not moved
    if the user has no systemd, or if the process would end earlier in a scope: at the logout of the user.

    Parameters
    ----------
    name
        The first part of the scope's name.
    description
        Description of the process, which systemd shows.

    Returns
    -------
    bool
        Whether systemd moved the process.

    References
    ----------
    StartTransientUnit in org.freedesktop.systemd1(5), which systemd-run --scope uses; loginctl(1), enable-linger.
    """
    busctl = shutil.which("busctl")
    if busctl is None or not _lasts_as_long_in_a_scope():
        return False
    properties = ["2", "Description", "s", description, "PIDs", "au", "1", str(os.getpid())]
    call = [
        *_MANAGER,
        "StartTransientUnit",
        "ssa(sv)a(sa(sv))",
        f"{name}-{os.getpid()}.scope",
        "fail",
        *properties,
        "0",
    ]
    try:
        done = subprocess.run([busctl, "--user", "call", *call], capture_output=True, timeout=WITHIN_S, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return False
    return done.returncode == 0


def _lasts_as_long_in_a_scope() -> bool:
    # A scope is a group of processes of systemd, which may end them when the user logs off.
    try:
        return (_LINGER / getpass.getuser()).exists() or "/user@" in _OWN_GROUP.read_text(encoding="utf-8")
    except (OSError, KeyError):  # the system has no such files, or the user has no name
        return False

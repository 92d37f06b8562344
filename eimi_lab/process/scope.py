"""Move a process into a systemd scope of its own, so that it survives the end of the program that started it.

systemd-oomd, a desktop that closes a program, and a service that is stopped end every process of a control group.
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
    """Move this process into a new scope of the user's systemd, and return whether systemd accepted it.

    The process stays where it is if there is no systemd of the user, or if systemd would end the scope together with
    the user's session although the process would otherwise survive the session.

    Parameters
    ----------
    name
        The first part of the scope's name.
    description
        Description of the process, which systemd shows.

    References
    ----------
    StartTransientUnit in org.freedesktop.systemd1(5), which systemd-run --scope uses; loginctl(1), enable-linger.
    """
    busctl = shutil.which("busctl")
    if busctl is None or not _ends_with_the_session_anyway():
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


def _ends_with_the_session_anyway() -> bool:
    """Return whether the user's systemd lives at least as long as this process would without a scope."""
    try:
        return (_LINGER / getpass.getuser()).exists() or "/user@" in _OWN_GROUP.read_text(encoding="utf-8")
    except (OSError, KeyError):  # no such system; no name of the user
        return False

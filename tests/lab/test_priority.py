"""A process that gives way has a lower priority, also if Linux shares the processor time among sessions first."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from eimi_lab.process.detached import detached

AUTOGROUPS = Path("/proc/sys/kernel/sched_autogroup_enabled")
GIVE_WAY = """
import os
from pathlib import Path
from eimi_lab.process.detached import give_way

before = os.nice(0)
give_way(5)
print(os.nice(0) - before, Path("/proc/self/autogroup").read_text().split("nice")[1].strip(), os.nice(0))
"""


@pytest.mark.skipif(
    not AUTOGROUPS.is_file() or AUTOGROUPS.read_text().strip() != "1", reason="needs Linux with autogroups (sched(7))"
)
def test_a_process_that_leads_a_session_lowers_the_priority_of_the_session_too() -> None:
    lowered, of_session, nice = after_giving_way(leads_a_session=True)
    assert lowered == 5
    assert of_session == nice


@pytest.mark.skipif(not AUTOGROUPS.is_file(), reason="needs Linux with autogroups (sched(7))")
def test_a_process_in_the_session_of_another_process_lowers_only_itself() -> None:
    before = of_this_session()
    lowered, of_session, _ = after_giving_way(leads_a_session=False)
    assert lowered == 5
    assert of_session == before


def of_this_session() -> int:
    return int(Path("/proc/self/autogroup").read_text().split("nice")[1])


def after_giving_way(leads_a_session: bool) -> list[int]:
    """Return the change of the nice value of a process that gave way, the value of its session, and its own value."""
    options = detached() if leads_a_session else {}
    ran = subprocess.run([sys.executable, "-c", GIVE_WAY], stdout=subprocess.PIPE, text=True, check=True, **options)
    return [int(word) for word in ran.stdout.split()]

"""A process that gives way lowers its priority, and that of its Linux session (setsid) if it leads the session."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from eimi_lab.process.detached import detached

AUTOGROUPS = Path("/proc/sys/kernel/sched_autogroup_enabled")
OF_THIS_SESSION = Path("/proc/self/autogroup")
GIVE_WAY = """
import json
import os
from pathlib import Path
from eimi_lab.process.detached import give_way

before = os.nice(0)
give_way(5)
print(json.dumps([os.nice(0) - before, os.nice(0), Path("/proc/self/autogroup").read_text()]))
"""


@pytest.mark.skipif(
    not AUTOGROUPS.is_file() or AUTOGROUPS.read_text().strip() != "1", reason="needs Linux with autogroups (sched(7))"
)
def test_a_process_that_leads_a_session_lowers_the_priority_of_the_session_too() -> None:
    lowered, nice, session = after_giving_way(leads_a_session=True)
    assert lowered == 5
    assert int(session.split("nice")[1]) == nice


@pytest.mark.skipif(not OF_THIS_SESSION.is_file(), reason="needs Linux with autogroups (sched(7))")
def test_a_process_in_the_session_of_another_process_lowers_only_itself() -> None:
    before = OF_THIS_SESSION.read_text()  # empty where the session has no autogroup
    lowered, _, session = after_giving_way(leads_a_session=False)
    assert lowered == 5
    assert session == before


def after_giving_way(leads_a_session: bool) -> tuple[int, int, str]:
    # Let a process lower its own priority; return the increase of its nice value, its new nice value, and its group.
    # The group is the content of /proc/self/autogroup.
    options = detached() if leads_a_session else {}
    ran = subprocess.run([sys.executable, "-c", GIVE_WAY], stdout=subprocess.PIPE, text=True, check=True, **options)
    lowered, nice, session = json.loads(ran.stdout)
    return lowered, nice, session

"""The time limits and other bounds of a run agree with the documentation."""

from __future__ import annotations

from pathlib import Path

import pytest

from eimi_drivers.cameras import timed
from eimi_drivers.supplies import off
from eimi_lab.acquisition import coil, guardian, guardian_process, ring_downs, switching_off
from eimi_lab.config.protocol import Ramp

SAFETY = " ".join((Path(__file__).parents[2] / "docs" / "why" / "safety.md").read_text(encoding="utf-8").split())


@pytest.mark.parametrize(
    ("sentence", "seconds"),
    [
        ("within `ramp.down_within_s` ({} s unless", Ramp.model_fields["down_within_s"].default),
        ("although the output is off | The current is measured for {} s.", off.DECAYS_WITHIN_S),
        ("by more than the tolerance | The current is measured every {} s.", coil.WATCH_EVERY_S),
        ("Each reading is measured every {} s.", coil.WATCH_EVERY_S),
        ("run and guardian stand still together for more than {} s", guardian.LONGEST_GAP_S),
        ("After {} s without a step of the run, the guardian takes over", guardian.STILL_FOR_S),
        ("The camera reports an error {} s after the timeout of the frame.", timed.GRACE_S),
        ("{} s after it began to switch off a supply that does not answer", switching_off.DOUBTED_AFTER_S),
        ("the guardian prints it {} s after it took over", guardian_process.DOUBTED_AFTER_S),
        ("The run ends {} s after the last report of the guardian", guardian.SILENT_FOR_S),
    ],
)
def test_the_page_about_safety_states_the_times_of_the_code(sentence: str, seconds: float) -> None:
    assert sentence.format(f"{seconds:g}") in SAFETY


def test_the_guardian_tries_for_an_hour_and_reports_every_minute() -> None:
    assert "the guardian tries for an hour and reports its attempts every minute" in SAFETY
    assert (guardian_process.TRY_FOR_S, guardian_process.REPORT_EVERY_S) == (3600.0, 60.0)


def test_the_times_of_run_and_guardian_leave_room_for_each_other() -> None:
    # Without a sign of life, the guardian process counts as gone after 1.5 s, and the run as stopped after 5 s.
    assert 10 * guardian.BEAT_EVERY_S < guardian.SILENT_FOR_S < guardian.STILL_FOR_S < guardian.LONGEST_GAP_S
    assert coil.WATCH_EVERY_S < guardian.STILL_FOR_S
    assert ring_downs._EARLY_S < coil.WATCH_EVERY_S
    assert off.DECAYS_WITHIN_S + 2 * switching_off.DOUBTED_AFTER_S < switching_off.OFF_WITHIN_S

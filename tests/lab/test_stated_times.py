"""The time limits and other bounds of a run agree with the documentation, on which users rely."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from eimi_drivers.cameras import timed
from eimi_drivers.supplies import off
from eimi_lab.acquisition import (
    coil,
    coil_calibration,
    dry_run,
    event_lines,
    guardian,
    guardian_process,
    heating,
    pausing,
    playback,
    ring_downs,
    sensing,
    settling,
    supply_trial,
    switching_off,
)
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


# A change of one of these values changes what a person sees at the bench: state the new value and its reason here.
RELIED_ON = [
    (coil, "REACHED_WITHIN_S", 3.0),  # a supply measures a few times a second
    (coil, "POLL_S", 0.1),  # supplies measure a few times a second
    (coil, "HEED_EVERY_S", 0.02),  # STOP and Ctrl-C act at once
    (coil, "SIMULATED_CHECK_EVERY_S", 2.0),
    (coil, "SIMULATED_CHECK_AT_ZERO_EVERY_S", 8.0),
    (coil, "FOLLOWS_WITHIN_S", 1.5),
    (coil, "EXCHANGES_REMEMBERED", 3),
    (coil, "MEASURED_AGAIN_AFTER_S", 0.2),
    (coil_calibration, "SETTLED_AFTER_S", 0.5),
    (coil_calibration, "BETWEEN_READINGS_S", 0.1),
    (coil_calibration, "READINGS", 5),
    (coil_calibration, "RAMP", Ramp(rate_A_per_s=0.5, step_A=0.05, tolerance_A=0.02, down_within_s=2.0)),
    (dry_run, "FIRST_STATES", 6),
    (dry_run, "LAST_STATES", 2),
    (dry_run, "FRAME_S", 1 / 30),  # of a usual camera
    (event_lines, "LAST_LINES_S", 1.0),
    (guardian, "READY_WITHIN_S", 120.0),  # a loaded computer starts Python slowly
    (guardian, "BEAT_EVERY_S", 0.1),
    (guardian, "TAKING_OVER_WITHIN_S", 10.0),
    (guardian_process, "TRY_AGAIN_AFTER_S", 0.1),
    (guardian_process, "TRY_AGAIN_LATER_S", 1.0),
    (heating, "FRAME_WITHIN_S", 0.5),
    (heating, "STORED_WITHIN_S", 0.1),
    (off, "LEAST_OFF_A", 0.02),  # the zero of the meter of a healthy supply
    (pausing, "LOOK_EVERY_S", 0.1),
    (playback, "HELD_FRAME_S", 1 / 30),  # of a usual camera
    (playback, "NOISE_FRAMES", 8),
    (ring_downs, "_LOOK_EVERY_S", 0.1),
    (ring_downs, "_EARLY_S", 0.5),
    (sensing, "TRIED_AGAIN_AFTER_S", 2.0),
    (settling, "GRAB_TIMEOUT_S", 5.0),
    (supply_trial, "ON_FOR_S", 4.0),  # time to read the front panel
    (supply_trial, "VOLTAGE_V", 1.0),
    (supply_trial, "CURRENT_A", 0.1),
    (supply_trial, "VOLTAGE_WITHIN_V", 0.1),
    (supply_trial, "READINGS", 10),
    (switching_off, "OFF_WITHIN_S", 30.0),
]


@pytest.mark.parametrize(("module", "name", "value"), RELIED_ON, ids=lambda part: part if isinstance(part, str) else "")
def test_a_time_or_bound_has_the_value_that_is_relied_on(module: Any, name: str, value: object) -> None:
    assert getattr(module, name) == value


def test_the_times_of_run_and_guardian_leave_room_for_each_other() -> None:
    """A run and its guardian, the process that switches the coil off, send signs of life often enough.

    The run sends a sign every 0.1 s. Without a sign, the guardian counts as gone after 1.5 s, and the run as
    stopped after 5 s.
    """
    assert 10 * guardian.BEAT_EVERY_S < guardian.SILENT_FOR_S < guardian.STILL_FOR_S < guardian.LONGEST_GAP_S
    assert coil.WATCH_EVERY_S < guardian.STILL_FOR_S
    assert ring_downs._EARLY_S < coil.WATCH_EVERY_S
    assert off.DECAYS_WITHIN_S + 2 * switching_off.DOUBTED_AFTER_S < switching_off.OFF_WITHIN_S

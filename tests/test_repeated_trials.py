"""The benchmark `off_campaign` repeats a trial if the supply answers too late before the planned fault."""

from __future__ import annotations

import pytest

from benchmarks import off_campaign
from benchmarks.off_faults import FAULTS, Fault
from benchmarks.spoilt_bench import LateAnswer


@pytest.mark.parametrize(("late_starts", "is_measured"), [(0, True), (4, True), (5, False)])
def test_a_trial_without_a_fault_is_repeated(
    monkeypatch: pytest.MonkeyPatch, late_starts: int, is_measured: bool
) -> None:
    starts: list[str] = []

    def attempt(fault: Fault, after_s: float, patience: float) -> off_campaign.Outcome:
        starts.append(fault.name)
        if len(starts) <= late_starts:
            raise LateAnswer("the emulated supply is late")
        return off_campaign.Outcome(0.5, 2, 0, [])

    monkeypatch.setattr(off_campaign, "_attempt", attempt)
    if is_measured:
        assert off_campaign.attempt(FAULTS[0], 0.0, 1.0).acknowledged == 2
        assert len(starts) == late_starts + 1
    else:
        with pytest.raises(LateAnswer):
            off_campaign.attempt(FAULTS[0], 0.0, 1.0)
        assert len(starts) == off_campaign.STARTS_AT_MOST

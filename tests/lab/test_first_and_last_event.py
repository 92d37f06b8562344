"""A run sends an event at its beginning and one at its end, and logs every event."""

from __future__ import annotations

import signal
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from eimi_drivers.interfaces import InstrumentError
from eimi_lab.acquisition import run as module
from eimi_lab.acquisition.events import Event, Fault, OffConfirmed, OutputSwitched, RunBegun, RunEnded, Warned
from eimi_lab.acquisition.run import _Ending, _run_begun, _with_first_and_last_event
from eimi_lab.config.protocol import RingDown
from eimi_lab.process.stopping import Stopped

PROTOCOL: Any = SimpleNamespace(currents_A=(0.0,) * 6, ring_down=RingDown(seconds=1.0, repeats=3))
BEGUN: Any = Warned(message="the run begins")


@pytest.mark.parametrize(
    ("error", "status", "reason", "fault"),
    [
        (None, "completed", "", None),
        (Stopped(signal.SIGTERM), "stopped", "SIGTERM", None),
        (InstrumentError("deaf"), "failed", "InstrumentError", Fault(kind="InstrumentError", message="deaf")),
        (KeyboardInterrupt("now"), "failed", "KeyboardInterrupt", Fault(kind="KeyboardInterrupt", message="now")),
    ],
)
def test_the_last_event_states_how_the_run_ended_and_every_event_is_logged(
    caplog: pytest.LogCaptureFixture, error: BaseException | None, status: str, reason: str, fault: Event | None
) -> None:
    sent: list[Event] = []
    ending = _Ending(Path("run.h5"), PROTOCOL, stored=2)
    between = OutputSwitched(on=True)

    def run() -> None:
        with _with_first_and_last_event(BEGUN, ending, sent.append) as send:
            assert sent == [BEGUN]
            send(between)
            if error is not None:
                raise error

    with caplog.at_level("INFO"):
        if error is None:
            run()
        else:
            with pytest.raises(type(error)) as raised:
                run()
            assert raised.value is error
    last = RunEnded(status=status, reason=reason, stored=2, states=6, dataset="run.h5")  # type: ignore[arg-type]
    assert sent == [BEGUN, between, *([fault] if fault else []), last]
    assert caplog.messages == [str(event) for event in sent]


def test_the_last_event_has_the_path_and_the_states_of_the_writer_once_there_is_one() -> None:
    ending = _Ending(Path("run.h5"), PROTOCOL)
    assert ending.event("failed", "why") == RunEnded(
        status="failed", reason="why", stored=None, states=6, dataset="run.h5"
    )
    ending.writer = SimpleNamespace(path=Path("copy.h5"), stored=4, ring_downs=1)  # type: ignore[assignment]
    assert ending.event("completed") == RunEnded(
        status="completed", reason="", stored=4, states=6, dataset="copy.h5", missing_ring_downs=2
    )


def test_the_event_that_confirmed_the_coil_off_is_kept() -> None:
    ending = _Ending(Path("run.h5"), PROTOCOL)
    off = OffConfirmed(by="run", determined_by="commanded")
    with _with_first_and_last_event(BEGUN, ending, lambda event: None) as send:
        send(OutputSwitched(on=False))
        assert ending.off is None
        send(off)
        send(OutputSwitched(on=False))
    assert ending.off is off


@pytest.mark.parametrize("simulated", [False, True])
def test_the_first_event_states_the_facts_of_the_run(monkeypatch: pytest.MonkeyPatch, simulated: bool) -> None:
    monkeypatch.setattr(module, "without_contact", lambda supply: f"{supply} stays on")
    monkeypatch.setattr(module, "hottest", lambda protocol, coil: SimpleNamespace(share=0.4))
    protocol: Any = SimpleNamespace(name="p", currents_A=[0.0, 0.5])
    specimen: Any = SimpleNamespace(specimen=SimpleNamespace(name="s"))
    rig: Any = SimpleNamespace(
        name="r",
        simulated=simulated,
        coil=None if simulated else "coil",
        interlocks=[SimpleNamespace(reading="coil_degC")],
    )
    bench: Any = SimpleNamespace(guardian=None if simulated else "guardian", supply="supply")
    assert _run_begun(protocol, specimen, rig, bench, Path("run.h5"), simulated) == RunBegun(
        dataset="run.h5",
        protocol="p",
        specimen="s",
        rig="r",
        states=2,
        currents_A=(0.0, 0.5),
        resumes=simulated,
        guardian=not simulated,
        without_contact="" if simulated else "supply stays on",
        hottest_share=None if simulated else 0.4,
        interlocks=("coil_degC",),
    )

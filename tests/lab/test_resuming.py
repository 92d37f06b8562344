"""A run that ended early is resumed, in simulated time."""

from __future__ import annotations

import shutil
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from eimi_drivers.interfaces import Identity, InstrumentDisconnected
from eimi_lab.acquisition.events import Event, RingDownStored, RunEnded
from eimi_lab.acquisition.resuming import refuse_taken
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.config.toml import parse
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.process.errors import InputError
from eimi_lab.process.stopping import Stopped


def interrupt(setup: Any, after_A: float) -> list[str]:
    # Run until the camera fails at the set-point `after_A`; return the messages of the run.
    def fail(number: int) -> None:
        if setup.coil.state.set_current_A == after_A:
            raise InstrumentDisconnected("memory: unplugged")

    setup.camera.event = fail
    remarks: list[str] = []
    with pytest.raises(InstrumentDisconnected):
        setup.run(remark=remarks.append)
    setup.camera.event = lambda number: None
    return remarks


def test_a_run_that_ended_early_is_resumed_at_the_next_state(setup: Any) -> None:
    message = interrupt(setup, after_A=0.2)
    assert message[-1] == f"2 of 4 states are in {setup.path}; the same command with --resume continues the run"
    assert setup.stored() == [0.0, 0.1]
    set_points: list[float] = []
    setup.camera.event = lambda number: set_points.append(setup.coil.state.set_current_A)
    messages = setup.run(resume=True)
    assert [line.endswith("stored before") for line in messages] == [True, True, False, False]
    assert sorted(set(set_points)) == [0.0, 0.2, 0.3]  # no frame is taken again in a stored state
    assert setup.stored() == [0.0, 0.1, 0.2, 0.3]
    assert setup.is_off()
    with open_dataset(setup.path) as dataset:
        assert dataset.finished
        assert [state.flags for state in dataset.states] == [()] * 4
    with h5py.File(setup.path) as file:
        assert file["entry/sessions/first_state"][()].tolist() == [0, 2]
        assert np.all(np.diff(file["entry/data/time"][()]) > 0)
    assert setup.run(resume=True)[-1] == "0.3 A, stored before"  # nothing is left to do
    assert setup.stored() == [0.0, 0.1, 0.2, 0.3]


def test_a_resumed_run_sets_the_same_currents_as_the_first(setup: Any) -> None:
    up_and_down = setup.protocol.text.replace("step_A = 0.1\n\n", "step_A = 0.1\nup_and_down = true\n\n")
    setup.protocol = parse(Protocol, up_and_down, "p")
    been_up: list[int] = []

    def fail(number: int) -> None:
        if setup.coil.state.set_current_A == 0.3:
            been_up.append(number)
        elif been_up:
            raise InstrumentDisconnected("memory: unplugged on the way down")

    setup.camera.event = fail
    with pytest.raises(InstrumentDisconnected):
        setup.run()
    setup.camera.event = lambda number: None
    assert setup.stored() == [0.0, 0.1, 0.2, 0.3]
    set_points_A: list[float] = []
    take = setup.coil.set_current
    setup.coil.set_current = lambda current_A: set_points_A.append(current_A) or take(current_A)  # type: ignore[method-assign]
    setup.run(resume=True)
    assert setup.stored() == [0.0, 0.1, 0.2, 0.3, 0.2, 0.1, 0.0]
    assert set_points_A[set_points_A.index(0.1) :][:4] == [0.1, 0.2, 0.3, 0.2]


def stored_set_points(setup: Any) -> tuple[list[float], list[float]]:
    # Return the times (s) and the currents (A) of all stored set-points.
    with open_dataset(setup.path) as dataset:
        points = dataset.set_points()
    return [point.time_s for point in points], [point.current_A for point in points]


def test_the_set_points_of_an_interrupted_run_end_with_zero(setup: Any) -> None:
    setup.protocol = parse(
        Protocol, f"creep = true\ntransients = {{ frames_per_state = 4 }}\n{setup.protocol.text}", "p"
    )
    interrupt(setup, after_A=0.2)
    assert stored_set_points(setup)[1] == [0.1, 0.2, 0.0]
    setup.run(resume=True)
    times_s, currents_A = stored_set_points(setup)
    assert currents_A == [0.1, 0.2, 0.0, 0.1, 0.2, 0.3, 0.0]
    assert np.all(np.diff(times_s) > 0)


def test_the_coil_counts_as_off_between_a_crash_and_the_resumed_run(setup: Any) -> None:
    setup.protocol = parse(
        Protocol, f"creep = true\ntransients = {{ frames_per_state = 4 }}\n{setup.protocol.text}", "p"
    )
    copy = setup.path.with_name("copy.h5")

    def crash(number: int) -> None:
        if setup.coil.state.set_current_A == 0.3:
            shutil.copyfile(setup.path, copy)
            raise InstrumentDisconnected("memory: unplugged")

    setup.camera.event = crash
    with pytest.raises(InstrumentDisconnected):
        setup.run()
    setup.camera.event = lambda number: None
    shutil.move(copy, setup.path)
    with open_dataset(setup.path) as dataset:
        last_s = dataset.last_time_s()
    assert stored_set_points(setup)[1] == [0.1, 0.2]
    setup.run(resume=True)
    times_s, currents_A = stored_set_points(setup)
    assert currents_A == [0.1, 0.2, 0.0, 0.1, 0.2, 0.3, 0.0]
    assert times_s[2] == pytest.approx(last_s)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (
            lambda setup: setattr(setup, "protocol", parse(Protocol, setup.protocol.text.replace("0.3", "0.4"), "p")),
            "the protocol differs: current.stop_A was 0.3, and is 0.4 now",
        ),
        (
            lambda setup: setattr(
                setup, "specimen", parse(SpecimenFile, setup.specimen.text.replace("1070", "1080"), "s")
            ),
            "the specimen differs: specimen.density_kg_m3 was 1070.0, and is 1080.0 now",
        ),
        (
            lambda setup: setattr(setup.camera, "identify", lambda: Identity("drawn", "another", "memory")),
            (
                "the run began with other instruments: korad: .* drawn: a drawn beam at memory then, .* drawn: "
                "another at memory now"
            ),
        ),
        (
            lambda setup: setattr(setup.camera, "draw", lambda seed, shift: np.full((48, 64), seed % 250, np.uint8)),
            r"another size or type: \(96, 128\) uint8 at the beginning of the run, \(48, 64\) uint8 now",
        ),
        (lambda setup: setup.path.unlink(), "no such file to resume"),
    ],
)
def test_a_run_is_not_resumed_under_other_conditions(setup: Any, change: Callable[[Any], None], expected: str) -> None:
    interrupt(setup, after_A=0.2)
    change(setup)
    with pytest.raises(InputError, match=expected):
        setup.run(resume=True)
    assert not setup.coil.state.output


def test_a_changed_comment_does_not_prevent_a_resumed_run(setup: Any) -> None:
    interrupt(setup, after_A=0.2)
    setup.protocol = parse(Protocol, "# by day\n" + setup.protocol.text, "p")
    setup.run(resume=True)
    assert setup.stored() == [0.0, 0.1, 0.2, 0.3]


@pytest.mark.parametrize("content", ["not a dataset", ""])
def test_an_existing_file_is_replaced_only_on_request(tmp_path: Path, content: str) -> None:
    path = tmp_path / "run.h5"
    refuse_taken(path, force=False)
    path.write_text(content)
    refuse_taken(path, force=True)
    with pytest.raises(InputError, match="--force"):
        refuse_taken(path, force=False)


def stop_after_a_ring_down(event: Event) -> None:
    if isinstance(event, RingDownStored):
        signal.raise_signal(signal.SIGINT)


def ring_downs_from(path: Path) -> list[float]:
    with open_dataset(path) as dataset:
        return [step.from_A for step, _ in dataset.recorded_ring_downs()]


def test_a_run_that_ended_between_its_ring_downs_is_resumed_at_the_next_ring_down(setup: Any) -> None:
    setup.protocol = parse(Protocol, f"ring_down = {{ seconds = 0.1, repeats = 3 }}\n{setup.protocol.text}", "p")
    with pytest.raises(Stopped) as stopped:
        setup.run(on_event=stop_after_a_ring_down)
    assert str(stopped.value).endswith(
        f"all 4 states are in {setup.path}; 2 ring-downs are missing; the same command with --resume continues the run"
    )
    assert ring_downs_from(setup.path) == [0.3]
    with pytest.raises(InputError, match=r"all 4 states of a run that ended early; 2 ring-downs are missing; --resume"):
        setup.run()
    events: list[Event] = []
    set_A: list[float] = []
    take = setup.coil.set_current
    setup.coil.set_current = lambda current_A: set_A.append(current_A) or take(current_A)  # type: ignore[method-assign]
    setup.run(resume=True, on_event=events.append)
    assert [value for value in set_A if value][:3] == [0.1, 0.2, 0.3]
    assert ring_downs_from(setup.path) == [0.3, 0.3, 0.3]
    assert setup.stored() == [0.0, 0.1, 0.2, 0.3]
    assert setup.is_off()
    (ended,) = [event for event in events if isinstance(event, RunEnded)]
    assert (ended.status, ended.stored, ended.missing_ring_downs) == ("completed", 4, 0)
    set_A.clear()
    setup.run(resume=True)  # nothing is left to do
    assert set_A == [0.0]

"""A run on an emulated supply in simulated time stores its data, and ends with the coil off, also after an error."""

from __future__ import annotations

import json
import re
import signal
from itertools import pairwise
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from eimi_drivers.emulators.faults import Fault
from eimi_drivers.emulators.korad import KoradDialect
from eimi_drivers.interfaces import (
    InstrumentDisconnected,
    InstrumentError,
    Limits,
    SwitchOffFailed,
)
from eimi_lab.acquisition.dry_run import dry_run
from eimi_lab.acquisition.events import Event, OffConfirmed, RunEnded, Warned
from eimi_lab.acquisition.live_view import Live
from eimi_lab.acquisition.run import check_request
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.rig import CoilRating, load_rig
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.config.toml import parse
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.dataset.storage_failure import StorageFailed
from eimi_lab.dataset.writing import DatasetWriter
from eimi_lab.process.errors import InputError
from eimi_lab.process.stopping import Stopped


def test_a_run_stores_every_state_and_ends_with_the_coil_off(setup: Any) -> None:
    messages = setup.run()
    assert [line.split(",")[0] for line in messages] == ["0 A", "0.1 A", "0.2 A", "0.3 A"]
    assert setup.stored() == [0.0, 0.1, 0.2, 0.3]
    assert setup.is_off()
    with open_dataset(setup.path) as dataset:
        assert dataset.finished
        assert dataset.text("rig") == setup.rig.text
        assert dataset.truth() == {"model": "drawn"}
        for state in dataset.states:
            assert state.flags == ()
            assert state.field_mT == pytest.approx(4.7 * (state.current_A or 0.0))
            assert state.measured_A == pytest.approx(state.current_A, abs=0.003)


def test_a_colour_camera_settles_and_its_colours_are_stored(setup: Any) -> None:
    # Two colours are equally bright, so that the noise decides in each frame which colour is the brightest.
    grey = setup.camera.draw

    def coloured(seed: int, shift_px: float = 0.0) -> np.ndarray:
        noise = np.random.default_rng(seed).normal(0, 2, (96, 128, 3))
        drawn = np.dstack([0.6 * grey(seed, shift_px), 200.0 - 0.5 * grey(0, shift_px), 0.9 * grey(1, shift_px)])
        drawn[..., 1] += drawn[..., 2].mean() - drawn[..., 1].mean()
        return np.clip(np.rint(drawn + noise), 0, 255).astype(np.uint8)

    setup.camera.draw = coloured
    setup.run()
    with open_dataset(setup.path) as dataset:
        assert dataset.frame_format()[0] == (96, 128, 3)
        assert all(state.flags == () for state in dataset.states)
        blue, green, red = dataset.images(0)[0].reshape(-1, 3).mean(axis=0)
    assert blue < 0.75 * red
    assert green == pytest.approx(red, rel=0.02)
    assert setup.camera.number < 200  # 245 frames if the colour channel is chosen for each frame


def test_frames_are_taken_of_a_beam_at_rest(setup: Any) -> None:
    setup.run()
    with open_dataset(setup.path) as dataset:
        for state in dataset.states:
            mean = dataset.images(state.index)[-1].mean(axis=0)
            dark = np.flatnonzero(mean < 115)
            assert (dark[0] + dark[-1]) / 2 == pytest.approx(64 + 10 * (state.current_A or 0.0), abs=0.5)


def test_the_current_moves_no_faster_than_the_ramp(setup: Any, files: Path) -> None:
    slow = setup.protocol.text.replace("rate_A_per_s = 10.0", "rate_A_per_s = 0.05").replace(
        "step_A = 0.1\ntol", "step_A = 0.02\ndown_within_s = 10.0\ntol"
    )
    setup.protocol = parse(Protocol, slow, "slow")
    history: list[tuple[float, float]] = []
    take = setup.coil.set_current

    def watch(current_A: float) -> bool:
        history.append((setup.bench.clock.now(), current_A))
        return take(current_A)

    setup.coil.set_current = watch  # type: ignore[method-assign]
    setup.run()
    steps = [(b[0] - a[0], abs(b[1] - a[1])) for a, b in pairwise(history)]
    assert max(step for _, step in steps) == pytest.approx(0.02)
    assert max(step / seconds for seconds, step in steps if step) <= 0.05 * 1.001
    assert history[-1][1] == 0.0


@pytest.mark.parametrize("rate_A_per_s", [0.05, 10.0])
def test_the_ramp_down_ends_within_its_time_on_a_slow_supply(setup: Any, rate_A_per_s: float) -> None:
    text = setup.protocol.text.replace("rate_A_per_s = 10.0", f"rate_A_per_s = {rate_A_per_s}").replace(
        "step_A = 0.1\ntol", "step_A = 0.001\ndown_within_s = 1.5\ntol"
    )
    setup.protocol = parse(Protocol, text, "slow")
    clock, history = setup.bench.clock, [(0.0, 0.0)]
    take = setup.coil.set_current

    def watch(current_A: float) -> bool:
        history.append((clock.now(), current_A))
        return take(current_A)

    setup.coil.set_current = watch  # type: ignore[method-assign]
    setup.run()
    assert setup.is_off()
    down = [at for (_, before_A), (at, after_A) in pairwise(history) if after_A < before_A]
    assert down[-1] - down[0] <= 1.5 + 2 * 0.5  # the limit includes the two set-points that are sent meanwhile


def test_a_beam_that_never_comes_to_rest_is_flagged_and_stored(setup: Any) -> None:
    setup.camera.sway_px = 0.5
    messages = setup.run()
    assert setup.stored() == [0.0, 0.1, 0.2, 0.3]
    with open_dataset(setup.path) as dataset:
        assert [tuple(flag.name for flag in state.flags) for state in dataset.states] == [(), *[("NOT_SETTLED",)] * 3]
        assert dataset.states[1].flags[0].value > dataset.states[1].flags[0].limit == 1.5
    assert messages[1].endswith("NOT_SETTLED")


def test_a_camera_that_repeats_one_frame_is_never_settled(setup: Any) -> None:
    def freeze(number: int) -> None:
        setup.camera.repeats = number > 10

    setup.camera.event = freeze
    setup.run()
    with open_dataset(setup.path) as dataset:
        assert {flag.name for flag in dataset.states[-1].flags} == {"NOT_SETTLED", "DUPLICATE"}


def test_dropped_frames_are_flagged(setup: Any) -> None:
    def drop(number: int) -> None:
        setup.camera.number += 1

    setup.camera.event = drop
    setup.run()
    with open_dataset(setup.path) as dataset:
        assert [flag.name for flag in dataset.states[0].flags] == ["DROPPED"]
        assert dataset.states[0].flags[0].value == 1


def test_a_supply_that_is_on_is_refused(setup: Any) -> None:
    setup.coil.set_voltage(5.0)
    setup.coil.switch(True)
    with pytest.raises(InstrumentError, match=r"the output is on \(-?0\.0.. A, -?0\.0. V\).*--take-over"):
        setup.run()
    assert not setup.path.exists()
    assert setup.coil.state.output  # another program may use the supply


def test_a_supply_that_is_on_can_be_taken_over(setup: Any) -> None:
    setup.coil.set_voltage(10.0)
    setup.coil.set_current(0.35)
    setup.coil.switch(True)
    setup.bench.clock.sleep(1.0)
    currents_A: list[float] = []
    setup.camera.event = lambda number: currents_A.append(setup.coil.coil_current_A())
    setup.run(take_over=True)
    assert max(currents_A[:8]) < 0.001  # the beam is first recorded without a current
    assert setup.stored() == [0.0, 0.1, 0.2, 0.3]
    assert setup.is_off()


def test_a_current_that_is_not_reached_stops_the_run(setup: Any) -> None:
    setup.bench.supply.limits = Limits(1.0, 1.0)  # voltage limit: too small for 0.3 A through 4 ohm
    with pytest.raises(InstrumentError, match=r"0\.2[45]. A measured at a set-point of 0\.3 A"):
        setup.run()
    assert setup.is_off()
    assert setup.stored() == [0.0, 0.1, 0.2]


def test_a_set_point_that_the_supply_confirmed_but_did_not_apply_stops_the_run_before_a_frame_is_stored(
    setup: Any,
) -> None:
    class Lying(KoradDialect):
        def receive(self, data: bytes) -> bytes:
            if data.startswith(b"ISET1:"):
                self.asked = data.removeprefix(b"ISET1:") + b"K"
                setup.coil.locked = self.asked == b"0.200K"
            return self.asked if data == b"ISET1?" else super().receive(data)

    setup.line.instrument = Lying(setup.coil)
    with pytest.raises(InstrumentError, match=r"0\.[01]\d\d A measured at a set-point of 0\.2 A"):
        setup.run()
    assert setup.is_off()
    assert setup.stored() == [0.0, 0.1]


def test_a_protection_that_trips_stops_the_run(setup: Any) -> None:
    setup.camera.event = lambda number: setup.coil.trip() if setup.coil.state.set_current_A == 0.2 else None
    with pytest.raises(InstrumentError, match="protection tripped"):
        setup.run()
    assert setup.is_off()
    assert setup.stored() == [0.0, 0.1]


@pytest.mark.parametrize("number", [0, 7, 8, 9, 20, 45, 60])
def test_a_camera_that_fails_at_any_frame_leaves_the_coil_off(setup: Any, number: int) -> None:
    def fail(at: int) -> None:
        if at == number:
            raise InstrumentDisconnected("memory: unplugged")

    setup.camera.event = fail
    with pytest.raises(InstrumentDisconnected, match="unplugged"):
        setup.run()
    assert setup.is_off()
    assert setup.coil.coil_current_A() == pytest.approx(0.0, abs=0.05)
    assert not setup.path.exists() or setup.stored()[0] == 0.0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("frame_number", [9, 30, 55])
def test_a_signal_leaves_the_coil_off_and_restores_the_signal_handlers(
    setup: Any, number: signal.Signals, frame_number: int, request: pytest.FixtureRequest
) -> None:
    # Under nohup SIGHUP is ignored, and a run keeps ignoring it.
    before = signal.SIG_DFL if number == signal.SIGHUP else signal.getsignal(number)
    handler = signal.signal(number, before)
    request.addfinalizer(lambda: signal.signal(number, handler))

    def ask(at: int) -> None:
        if at == frame_number:
            signal.raise_signal(number)
            signal.raise_signal(number)  # a second signal must not interrupt the handling of the first

    setup.camera.event = ask
    with pytest.raises(Stopped) as caught:
        setup.run()
    assert caught.value.number == number
    assert setup.is_off()
    assert signal.getsignal(number) is before


def test_a_signal_while_switching_off_does_not_cut_it_short(setup: Any) -> None:
    class InterruptedOnTheWayDown(KoradDialect):
        def receive(self, data: bytes) -> bytes:
            if setup.coil.state.set_current_A == 0.3 and data.startswith(b"ISET1:"):
                signal.raise_signal(signal.SIGINT)
            return super().receive(data)

    setup.line.instrument = InterruptedOnTheWayDown(setup.coil)
    with pytest.raises(Stopped):
        setup.run()
    assert setup.is_off()
    assert setup.stored() == [0.0, 0.1, 0.2, 0.3]


def test_a_ramp_that_fails_is_followed_by_switching_off(setup: Any) -> None:
    def deaf_to_set_points(at: int) -> None:
        if setup.coil.state.set_current_A == 0.2:
            setup.line.inject(Fault.SILENCE, lambda message: message.startswith(b"ISET1"))
            raise InstrumentDisconnected("memory: unplugged")

    setup.camera.event = deaf_to_set_points
    with pytest.raises(SwitchOffFailed, match=r"zero: failed.*off: done.*read back: done"):
        setup.run()
    assert not setup.coil.state.output
    assert setup.stored() == [0.0, 0.1]


def test_a_full_disk_does_not_hide_that_the_coil_may_be_on(setup: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Any) -> None:
        raise StorageFailed("run.h5: the disk is full")

    def deaf(at: int) -> None:
        if setup.coil.state.set_current_A == 0.2:
            setup.line.inject(Fault.SILENCE, lambda message: message.startswith(b"ISET1"))
            monkeypatch.setattr(DatasetWriter, "append_set_points", full)
            raise InstrumentDisconnected("memory: unplugged")

    events: list[Event] = []
    setup.camera.event = deaf
    with pytest.raises(SwitchOffFailed, match=r"zero: failed"):
        setup.run(on_event=events.append)
    assert "run.h5: the disk is full" in [event.message for event in events if isinstance(event, Warned)]
    assert isinstance(events[-1], RunEnded)
    assert events[-1].reason == "SwitchOffFailed"


@pytest.mark.parametrize("error", [ZeroDivisionError("in a driver"), MemoryError(), KeyboardInterrupt()], ids=repr)
def test_any_error_in_the_ramp_down_is_followed_by_switching_off(
    setup: Any, monkeypatch: pytest.MonkeyPatch, error: BaseException
) -> None:
    setup.protocol = parse(Protocol, setup.protocol.text.replace("rate_A_per_s = 10.0", "rate_A_per_s = 0.1"), "p")
    take = setup.bench.supply.set_current
    reached: list[float] = []

    def set_current(current_A: float) -> None:
        if max(reached, default=0.0) > 0.25 > current_A:
            raise error
        reached.append(current_A)
        take(current_A)

    monkeypatch.setattr(setup.bench.supply, "set_current", set_current)
    events: list[Event] = []
    with pytest.raises(type(error)):
        setup.run(on_event=events.append)
    assert setup.is_off()
    assert [event for event in events if isinstance(event, OffConfirmed)]
    assert setup.stored() == [0.0, 0.1, 0.2, 0.3]


def test_every_frame_is_shown_with_its_state(setup: Any) -> None:
    shown: list[Live] = []
    setup.run(show=shown.append)
    assert [live.frame.number for live in shown] == list(range(1, setup.camera.number + 1))
    assert {(live.state, live.current_A) for live in shown} == {(None, None), (0, 0.0), (1, 0.1), (2, 0.2), (3, 0.3)}


def test_the_dataset_states_its_files_and_instruments(setup: Any) -> None:
    setup.run(note="first cast, 3 days old; ± 1 °C")
    with h5py.File(setup.path) as file:
        assert file["entry/user_note/data"][()].decode() == "first cast, 3 days old; ± 1 °C"
        host = json.loads(file["entry/host/data"][()])
    assert re.fullmatch(r"\S+ \(UTC[+-]\d{4}\)", host["time_zone"])
    assert host["h5py"] == h5py.__version__


def test_a_protocol_that_would_overheat_the_coil_is_refused(setup: Any) -> None:
    messages: list[str] = []
    dry_run(setup.protocol, setup.specimen, setup.rig, messages.append)
    assert any(line.startswith("coil: heated to at most ") for line in messages)
    hot = CoilRating(continuous_current_A=0.1, thermal_time_constant_s=30.0)
    setup.rig = setup.rig.model_copy(update={"coil": hot})
    for attempt in (setup.run, lambda: dry_run(setup.protocol, setup.specimen, setup.rig, messages.append)):
        with pytest.raises(InputError, match=r"could overheat the coil at state 3 \(0\.3 A\): 3\d\d %"):
            attempt()
    assert setup.camera.number == 0


def test_inputs_that_contradict_each_other_are_refused_before_an_instrument_is_touched(setup: Any) -> None:
    other = setup.specimen.text.replace("Dragon Skin 10", "Ecoflex 00-50")
    setup.specimen = parse(SpecimenFile, other, "s")
    with pytest.raises(InputError, match="'Dragon Skin 10', but the specimen small has material = 'Ecoflex 00-50'"):
        setup.run()
    assert setup.camera.number == 0


@pytest.mark.parametrize(
    ("currents", "expected"),
    [
        ("values_A = [0.0, 0.2, -0.2, -0.3]", r"current\.values_A goes to -0\.3 A at state 3"),
        ("start_A = -0.3\nstop_A = 0.3\nstep_A = 0.1", r"current\.start_A goes to -0\.3 A at state 0"),
        ("start_A = 0.0\nstop_A = -0.2\nstep_A = 0.1", r"current\.stop_A goes to -0\.2 A at state 2"),
    ],
)
def test_negative_currents_need_a_supply_that_reverses_its_current(setup: Any, currents: str, expected: str) -> None:
    text = setup.protocol.text.replace("start_A = 0.0\nstop_A = 0.3\nstep_A = 0.1", currents)
    setup.protocol = parse(Protocol, text, "p")
    with pytest.raises(InputError, match=rf"protocol short: {expected}, but supply\.driver = 'korad' of rig bench"):
        setup.run()
    with pytest.raises(InputError, match="'virtual' of rig virtual cannot reverse"):
        check_request(setup.protocol, setup.specimen, load_rig("virtual"))
    bipolar = setup.rig.supply.model_copy(update={"driver": "kepco-bop"})
    check_request(setup.protocol, setup.specimen, setup.rig.model_copy(update={"supply": bipolar}))
    assert (setup.camera.number, setup.bench.supply._link.sent) == (0, [])


def test_a_rig_that_allows_less_refuses_the_protocol(setup: Any) -> None:
    tight = setup.protocol.text.replace("stop_A = 0.3", "stop_A = 1.8").replace("current_A = 1.0", "current_A = 2.0")
    setup.protocol = parse(Protocol, tight, "p")
    with pytest.raises(InputError, match=r"goes to 1\.8 A; rig bench allows supply\.limits\.current_A = 1\.6"):
        setup.run()

"""A run on an emulated supply in simulated seconds: what is stored, and that every way out leaves the coil off."""

from __future__ import annotations

import signal
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from eimi_drivers.clock import SimulatedClock
from eimi_drivers.emulators.faults import Fault, FaultyInstrument
from eimi_drivers.emulators.korad import KoradDialect
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.interfaces import (
    Frame,
    Identity,
    InstrumentDisconnected,
    InstrumentError,
    Limits,
    SwitchOffFailed,
)
from eimi_drivers.supplies.korad import KoradSupply
from eimi_drivers.supplies.transport import InProcessTransport
from eimi_lab.acquisition.bench import Bench
from eimi_lab.acquisition.dry_run import dry_run
from eimi_lab.acquisition.run import acquire
from eimi_lab.config.protocol import Protocol, load_protocol
from eimi_lab.config.reading import parse
from eimi_lab.config.rig import Rig, load_rig
from eimi_lab.config.specimen import SpecimenFile, load_specimen
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.errors import InputError
from eimi_lab.stopping import Stopped

FRAME_S = 0.005


class DrawnCamera:
    """Looks at a drawn beam that swings out whenever the coil's current changes; `event` comes before each frame."""

    def __init__(self, coil: CoilSupply, clock: SimulatedClock, draw: Callable[..., np.ndarray]) -> None:
        self.coil, self.clock, self.draw = coil, clock, draw
        self.number = 0
        self.event: Callable[[int], None] = lambda number: None
        self.swing_s, self.sway_px = 0.1, 0.0
        self.repeats = False
        self._changed_s, self._current_A = 0.0, 0.0

    def identify(self) -> Identity:
        return Identity("drawn", "a drawn beam", "memory")

    def flush(self) -> None:
        pass

    def grab(self, timeout_s: float) -> Frame:
        self.clock.sleep(FRAME_S)
        self.event(self.number)
        set_A = self.coil.state.set_current_A
        if set_A != self._current_A:
            self._changed_s, self._current_A = self.clock.now(), set_A
        age = (self.clock.now() - self._changed_s) / self.swing_s
        shift = 10 * set_A + (5 * np.exp(-age) * np.cos(9 * age) if set_A else 0.0)
        shift += self.sway_px * np.sin(self.number) * (set_A > 0)
        self.number += 1
        if not self.repeats:
            self._image = self.draw(self.number, shift)
        return Frame(self._image, self.number, self.clock.now())

    def close(self) -> None:
        pass


@dataclass
class Setup:
    coil: CoilSupply
    line: FaultyInstrument
    camera: DrawnCamera
    bench: Bench
    protocol: Protocol
    specimen: SpecimenFile
    rig: Rig
    path: Path

    def run(self) -> list[str]:
        said: list[str] = []
        acquire(self.protocol, self.specimen, self.rig, self.bench, self.path, said.append)
        return said

    def is_off(self) -> bool:
        return not self.coil.state.output and self.coil.state.set_current_A == 0.0

    def stored(self) -> list[float | None]:
        with open_dataset(self.path) as dataset:
            assert all(dataset.images(state.index).shape == (2, 96, 128) for state in dataset.states)
            return [state.current_A for state in dataset.states]


@pytest.fixture
def setup(files: Path, frame: Callable[..., np.ndarray]) -> Setup:
    clock = SimulatedClock()
    coil = CoilSupply(clock, current_noise_A=0.0005)
    line = FaultyInstrument(KoradDialect(coil))
    supply = KoradSupply(InProcessTransport(line, clock), Limits(1.0, 10.0), clock)
    camera = DrawnCamera(coil, clock, frame)
    (files / "rig.toml").write_text(
        load_rig("bench_example").text.replace("bench_example_calibration.toml", "calibration.toml")
    )
    return Setup(
        coil,
        line,
        camera,
        Bench(supply, camera, clock, {"model": "drawn"}),
        load_protocol(files / "protocol.toml"),
        load_specimen(files / "specimen.toml"),
        load_rig(files / "rig.toml"),
        files / "run.h5",
    )


def test_a_run_stores_every_state_and_ends_with_the_coil_off(setup: Setup) -> None:
    said = setup.run()
    assert [line.split(",")[0] for line in said] == ["0 A", "0.1 A", "0.2 A", "0.3 A"]
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


def test_frames_are_taken_of_a_beam_at_rest(setup: Setup) -> None:
    setup.run()
    with open_dataset(setup.path) as dataset:
        for state in dataset.states:
            mean = dataset.images(state.index)[-1].mean(axis=0)
            dark = np.flatnonzero(mean < 115)
            assert (dark[0] + dark[-1]) / 2 == pytest.approx(64 + 10 * (state.current_A or 0.0), abs=0.5)


def test_the_current_moves_no_faster_than_the_ramp(setup: Setup, files: Path) -> None:
    slow = setup.protocol.text.replace("rate_A_per_s = 10.0", "rate_A_per_s = 0.05").replace(
        "step_A = 0.1\ntol", "step_A = 0.02\ntol"
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


def test_a_beam_that_never_rests_is_flagged_and_kept(setup: Setup) -> None:
    setup.camera.sway_px = 0.5
    said = setup.run()
    assert setup.stored() == [0.0, 0.1, 0.2, 0.3]
    with open_dataset(setup.path) as dataset:
        assert [tuple(flag.name for flag in state.flags) for state in dataset.states] == [(), *[("NOT_SETTLED",)] * 3]
        assert dataset.states[1].flags[0].value > dataset.states[1].flags[0].limit == 1.5
    assert said[1].endswith("NOT_SETTLED")


def test_a_camera_that_repeats_itself_never_looks_settled(setup: Setup) -> None:
    def freeze(number: int) -> None:
        setup.camera.repeats = number > 10

    setup.camera.event = freeze
    setup.run()
    with open_dataset(setup.path) as dataset:
        assert {flag.name for flag in dataset.states[-1].flags} == {"NOT_SETTLED", "DUPLICATE"}


def test_dropped_frames_are_flagged(setup: Setup) -> None:
    def drop(number: int) -> None:
        setup.camera.number += 1

    setup.camera.event = drop
    setup.run()
    with open_dataset(setup.path) as dataset:
        assert [flag.name for flag in dataset.states[0].flags] == ["DROPPED"]
        assert dataset.states[0].flags[0].value == 1


def test_a_supply_that_is_on_is_refused(setup: Setup) -> None:
    setup.coil.set_voltage(5.0)
    setup.coil.switch(True)
    with pytest.raises(InstrumentError, match="the output is on"):
        setup.run()
    assert not setup.path.exists()


def test_a_current_that_is_not_reached_stops_the_run(setup: Setup) -> None:
    setup.bench.supply.limits = Limits(1.0, 1.0)  # volts: too few for 0.3 A through 4 ohm
    with pytest.raises(InstrumentError, match=r"0\.2[45]. A measured at a set-point of 0\.3 A"):
        setup.run()
    assert setup.is_off()
    assert setup.stored() == [0.0, 0.1, 0.2]


def test_a_protection_that_trips_stops_the_run(setup: Setup) -> None:
    setup.camera.event = lambda number: setup.coil.trip() if setup.coil.state.set_current_A == 0.2 else None
    with pytest.raises(InstrumentError, match="protection tripped"):
        setup.run()
    assert setup.is_off()
    assert setup.stored() == [0.0, 0.1]


@pytest.mark.parametrize("number", [0, 7, 8, 9, 20, 45, 60])
def test_a_camera_that_fails_at_any_frame_leaves_the_coil_off(setup: Setup, number: int) -> None:
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
def test_a_signal_leaves_the_coil_off_and_the_handlers_as_they_were(
    setup: Setup, number: signal.Signals, frame_number: int
) -> None:
    before = signal.getsignal(number)

    def ask(at: int) -> None:
        if at == frame_number:
            signal.raise_signal(number)
            signal.raise_signal(number)  # a second one must not get in the way of the first

    setup.camera.event = ask
    with pytest.raises(Stopped) as caught:
        setup.run()
    assert caught.value.number == number
    assert setup.is_off()
    assert signal.getsignal(number) is before


def test_a_signal_while_switching_off_does_not_cut_it_short(setup: Setup) -> None:
    class InterruptedOnTheWayDown(KoradDialect):
        def receive(self, data: bytes) -> bytes:
            if setup.coil.state.set_current_A == 0.3 and data.startswith(b"ISET1:"):
                signal.raise_signal(signal.SIGINT)
            return super().receive(data)

    setup.line._instrument = InterruptedOnTheWayDown(setup.coil)
    with pytest.raises(Stopped):
        setup.run()
    assert setup.is_off()
    assert setup.stored() == [0.0, 0.1, 0.2, 0.3]


def test_a_ramp_that_fails_does_not_keep_the_output_on(setup: Setup) -> None:
    def deaf_to_set_points(at: int) -> None:
        if setup.coil.state.set_current_A == 0.2:
            setup.line.inject(Fault.SILENCE, lambda message: message.startswith(b"ISET1"))
            raise InstrumentDisconnected("memory: unplugged")

    setup.camera.event = deaf_to_set_points
    with pytest.raises(SwitchOffFailed, match=r"zero: failed.*off: done.*verify: done"):
        setup.run()
    assert not setup.coil.state.output
    assert setup.stored() == [0.0, 0.1]


def test_what_does_not_go_together_is_refused_before_anything_is_touched(setup: Setup) -> None:
    other = setup.specimen.text.replace("Dragon Skin 10", "Ecoflex 00-50")
    setup.specimen = parse(SpecimenFile, other, "s")
    with pytest.raises(InputError, match="'Dragon Skin 10', but the specimen small is of 'Ecoflex 00-50'"):
        setup.run()
    assert setup.camera.number == 0


def test_a_rig_that_allows_less_refuses_the_protocol(setup: Setup) -> None:
    tight = setup.protocol.text.replace("stop_A = 0.3", "stop_A = 1.8").replace("current_A = 1.0", "current_A = 2.0")
    setup.protocol = parse(Protocol, tight, "p")
    with pytest.raises(InputError, match=r"goes to 1\.8 A; rig bench allows supply\.limits\.current_A = 1\.6"):
        setup.run()


def test_a_dry_run_tells_the_very_messages_of_a_run(setup: Setup) -> None:
    told: list[str] = []
    dry_run(setup.protocol, setup.specimen, setup.rig, told.append)
    dry = [line.split("> ")[1] for line in told if " > " in line]
    setup.camera.swing_s = 1e-9
    setup.run()
    sent = [message.decode() for message in setup.bench.supply._link.sent]  # type: ignore[attr-defined]
    commands = ("OUT", "ISET1:", "VSET1:", "OCP", "OVP")
    limits = ("VSET1:",)  # the rig's stricter limits reach the driver through `open_bench` alone
    assert [m for m in dry if m.startswith(commands) and not m.startswith(limits)] == [
        m for m in sent if m.startswith(commands) and not m.startswith(limits)
    ]
    assert told[0] == "short on small with rig bench: 4 states"
    assert "state 3: 0.3 A, 1.41 mT, 2 frames" in told
    assert told[-1].startswith("duration: ")

"""Each safeguard of a run works without the others: wait for rest, check of the current, guardian, and limits."""

from __future__ import annotations

import dataclasses
import logging
import signal
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from eimi_drivers.clock import SimulatedClock
from eimi_drivers.emulators.korad import KoradDialect
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.interfaces import Frame, Identity, InstrumentError, Limits, Reading
from eimi_drivers.supplies.interruptible import InterruptibleTransport
from eimi_drivers.supplies.korad import KoradSupply
from eimi_drivers.supplies.scpi_profiles import KEYSIGHT_WATCHDOG
from eimi_drivers.supplies.transport import InProcessTransport
from eimi_lab.acquisition.capture import capture
from eimi_lab.acquisition.coil import Coil, never
from eimi_lab.acquisition.dry_run import dry_run
from eimi_lab.acquisition.events import Event, OffConfirmed, OutputSwitched, StopRequested
from eimi_lab.acquisition.interruption import Interruption
from eimi_lab.acquisition.open_bench import open_bench
from eimi_lab.acquisition.run import check_request
from eimi_lab.acquisition.settling import wait_until_settled
from eimi_lab.acquisition.switching_off import switching_off
from eimi_lab.config.protocol import Protocol, Ramp, Settle, SupplyLimits
from eimi_lab.config.rig import load_rig
from eimi_lab.config.specimen import load_specimen
from eimi_lab.config.toml import parse
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.page.watched_run import WatchedSupply
from eimi_lab.process.errors import InputError
from eimi_lab.process.stopping import Stopped
from eimi_lab.vision.settling_statistic import Noise, measure_noise

FRAME_S = 0.1
RULE = Settle(noise_ratio=1.5, pairs=3, drift_window_s=2.0, timeout_s=20.0)
RAMP = Ramp(rate_A_per_s=1.0, step_A=0.1, tolerance_A=0.02)


class FilmedBeam:
    # A replacement for a camera: its n-th frame shows a beam at the place `place_px(n)`.
    # buffered: number of old frames that come first.

    def __init__(self, place_px: Callable[[int], float], draw: Callable[..., NDArray[Any]]) -> None:
        self.clock = SimulatedClock()
        self._place_px, self._draw = place_px, draw
        self._taken, self.buffered = 0, 0
        self.flushes = 0

    def identify(self) -> Identity:
        return Identity("filmed", "a filmed beam", "memory")

    def flush(self) -> None:
        self.flushes += 1
        self.buffered = 0

    def grab(self, timeout_s: float) -> Frame:
        assert timeout_s == 5.0  # as documented for a camera that loses frames
        self.clock.sleep(FRAME_S)
        self._taken += 1
        if self.buffered:
            self.buffered -= 1
            return Frame(self._draw(self._taken, 40.0), -self.buffered, self.clock.now())
        return Frame(self._draw(self._taken, self._place_px(self._taken)), self._taken, self.clock.now())

    def close(self) -> None: ...


def noise_of(draw: Callable[..., NDArray[Any]]) -> Noise:
    return measure_noise([draw(1000 + k, 0.0) for k in range(8)])


def waited_s(frame: Callable[..., NDArray[Any]], place_px: Callable[[int], float], **changes: Any) -> float:
    # Return the duration of the wait for rest (s); fail if the beam did not come to rest.
    # place_px: function from the number of a frame to the position of the beam. changes: values of the table [settle].
    camera = FilmedBeam(place_px, frame)
    result = wait_until_settled(camera, camera.clock, RULE.model_copy(update=changes), noise_of(frame), never)
    assert result.flags == ()
    return result.waited_s


def test_a_beam_at_rest_is_observed_for_all_pairs_and_for_the_drift_window(frame: Callable[..., NDArray[Any]]) -> None:
    assert waited_s(frame, lambda number: 0.0) == pytest.approx(RULE.drift_window_s + FRAME_S, abs=FRAME_S)


def test_a_beam_that_creeps_too_slowly_for_two_successive_frames_is_waited_for(
    frame: Callable[..., NDArray[Any]],
) -> None:
    # The beam moves 1/50 px from frame to frame, which is below the limit.
    assert waited_s(frame, lambda number: 0.02 * min(number, 60)) > 6.0


@pytest.mark.parametrize("window_s", [0.05, 2.0])
def test_quiet_pairs_between_jerks_do_not_count_as_rest(frame: Callable[..., NDArray[Any]], window_s: float) -> None:
    # The beam jumps at every third frame. Between two jumps, two pairs of successive frames show no motion.
    assert waited_s(frame, lambda number: 2.0 * (min(number, 60) // 3), drift_window_s=window_s) > 6.0


def test_frames_buffered_by_the_camera_are_discarded(frame: Callable[..., NDArray[Any]]) -> None:
    camera = FilmedBeam(lambda number: 0.0, frame)
    camera.buffered = 4
    numbers: list[int] = []
    wait_until_settled(
        camera,
        camera.clock,
        RULE,
        noise_of(frame),
        never,
        lambda frame_of_run, at_s: numbers.append(frame_of_run.number),
    )
    assert min(numbers) > 0
    camera.buffered = 4
    taken = capture(camera, camera.clock, 3, lambda: 0.5, dict, noise_of(frame), never)
    assert [frame_of_run.number > 0 for frame_of_run in taken.frames] == [True] * 3
    assert taken.measured_A == (0.5, 0.5, 0.5)


def test_a_run_discards_frames_that_the_camera_buffered_before_it(setup: Any) -> None:
    stale, grab = [3], setup.camera.grab

    def flushed() -> None:
        stale[0] = 0

    def grabbed(timeout_s: float) -> Frame:
        taken = grab(timeout_s)
        if stale[0]:
            stale[0] -= 1
            return dataclasses.replace(taken, image=np.roll(taken.image, 30, axis=1))
        return taken

    setup.camera.flush, setup.camera.grab = flushed, grabbed
    shown: list[Any] = []
    setup.run(show=shown.append)
    assert np.abs(shown[0].frame.image.astype(int) - shown[5].frame.image).max() < 20


class Obstinate:
    # A supply that accepts every set-point but measures another current.

    limits = Limits(1.0, 10.0)

    def __init__(self, measured_A: float, clock: SimulatedClock) -> None:
        self.measured_A, self.clock = measured_A, clock
        self.asked_s: list[float] = []
        self.did: list[str] = []

    def identify(self) -> Identity:
        return Identity("none", "none", "nowhere")

    def set_current(self, current_A: float) -> None:
        self.did.append(f"{current_A:g} A")

    def measure(self) -> Reading:
        return Reading(self.measured_A, 1.0)

    def check(self) -> None:
        self.asked_s.append(self.clock.now())

    def safe_off(self) -> None:
        self.did.append("off")
        self.measured_A = 0.0


@pytest.mark.parametrize(("measured_A", "right"), [(0.5, True), (0.515, True), (0.47, False), (0.53, False)])
def test_the_current_of_every_frame_is_compared_with_its_set_point(measured_A: float, right: bool) -> None:
    clock = SimulatedClock()
    coil = Coil(Obstinate(measured_A, clock), clock, RAMP, asked_A=0.5)  # type: ignore[arg-type]
    if right:
        assert coil.measured_A() == measured_A
        coil.wait_until_reached()
        return
    for act in (coil.measured_A, coil.wait_until_reached):
        with pytest.raises(InstrumentError, match=r"A measured at a set-point of 0\.5 A"):
            act()


@pytest.mark.parametrize("asked_A", [0.0, 0.5])
def test_the_run_sends_a_message_before_the_watchdog_of_the_supply_expires(asked_A: float) -> None:
    clock = SimulatedClock()
    supply = Obstinate(asked_A, clock)
    coil = Coil(supply, clock, RAMP, asked_A=asked_A)  # type: ignore[arg-type]
    for _ in range(600):
        clock.sleep(0.1)
        coil.watch()
    assert max(np.diff([0.0, *supply.asked_s])) < 0.9 * KEYSIGHT_WATCHDOG.seconds
    assert max(np.diff([0.0, *supply.asked_s])) < 2.0


class Watcher:
    # A replacement for the guardian process; it records its calls, and may raise an error.

    def __init__(self, did: list[str]) -> None:
        self.did, self.lost = did, False

    def arm(self) -> None:
        self.did.append("arm")

    def beat(self) -> None: ...

    def expect(self, identity: Identity) -> None: ...

    def refuse_a_gap(self) -> None: ...

    def silent_s(self) -> float:
        return 0.0

    def allow(self, seconds: float) -> None:
        self.did.append("allow")

    def check(self) -> None:
        if self.lost:
            raise InstrumentError("the guardian is gone")

    def disarm(self) -> None:
        self.did.append("disarm")


def test_the_guardian_is_armed_before_the_coil_can_be_on_and_until_it_is_off() -> None:
    clock = SimulatedClock()
    supply = Obstinate(0.0, clock)
    watcher = Watcher(supply.did)
    with switching_off(Coil(supply, clock, RAMP), watcher) as stop_if_asked:  # type: ignore[arg-type]
        stop_if_asked()
        supply.did.append("run")
    assert supply.did == ["arm", "run", "allow", "off", "disarm"]


def test_a_run_without_its_guardian_ends_with_the_coil_off() -> None:
    clock = SimulatedClock()
    supply = Obstinate(0.0, clock)
    watcher = Watcher(supply.did)

    def run() -> None:
        with switching_off(Coil(supply, clock, RAMP), watcher) as stop_if_asked:  # type: ignore[arg-type]
            watcher.lost = True
            stop_if_asked()
            supply.did.append("went on")

    with pytest.raises(InstrumentError, match="guardian is gone"):
        run()
    assert supply.did == ["arm", "allow", "off", "disarm"]


def test_a_signal_whose_error_was_dropped_ends_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    # Python loses an exception that is raised in a destructor; `raise_if_asked` raises it once more.
    clock = SimulatedClock()
    supply = Obstinate(0.5, clock)

    def asked() -> None:
        raise Stopped(signal.SIGTERM)

    def run() -> None:
        with switching_off(Coil(supply, clock, RAMP, asked_A=0.5)) as stop_if_asked:  # type: ignore[arg-type]
            stop_if_asked()
            monkeypatch.setattr("eimi_lab.acquisition.switching_off.raise_if_asked", asked)
            stop_if_asked()
            supply.did.append("went on")

    with pytest.raises(Stopped):
        run()
    assert "went on" not in supply.did
    assert supply.did[-1] == "off"


@pytest.mark.parametrize(("signals", "ramped"), [(1, True), (2, False)])
def test_a_second_signal_skips_the_ramp_down(signals: int, ramped: bool, caplog: pytest.LogCaptureFixture) -> None:
    clock = SimulatedClock()
    supply = Obstinate(0.5, clock)

    def run() -> None:
        with switching_off(Coil(supply, clock, RAMP, asked_A=0.5)):  # type: ignore[arg-type]
            for _ in range(signals):
                signal.raise_signal(signal.SIGINT)

    with pytest.raises(Stopped), caplog.at_level(logging.INFO):
        run()
    assert supply.did[-1] == "off"
    assert (len(supply.did) > 3) is ramped
    assert ("without a ramp to zero" not in caplog.text) is ramped


OFF = [b"ISET1:0.000", b"OUT0", b"ISET1?", b"ISET1?", b"STATUS?", b"STATUS?", b"IOUT1?", b"VOUT1?"]


class Interrupting(KoradDialect):
    # An emulated supply that sends `signals` signals to the process when the current is set to 0.7 A.

    signals = 0

    def receive(self, data: bytes) -> bytes:
        if data == b"ISET1:0.700":
            for _ in range(self.signals):
                signal.raise_signal(signal.SIGINT)
        return super().receive(data)


def a_korad(clock: SimulatedClock, interruption: Interruption, signals: int = 0) -> tuple[KoradSupply, list[bytes]]:
    # Return an emulated supply whose output is on, and the list of all messages sent to it.
    # signals: number of signals that the emulator sends to this process when the current is set to 0.7 A.
    coil = CoilSupply(clock)
    coil.set_voltage(5.0)
    coil.switch(True)
    dialect = Interrupting(coil)
    dialect.signals = signals
    wire = InProcessTransport(dialect, clock)
    line = InterruptibleTransport(wire, interruption.between_messages)
    return KoradSupply(line, Limits(current_A=1.0, voltage_V=5.0), clock), wire.sent


@pytest.mark.parametrize("shown", [False, True])
@pytest.mark.parametrize(("signals", "asked_on"), [(1, True), (2, False)])
def test_a_second_signal_skips_the_remaining_read_backs(signals: int, asked_on: bool, shown: bool) -> None:
    clock = SimulatedClock()
    interruption = Interruption()
    supply, sent = a_korad(clock, interruption, signals)
    events: list[Event] = []
    rig = load_rig("virtual").model_copy(update={"coil": None})
    watched: Any = WatchedSupply(supply, clock, rig) if shown else supply

    def run() -> None:
        coil = Coil(watched, clock, RAMP)
        with switching_off(coil, None, interruption, events.append):
            coil.step_to(0.7)

    with pytest.raises(Stopped):
        run()
    after = sent[sent.index(b"ISET1:0.700") + 1 :]
    assert (after[0] == b"ISET1?") is asked_on
    assert after[-len(OFF) if asked_on else 0 :] == OFF
    assert [type(event) for event in events if not isinstance(event, StopRequested)] == [OutputSwitched, OffConfirmed]
    supply.set_current(0.5)  # a signal no longer interrupts the messages


def test_a_second_signal_while_a_state_is_stored_switches_off_first() -> None:
    # At the end the run confirms once more that the coil is off.
    clock = SimulatedClock()
    interruption = Interruption()
    supply, sent = a_korad(clock, interruption)
    stored, confirmed = [], []
    events: list[Event] = []

    def run() -> None:
        coil = Coil(supply, clock, RAMP)
        with switching_off(coil, None, interruption, events.append) as stop_if_asked:
            coil.step_to(0.5)
            sent.clear()
            for frame in range(4):
                if frame == 1:
                    signal.raise_signal(signal.SIGINT)
                    signal.raise_signal(signal.SIGTERM)
                interruption.while_storing()
                stored.append((frame, list(sent)))
                confirmed.append(any(isinstance(event, OffConfirmed) for event in events))
            stop_if_asked()

    with pytest.raises(Stopped):
        run()
    assert stored == [(0, []), (1, OFF), (2, OFF), (3, OFF)]
    assert confirmed == [False, True, True, True]  # the user gets the message before the state is stored
    assert sent == [*OFF, *OFF]


def test_the_guardian_stays_armed_if_the_coil_could_not_be_switched_off() -> None:
    class Stuck(Obstinate):
        def safe_off(self) -> None:
            raise InstrumentError("it stays on")

    clock = SimulatedClock()
    supply = Stuck(0.0, clock)
    with (
        pytest.raises(InstrumentError, match="it stays on"),
        switching_off(Coil(supply, clock, RAMP), Watcher(supply.did)),  # type: ignore[arg-type]
    ):
        pass
    assert "disarm" not in supply.did


def test_the_guardian_is_armed_when_a_pause_ends(setup: Any) -> None:
    did: list[str] = []
    setup.bench = dataclasses.replace(setup.bench, guardian=Watcher(did))
    switch = setup.coil.switch
    setup.coil.switch = lambda on: did.append("on" if on else "off") or switch(on)
    typed = iter([*["", "p"], *[None] * 10_000])

    def types() -> str | None:
        if setup.coil.state.output:
            return next(typed)
        setup.coil.set_voltage(3.0)  # a person changes the current at the front panel
        looks.append(True)
        return "" if len(looks) % 2 == 0 else None

    looks: list[bool] = []
    setup.run(typed=types, remark=lambda words: None)
    output = [word for word in did if word in ("arm", "on", "disarm")]
    assert output == ["arm", "on", "disarm", "arm", "on", "disarm"]
    assert setup.coil.state.set_voltage_V == 10.0


def test_the_supply_gets_the_stricter_of_the_limits_of_rig_and_protocol(files: Any) -> None:
    rig = load_rig("virtual")
    limits = rig.supply.limits
    tight = SupplyLimits(current_A=0.5 * limits.current_A, voltage_V=2 * limits.voltage_V)
    with open_bench(rig, load_specimen("type1"), tight) as bench:
        assert bench.supply.limits == Limits(0.5 * limits.current_A, limits.voltage_V)
        with pytest.raises(InstrumentError, match="was refused"):
            bench.supply.set_current(0.6 * limits.current_A)


def test_the_supply_gets_its_voltage_limit_and_the_dataset_its_tip_force(setup: Any) -> None:
    setup.protocol = parse(Protocol, "tip_force_N = 0.02\n" + setup.protocol.text, "p")
    setup.run()
    assert setup.coil.state.set_voltage_V == 10.0
    with open_dataset(setup.path) as dataset:
        assert [state.tip_force_N for state in dataset.states] == [0.02] * 4
    with pytest.raises(InputError, match="a virtual beam has no weight"):
        check_request(setup.protocol, setup.specimen, load_rig("virtual"))


def test_a_dry_run_prints_the_stricter_limits_and_the_longest_duration(setup: Any) -> None:
    messages: list[str] = []
    dry_run(setup.protocol, setup.specimen, setup.rig, messages.append)
    assert any(line.startswith("limits of the supply: 1 A, 10 V;") for line in messages)
    shortest, longest = (
        float(word) for word in messages[-1].replace("s ", " ").split() if word.replace(".", "").isdigit()
    )
    settle = setup.protocol.settle
    assert longest - shortest == pytest.approx(4 * (settle.timeout_s - settle.drift_window_s), abs=1.5)

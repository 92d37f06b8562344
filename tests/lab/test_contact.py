"""A run notices and reports the failure of its supply, the loss of the connection, and signals."""

from __future__ import annotations

import signal
from dataclasses import replace
from typing import Any

import h5py
import pytest

from eimi_drivers.emulators.faults import Fault
from eimi_drivers.interfaces import InstrumentError, InstrumentTimeout, ProtectionTripped
from eimi_lab.acquisition.dry_run import dry_run
from eimi_lab.acquisition.event_words import protection_in_words
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.toml import parse
from eimi_lab.dataset import writing
from eimi_lab.dataset.frame_chunk import append_image
from eimi_lab.dataset.layout import append
from eimi_lab.process.stopping import Stopped
from tests.lab.conftest import BEGAN_S

STAYS = "nothing switches the output off, it stays as it was set"
WATCHDOG = (
    "the supply's own watchdog switches every output off 10 s after the last message; switched on in the supply: "
    "over-voltage protection 10 % above the limit"
)


def restless(setup: Any) -> None:
    # Change a bench: the beam never comes to rest, and the protocol waits a minute for rest.
    text = setup.protocol.text.replace("timeout_s = 5.0", "timeout_s = 60.0")
    setup.protocol = parse(Protocol, text, "patient")
    setup.camera.sway_px = 0.5


def test_a_supply_that_goes_off_while_the_beam_settles_is_noticed_at_once(setup: Any) -> None:
    restless(setup)
    tripped_s: list[float] = []

    def trip(number: int) -> None:
        if setup.coil.state.set_current_A == 0.1 and not tripped_s:
            setup.coil.trip()
            tripped_s.append(setup.bench.clock.now())

    setup.camera.event = trip
    with pytest.raises(ProtectionTripped):
        setup.run()
    assert setup.bench.clock.now() - tripped_s[0] < 10  # simulated seconds
    assert setup.is_off()


def test_a_pulled_cable_is_noticed_while_the_beam_settles(setup: Any) -> None:
    restless(setup)

    def pull(number: int) -> None:
        if setup.coil.state.set_current_A == 0.1:
            setup.line.inject(Fault.SILENCE)

    setup.camera.event = pull
    with pytest.raises(InstrumentError) as caught:
        setup.run()
    assert isinstance(caught.value.__context__, InstrumentTimeout)
    assert setup.bench.clock.now() < BEGAN_S + 100


@pytest.mark.parametrize(("driver", "words"), [("korad", STAYS), ("scpi", STAYS), ("keysight-n6700", WATCHDOG)])
def test_the_dry_run_says_what_a_pulled_cable_does(setup: Any, driver: str, words: str) -> None:
    supply = setup.rig.supply.model_copy(update={"driver": driver})
    messages: list[str] = []
    dry_run(setup.protocol, setup.specimen, setup.rig.model_copy(update={"supply": supply}), messages.append)
    assert protection_in_words(words) in messages


def test_the_dataset_says_what_a_pulled_cable_would_have_done(setup: Any) -> None:
    setup.bench = replace(setup.bench, truth=None)
    setup.run()
    with h5py.File(setup.path) as file:
        assert file["entry/instrument/supply/without_contact"][()].decode() == STAYS


def test_ctrl_z_is_refused_with_a_message_and_the_run_continues(setup: Any, capsys: pytest.CaptureFixture[str]) -> None:
    before = signal.getsignal(signal.SIGTSTP)
    setup.camera.event = lambda number: signal.raise_signal(signal.SIGTSTP) if number == 30 else None
    setup.run()
    assert setup.stored() == [0.0, 0.1, 0.2, 0.3]
    assert "Ctrl-Z is refused" in capsys.readouterr().err
    assert signal.getsignal(signal.SIGTSTP) is before


def test_a_second_ctrl_c_leaves_out_the_ramp(setup: Any) -> None:
    text = setup.protocol.text.replace("rate_A_per_s = 10.0\nstep_A = 0.1", "rate_A_per_s = 0.1\nstep_A = 0.01")
    setup.protocol = parse(Protocol, text, "slow")
    currents: dict[int, list[float]] = {}
    for signals in (1, 2):
        currents[signals] = []

        def ask(number: int, count: int = signals) -> None:
            if setup.coil.state.set_current_A == 0.2:
                for _ in range(count):
                    signal.raise_signal(signal.SIGINT)
                take = type(setup.coil).set_current

                def watch(current_A: float) -> bool:
                    currents[count].append(current_A)
                    return take(setup.coil, current_A)

                setup.coil.set_current = watch

        setup.camera.event = ask
        with pytest.raises(Stopped):
            setup.run(force=True)
        assert setup.is_off()
    assert len(currents[1]) > 5
    assert set(currents[2]) == {0.0}


def test_two_signals_while_a_state_is_stored_switch_off_first(setup: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    still_on: list[bool] = []

    def slow(column: h5py.Dataset, rows: Any) -> None:
        append(column, rows)
        if still_on:
            still_on.append(setup.coil.state.output)

    def slow_image(frames: h5py.Dataset, image: Any) -> None:
        append_image(frames, image)
        if still_on:
            still_on.append(setup.coil.state.output)
        elif setup.coil.state.set_current_A == 0.2:
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGTERM)
            still_on.append(True)

    monkeypatch.setattr(writing, "append", slow)
    monkeypatch.setattr(writing, "append_image", slow_image)
    with pytest.raises(Stopped):
        setup.run()
    assert still_on[0]
    assert len(still_on) > 10
    assert not any(still_on[1:])
    assert setup.is_off()
    assert setup.stored() == [0.0, 0.1, 0.2]


def stopped_twice() -> None:
    try:
        raise Stopped(signal.SIGHUP, "the coil is off; 1 of 4 states are in run.h5")
    finally:
        raise Stopped(signal.SIGHUP)


def test_a_second_signal_during_the_end_does_not_replace_the_message_of_the_first() -> None:
    with pytest.raises(Stopped) as caught:
        stopped_twice()
    assert caught.value.in_words() == "stopped by SIGHUP: the coil is off; 1 of 4 states are in run.h5"
    assert Stopped(signal.SIGINT).in_words() == "stopped by SIGINT"

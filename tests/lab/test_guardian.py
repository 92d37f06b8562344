"""The guardian, a separate process, switches the coil off when a run dies, and does nothing else."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import pytest

from eimi_drivers.clock import WallClock
from eimi_drivers.emulators.faults import Fault, FaultyInstrument
from eimi_drivers.emulators.serve import emulate, serve_pty, serve_tcp
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.interfaces import Identity, InstrumentError, Limits, SwitchOffFailed
from eimi_drivers.supplies.supply_names import open_supply
from eimi_lab.acquisition import guardian as guardian_module
from eimi_lab.acquisition.coil import Coil
from eimi_lab.acquisition.event_words import on_terminal
from eimi_lab.acquisition.events import Event, OffConfirmed, OffNotConfirmed
from eimi_lab.acquisition.guardian import STILL_FOR_S, Guardian, StoodStill, Ward, guarding
from eimi_lab.acquisition.guardian_process import _try_once
from eimi_lab.acquisition.switching_off import ramp_down_and_switch_off, switching_off
from eimi_lab.config.protocol import load_protocol
from tests.patience import PATIENCE_S


class Bench:
    # A coil with a current, and its emulated supply: a Korad on a pseudo-terminal, or another one over TCP.

    def __init__(self, driver: str) -> None:
        self.coil = CoilSupply(WallClock())
        self.dialect: Any = emulate(driver, self.coil)
        self.line = FaultyInstrument(self.dialect)
        self.heard: list[bytes] = []
        self.driver = driver
        self.current_A: list[float] = []

    def receive(self, data: bytes) -> bytes:
        self.heard.append(data)
        answer = self.line.receive(data)
        self.current_A.append(self.coil.state.set_current_A)
        return answer

    @contextmanager
    def ward(self) -> Iterator[Ward]:
        with serve_pty(self) if self.driver == "korad" else serve_tcp(self) as address:
            self.coil.set_voltage(10.0)
            self.coil.set_current(0.5)
            self.coil.switch(True)
            WallClock().sleep(0.3)
            yield Ward(self.driver, address, 1.0, 10.0)

    def is_off(self) -> bool:
        return not self.coil.state.output and self.coil.state.set_current_A == 0.0


def wait_for(guardian: Guardian) -> int:
    return guardian._process.wait(PATIENCE_S)


@pytest.mark.parametrize("driver", ["korad", pytest.param("scpi", marks=pytest.mark.slow)])
def test_the_end_of_the_run_switches_off_and_no_other_set_point_than_zero_is_sent(driver: str) -> None:
    bench = Bench(driver)
    with bench.ward() as ward:
        with guarding(ward) as guardian:
            guardian.arm()
            assert bench.heard == []  # while the run lives, only the run may use the port
        assert wait_for(guardian) == 0
    assert bench.is_off()
    assert set(bench.current_A) <= {0.5, 0.0}


def test_a_current_above_its_set_point_does_not_lead_to_a_higher_set_point() -> None:
    bench = Bench("korad")
    with bench.ward() as ward:
        bench.coil.drift(to_A=1.8, rate_A_per_s=100.0)
        with guarding(ward) as guardian:
            guardian.arm()
        assert wait_for(guardian) == 0
    assert bench.is_off()
    assert max(bench.current_A) <= 0.5


def test_a_run_that_switched_off_itself_is_left_alone() -> None:
    bench = Bench("korad")
    with bench.ward() as ward:
        with guarding(ward) as guardian:
            guardian.arm()
            guardian.disarm()
        assert wait_for(guardian) <= 0
        assert bench.heard == []


def test_signals_do_not_end_the_guardian() -> None:
    bench = Bench("korad")
    with bench.ward() as ward:
        with guarding(ward) as guardian:
            guardian.arm()
            for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM):
                os.kill(guardian._process.pid, number)
            assert os.getsid(guardian._process.pid) != os.getsid(
                0
            )  # signals of the terminal do not reach the guardian, which has its own session
            WallClock().sleep(0.2)
            guardian.check()
        assert wait_for(guardian) == 0
    assert bench.is_off()


def test_a_busy_port_is_tried_again() -> None:
    bench = Bench("korad")
    with bench.ward() as ward:
        busy = open_supply(ward.driver, ward.address, Limits(ward.current_A, ward.voltage_V))
        with guarding(ward) as guardian:
            guardian.arm()
        WallClock().sleep(0.5)
        assert bench.coil.state.output
        busy.close()
        assert wait_for(guardian) == 0
    assert bench.is_off()


def test_a_supply_that_answers_again_is_switched_off() -> None:
    bench = Bench("korad")
    bench.line.inject(Fault.SILENCE)
    with bench.ward() as ward:
        with guarding(ward) as guardian:
            guardian.arm()
        WallClock().sleep(1.0)
        assert bench.coil.state.output
        bench.line.inject(None)
        assert wait_for(guardian) == 0
    assert bench.is_off()


def test_the_guardian_does_not_wait_for_a_pseudo_terminal_that_no_longer_exists(
    capfd: pytest.CaptureFixture[str],
) -> None:
    # The next emulator gets the same name, and a guardian of an earlier run must not use its port.
    bench = Bench("korad")
    with bench.ward() as ward:
        guardian = Guardian(ward)
        guardian.arm()
        # While the test keeps this pseudo-terminal open, no other emulator can get the same name.
        held = os.open(ward.address, os.O_RDWR | os.O_NOCTTY)
    guardian.dismiss()
    assert wait_for(guardian) == 0
    os.close(held)
    assert f"the emulated supply at {ward.address} does not exist any more" in capfd.readouterr().err


def test_a_run_whose_guardian_has_ended_raises_an_error() -> None:
    bench = Bench("korad")
    with bench.ward() as ward, guarding(ward) as guardian:
        guardian.arm()
        guardian.check()
        os.kill(guardian._process.pid, signal.SIGKILL)
        wait_for(guardian)
        with pytest.raises(
            InstrumentError, match="guardian process, which switches the coil off if the run dies, ended"
        ):
            guardian.check()


def test_the_guardian_takes_over_a_run_that_stands_still_and_reports_it(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(guardian_module, "LONGEST_GAP_S", PATIENCE_S)
    bench = Bench("korad")
    with bench.ward() as ward, guarding(ward) as guardian:
        busy = open_supply(ward.driver, ward.address, Limits(ward.current_A, ward.voltage_V))
        guardian.arm()
        for _ in range(60):  # longer than the permitted standstill, but in shorter steps
            guardian.beat()
            guardian.check()
            WallClock().sleep(0.1)
        assert bench.heard == []
        os.kill(guardian._process.pid, signal.SIGSTOP)  # now run and guardian stand still, and the port is locked
        time.sleep(STILL_FOR_S + 0.5)
        os.kill(guardian._process.pid, signal.SIGCONT)
        assert wait_for(guardian) == 0
        assert bench.is_off()
        assert set(bench.current_A) <= {0.5, 0.0}
        with pytest.raises(InstrumentError, match="stood still for more than 5 s"):
            guardian.check()
        busy.close()
        guardian.disarm()
    assert "the run stood still for more than 5 s; " in capfd.readouterr().err


def test_a_run_may_announce_that_it_takes_longer() -> None:
    bench = Bench("korad")
    with bench.ward() as ward, guarding(ward) as guardian:
        guardian.arm()
        guardian.allow(60.0)
        WallClock().sleep(6.5)
        guardian.check()
        guardian.disarm()
    assert bench.heard == []


def test_a_run_that_stood_still_together_with_its_guardian_sends_no_further_set_point(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    began_s, slept_s = time.monotonic(), [0.0]
    monkeypatch.setattr(guardian_module, "awake_s", lambda: began_s + slept_s[0])
    bench = Bench("korad")
    with bench.ward() as ward, guarding(ward) as guardian:
        guardian.refuse_a_gap()
        guardian.arm()
        guardian.beat()
        guardian.refuse_a_gap()
        slept_s[0] = 60.0
        with pytest.raises(InstrumentError, match="stood still for 60 s with the coil on"):
            guardian.refuse_a_gap()
        guardian.beat()
        with pytest.raises(InstrumentError, match="because the computer slept or the process was stopped"):
            guardian.check()
        guardian.disarm()
        guardian.check()
        slept_s[0] = 3600.0  # a pause of the run does not count as a standstill, however long it is
        guardian._heard_s -= 3600.0  # in a pause, the run does not listen to its guardian
        guardian.arm()
        assert guardian.silent_s() < 60.0
        guardian.refuse_a_gap()
        guardian.check()
        guardian.disarm()


def test_after_a_standstill_of_run_and_guardian_the_coil_is_switched_off_without_a_ramp(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(guardian_module, "LONGEST_GAP_S", 1.0)
    bench = Bench("korad")
    with bench.ward() as ward, guarding(ward) as guardian:
        supply = open_supply(ward.driver, ward.address, ward.limits)
        coil = Coil(supply, WallClock(), load_protocol("dragon_skin_10").ramp, asked_A=0.5)
        with pytest.raises(StoodStill):
            stand_still(coil, guardian, bench)
        supply.close()
    assert bench.is_off()
    assert set(bench.current_A) <= {0.5, 0.0}


def stand_still(coil: Coil, guardian: Guardian, bench: Bench) -> None:
    # Stop a run and its guardian process for 1.5 s, as a sleeping computer does.
    with switching_off(coil, guardian) as stop_if_asked:
        stop_if_asked()
        os.kill(guardian._process.pid, signal.SIGSTOP)
        time.sleep(1.5)
        os.kill(guardian._process.pid, signal.SIGCONT)
        bench.current_A.clear()
        stop_if_asked()


def check_for(guardian: Guardian, seconds: float) -> None:
    # Let a run check for some seconds whether its guardian process answers.
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        guardian.beat()
        guardian.check()
        time.sleep(0.2)


def test_a_stopped_guardian_is_noticed_and_still_switches_off_after_the_run() -> None:
    bench = Bench("korad")
    with bench.ward() as ward:
        with guarding(ward) as guardian:
            guardian.arm()
            os.kill(guardian._process.pid, signal.SIGSTOP)
            with pytest.raises(InstrumentError, match="does not answer"):
                check_for(guardian, PATIENCE_S)
        assert wait_for(guardian) == 0
    assert bench.is_off()


def test_a_dropped_line_does_not_end_the_guardian() -> None:
    bench = Bench("scpi")
    bench.line.inject(Fault.DROP)
    with bench.ward() as ward:
        with guarding(ward) as guardian:
            guardian.arm()
        assert wait_for(guardian) == 0
    assert bench.is_off()


def test_the_guardian_reports_the_outcome(capfd: pytest.CaptureFixture[str]) -> None:
    bench = Bench("korad")
    with bench.ward() as ward:
        with guarding(ward) as guardian:
            guardian.arm()  # a run that continues to its end and leaves the coil on
        wait_for(guardian)
    assert f"the run could not switch the coil off; {ward.address}: the coil was switched off" in capfd.readouterr().err


def test_a_run_killed_before_its_guardian_is_ready_leaves_no_message() -> None:
    ward = json.dumps({"driver": "korad", "address": "/dev/nowhere", "current_A": 1.0, "voltage_V": 10.0})
    command = [sys.executable, "-P", "-m", "eimi_lab.acquisition.guardian_process", ward]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as guardian:
        assert guardian.stdin is not None
        assert guardian.stdout is not None
        assert guardian.stderr is not None
        guardian.stdout.close()  # long before the guardian has imported its modules
        guardian.stdin.close()
        assert guardian.stderr.read() == b""
        assert guardian.wait(PATIENCE_S) == 0


def test_a_supply_without_a_serial_number_is_recognised_by_the_current_that_it_does_not_stop() -> None:
    bench = Bench("scpi")
    with bench.ward() as ward:
        ward = replace(ward, identity=("EIMI,EMULATED SUPPLY,0,1.0", ""))
        bench.coil.switch(False)
        with pytest.raises(SwitchOffFailed, match="has no serial number"):
            _try_once(ward, set())
        bench.coil.shorted_A = 0.8
        was_on: set[bool] = set()
        with pytest.raises(SwitchOffFailed, match=r"0\.800 A measured"):
            _try_once(ward, was_on)
        bench.coil.shorted_A = 0.0
        off, _ = _try_once(ward, was_on)
        assert off is not None
        assert not off.found_off


def test_a_supply_that_the_run_switched_off_while_a_current_flowed_may_be_found_off(
    capfd: pytest.CaptureFixture[str],
) -> None:
    bench = Bench("scpi")
    with bench.ward() as ward:
        with guarding(ward) as guardian:
            guardian.arm()
            guardian.expect(Identity("scpi", "EIMI,EMULATED SUPPLY,0,1.0", ward.address))
            bench.coil.switch(False)
            guardian.recognise()
        assert wait_for(guardian) == 0
    assert "the coil was switched off, the measured current is below 0.02 A" in capfd.readouterr().err


IDENTIFIED = ("EIMI,EMULATED SUPPLY,7,1.0", "7")


def test_a_supply_without_its_identity_is_switched_off_but_not_reported_as_off() -> None:
    bench = Bench("scpi")
    bench.dialect.identification = IDENTIFIED[0]
    with bench.ward() as ward:
        ward = replace(ward, identity=IDENTIFIED)
        bench.line.inject(Fault.SILENCE, lambda message: b"*IDN?" in message)
        with pytest.raises(SwitchOffFailed, match=r"A measured, but it did not answer with its identity"):
            _try_once(ward, set())
        assert bench.is_off()
        bench.line.inject(None)
        off, _ = _try_once(ward, set())
        assert off is not None
        assert off.found_off


def test_another_supply_on_a_line_that_was_reopened_while_switching_off_is_not_reported_as_off() -> None:
    bench = Bench("scpi")
    bench.dialect.identification = IDENTIFIED[0]
    with bench.ward() as ward:
        ward = replace(ward, identity=IDENTIFIED)
        other = emulate("scpi", CoilSupply(WallClock()))
        bench.line.swap(other, lambda message: b"CURR 0" in message)
        with pytest.raises(InstrumentError, match=r"another supply answers|supply is not there"):
            _try_once(ward, set())
        assert bench.coil.state.output


def test_a_coil_that_cannot_be_reached_is_reported_before_the_attempts_have_ended() -> None:
    bench = Bench("korad")
    events: list[Event] = []
    with bench.ward() as ward:
        supply = open_supply(ward.driver, ward.address, ward.limits)
        coil = Coil(supply, WallClock(), load_protocol("dragon_skin_10").ramp, asked_A=0.5)
        bench.line.inject(Fault.SILENCE)
        with pytest.raises(SwitchOffFailed):
            ramp_down_and_switch_off(coil, on_event=events.append)
        supply.close()
    first, last = events
    assert isinstance(first, OffNotConfirmed)
    assert isinstance(last, OffNotConfirmed)
    assert first.trying_process == os.getpid()
    assert last.trying_process is None
    assert last.time_s - first.time_s > 1.0  # the supply has 1 s for each answer


def test_the_report_that_the_coil_is_off_is_printed_after_the_report_of_the_doubt() -> None:
    printed: list[str] = []
    listen = on_terminal(printed.append, printed.append)
    off = OffConfirmed(by="run", determined_by="measured", current_A=0.0, limit_A=0.02)
    listen(off)
    assert printed == []
    listen(OffNotConfirmed(by="run", reason="no answer", trying_process=7))
    listen(off)
    assert printed == [
        "THE COIL MAY STILL BE ON, switch it off by hand; process 7 continues to try to switch the coil off: no answer",
        "the coil is off, the measured current is below 0.02 A",
    ]

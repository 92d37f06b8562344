"""`eimi instruments --try` tests a driver on a supply without a coil, switches the supply off and writes a report."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from eimi_drivers.clock import SimulatedClock, WallClock
from eimi_drivers.discovery import Discovery, Found
from eimi_drivers.emulators import CoilSupply, emulate, serve_tcp
from eimi_drivers.emulators.session import OPEN_OHM
from eimi_drivers.interfaces import Identity, Limits, SwitchOffFailed
from eimi_drivers.supplies import SUPPLIES
from eimi_drivers.supplies.transcript import ReplayedTransport
from eimi_drivers.supplies.transport import InProcessTransport
from eimi_lab.acquisition import supply_trial
from eimi_lab.acquisition.supply_trial import SupplyTrial, TrialStep, try_supply
from eimi_lab.acquisition.trial_form import FORM, trial_form
from eimi_lab.cli import app
from tests.patience import PATIENCE_S

PAGE = Path(__file__).parents[2] / "docs" / "instruments.md"
Serve = Callable[..., tuple[CoilSupply, str]]


@pytest.fixture
def serve() -> Iterator[Serve]:
    # Return a function that serves an emulated supply on TCP, and returns the supply and the address.
    # resistance_ohm: resistance at the output, by default an open circuit.
    with ExitStack() as stack:

        def served(driver: str, resistance_ohm: float = OPEN_OHM) -> tuple[CoilSupply, str]:
            coil = CoilSupply(WallClock(), resistance_ohm=resistance_ohm)
            address = stack.enter_context(serve_tcp(emulate(driver, coil)))
            return coil, address

        yield served


def run(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["instruments", *arguments])
    return result.exit_code, result.output


@pytest.fixture(autouse=True)
def briefly(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(supply_trial, "ON_FOR_S", 0.2)
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("driver", ["aim-tti", "keithley-2260b"])
def test_a_supply_without_a_coil_passes_and_is_off(serve: Serve, driver: str) -> None:
    coil, address = serve(driver)
    status, output = run("--try", driver, address, "--yes", "--who", "A. Person", "-o", "report.md")
    assert status == 0, output
    assert output.count("passed: ") == 9
    assert not coil.state.output
    report = Path("report.md").read_text()
    assert "| who | A. Person |" in report
    assert "| line | TCP socket |" in report
    assert "| passed | yes |" in report
    assert "127.0.0.1" not in report
    again = SUPPLIES[driver](ReplayedTransport(Path("report.wire.txt")), supply_trial.LIMITS, SimulatedClock())
    assert again.identify().text in report


def test_a_coil_at_the_output_is_noticed_and_switched_off(serve: Serve) -> None:
    coil, address = serve("aim-tti", resistance_ohm=4.0)
    status, output = run("--try", "aim-tti", address, "--yes", "-o", "report.md")
    assert status == 1
    assert "FAILED: it measures voltage and current: a current of 0.100 A flows; disconnect everything" in output
    assert "passed: it switches off: " in output
    assert not coil.state.output
    assert "| passed | NO |" in Path("report.md").read_text()


def test_a_supply_that_is_on_is_left_alone(serve: Serve) -> None:
    coil, address = serve("keithley-2200")
    coil.set_voltage(3.0)
    coil.switch(True)
    before = coil.state
    status, output = run("--try", "keithley-2200", address, "--yes", "-o", "report.md")
    assert status == 1
    assert "FAILED: its output is off: the output is on; switch it off at the front panel" in output
    assert coil.state == before


def test_a_driver_of_another_family_is_noticed_before_anything_is_set(serve: Serve) -> None:
    coil, address = serve("aim-tti")
    before = coil.state
    status, output = run("--try", "keithley-2200", address, "--yes", "-o", "report.md")
    assert status == 1
    assert "fits the driver aim-tti, not keithley-2200" in output
    assert coil.state == before


def test_the_only_recognised_supply_is_tried(serve: Serve, monkeypatch: pytest.MonkeyPatch) -> None:
    _, address = serve("owon-spe")
    attached = (Found("supply", "owon-spe", address, "a supply"), Found("supply", "korad or other", "COM1", "a port"))
    monkeypatch.setattr("eimi_drivers.discovery.discover", lambda: Discovery(attached, ()))
    status, output = run("--try", "--yes", "-o", "report.md")
    assert status == 0, output
    assert "driver | `owon-spe`" in Path("report.md").read_text()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("--try", "korad", "/dev/nowhere"),
            "--try asks questions, but there is no terminal; run",
        ),
        (("korad",), "are only for --try"),
        (("--yes",), "are only for --try"),
        (("--try", "korat", "/dev/nowhere", "--yes"), "no supply driver 'korat'"),
    ],
)
def test_a_trial_that_cannot_begin_is_refused_in_one_line(arguments: tuple[str, ...], message: str) -> None:
    command = [sys.executable, "-m", "eimi_lab", "instruments", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=PATIENCE_S)
    assert done.returncode in {1, 2}
    assert message in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not list(Path.cwd().iterdir())


def test_a_killed_trial_is_switched_off_by_its_guardian(serve: Serve) -> None:
    coil, address = serve("keithley-2260b")
    command = [sys.executable, "-m", "eimi_lab", "instruments", "--try", "keithley-2260b", address, "--yes"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    wait_until(lambda: coil.state.output)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    wait_until(lambda: not coil.state.output)


def wait_until(holds: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not holds():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_the_documentation_shows_the_form_with_empty_fields() -> None:
    empty = {field: "" for field in FORM_FIELDS}
    shown = PAGE.read_text(encoding="utf-8")
    for line in FORM.format(**empty | {"steps": "|  |  |  |"}).splitlines():
        assert line.strip() in shown, line


FORM_FIELDS = (
    *("unit", "serial_number", "firmware", "driver", "version", "line", "date", "who", "transcript", "panel"),
    *("passed", "steps"),
)


class Watcher:
    def __init__(self) -> None:
        self.told: list[Any] = []
        self.measured_s: list[float] = []

    def __getattr__(self, name: str) -> Callable[..., None]:
        return lambda *arguments: self.told.append((name, *arguments))


@pytest.fixture
def simulated(monkeypatch: pytest.MonkeyPatch) -> Callable[..., tuple[SupplyTrial, CoilSupply, Watcher]]:
    # Return a function that tries a driver on an emulated Korad in simulated time, with nothing at its output.
    def trial(**changes: Any) -> tuple[SupplyTrial, CoilSupply, Watcher]:
        clock, watcher = SimulatedClock(), Watcher()
        coil = CoilSupply(clock, resistance_ohm=OPEN_OHM)
        for name, value in changes.items():
            setattr(coil, name, value)

        @contextmanager
        def guarded(ward: Any) -> Iterator[Watcher]:
            watcher.told.append(("guards", ward.driver, ward.address, ward.limits))
            yield watcher

        def opened(driver: str, address: str, limits: Limits, on_clock: Any, transcript: Path) -> Any:
            assert on_clock is clock
            watcher.told.append(("opens", driver, address, limits, transcript.name))
            supply: Any = SUPPLIES[driver](InProcessTransport(emulate(driver, coil), clock, address), limits, clock)
            measure = supply.measure
            supply.measure = lambda: watcher.measured_s.append(clock.now()) or measure()
            return supply

        monkeypatch.setattr(supply_trial, "WallClock", lambda: clock)
        monkeypatch.setattr(supply_trial, "guarding", guarded)
        monkeypatch.setattr(
            supply_trial, "only_run_on", lambda address: nullcontext(watcher.told.append(("locks", address)))
        )
        monkeypatch.setattr(supply_trial, "open_supply", opened)
        monkeypatch.setattr(supply_trial, "ON_FOR_S", 4.0)
        found = try_supply("aim-tti", "COM3", Path("wire.txt"), lambda: watcher.told.append(("person",)))
        return found, coil, watcher

    return trial


def test_every_step_of_a_trial_has_its_outcome(
    simulated: Callable[..., tuple[SupplyTrial, CoilSupply, Watcher]],
) -> None:
    trial, coil, watcher = simulated()
    identity = trial.identity
    assert identity is not None
    assert [(step.check, step.passed, step.outcome) for step in trial.steps] == [
        ("it identifies itself", True, identity.text),
        ("its output is off", True, "off"),
        ("a current above the limit is refused", True, "the driver refused 1.01 A and sent nothing to the supply"),
        ("set-points are taken", True, "the supply reads back 1 V and 0.1 A"),
        (
            "the output switches on",
            True,
            "the supply reads back its protections and its watchdog; the output is on",
        ),
        (
            "it measures voltage and current",
            True,
            # one reading in 0.2 s, for 4 s
            "measured 1.000 V and 0.0000 A; a reading takes 0.000 s in the median and at most 0.000 s (20 readings)",
        ),
        ("errors and trips", True, "none"),
        ("it switches off", True, "0.0000 A measured; the output counts as off at 0.02 A or less"),
        (
            "its meter without a current",
            True,
            "mean of the measured currents 0.0000 A, largest current 0.0000 A (10 readings)",
        ),
    ]
    assert trial.passed
    assert not coil.state.output
    assert np.diff(watcher.measured_s[:20]) == pytest.approx([0.2] * 19)
    assert np.diff(watcher.measured_s[-10:]) == pytest.approx([0.1] * 9)
    assert watcher.told == [
        ("locks", "COM3"),
        ("guards", "aim-tti", "COM3", Limits(1.0, 5.0)),
        ("opens", "aim-tti", "COM3", Limits(1.0, 5.0), "wire.txt"),
        ("person",),
        ("expect", identity),
        ("arm",),
        *[("beat",)] * 20,
        ("disarm",),
    ]


@pytest.mark.parametrize(("answers_s", "readings"), [(0.25, 16), (1.0, 10)])
def test_a_supply_is_measured_for_4_s_and_at_least_ten_times(
    simulated: Callable[..., tuple[SupplyTrial, CoilSupply, Watcher]],
    monkeypatch: pytest.MonkeyPatch,
    answers_s: float,
    readings: int,
) -> None:
    def sleep(self: Any, seconds: float) -> None:
        self._now += answers_s if seconds == 0.2 else 0.0

    monkeypatch.setattr(SimulatedClock, "sleep", sleep)
    trial, _, watcher = simulated()
    assert len(watcher.measured_s) == readings + 1 + 10  # one when it switches off, ten without a current
    assert f"({readings} readings)" in trial.steps[5].outcome


@pytest.mark.parametrize(("recognised", "passed"), [(None, True), ("aim-tti", True), ("korad", False)])
def test_a_supply_of_an_unknown_family_is_tried_and_one_of_another_is_not(
    simulated: Callable[..., tuple[SupplyTrial, CoilSupply, Watcher]],
    monkeypatch: pytest.MonkeyPatch,
    recognised: str | None,
    passed: bool,
) -> None:
    found = None if recognised is None else SimpleNamespace(driver=recognised)
    monkeypatch.setattr(supply_trial, "recognise", lambda text: found)
    trial, _, _ = simulated()
    assert trial.passed is passed
    if not passed:
        assert trial.steps[0].outcome.endswith("to identify itself; this fits the driver korad, not aim-tti")


def test_a_supply_whose_driver_measures_nothing_at_the_end_is_measured_by_the_trial(
    simulated: Callable[..., tuple[SupplyTrial, CoilSupply, Watcher]], monkeypatch: pytest.MonkeyPatch
) -> None:
    safe_off = SUPPLIES["aim-tti"].safe_off
    monkeypatch.setattr(SUPPLIES["aim-tti"], "safe_off", lambda self: safe_off(self) and None)
    trial, coil, _ = simulated()
    assert trial.passed
    assert trial.steps[-2].outcome == "0.0000 A measured; the output counts as off at 0.02 A or less"
    assert not coil.state.output


def test_a_driver_that_refuses_no_current_is_noticed_before_the_output_is_on(
    simulated: Callable[..., tuple[SupplyTrial, CoilSupply, Watcher]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(SUPPLIES["aim-tti"], "_refuse_outside", lambda *_: None)
    trial, coil, watcher = simulated()
    assert [step.passed for step in trial.steps] == [True, True, False]
    assert trial.steps[-1].outcome == "the limit is 1 A, but the driver did not refuse 1.01 A"
    assert not coil.state.output
    assert ("arm",) not in watcher.told


def test_a_meter_may_show_up_to_the_off_limit(
    simulated: Callable[..., tuple[SupplyTrial, CoilSupply, Watcher]],
) -> None:
    trial, coil, _ = simulated(offset_A=-0.015)
    assert (trial.passed, coil.state.output) == (True, False)
    assert trial.steps[-1].outcome == "mean of the measured currents -0.0150 A, largest current -0.0150 A (10 readings)"
    for offset_A in (0.03, -0.03):  # the meter of a supply whose output is off shows no such current
        with pytest.raises(SwitchOffFailed, match=f"{abs(offset_A):.2f}"):
            simulated(offset_A=offset_A)


@pytest.mark.parametrize(("voltage_V", "passed"), [(0.91, True), (1.09, True), (0.89, False), (1.11, False)])
def test_the_measured_voltage_may_differ_by_a_tenth_of_a_volt(
    simulated: Callable[..., tuple[SupplyTrial, CoilSupply, Watcher]],
    monkeypatch: pytest.MonkeyPatch,
    voltage_V: float,
    passed: bool,
) -> None:
    measure = SUPPLIES["aim-tti"].measure
    monkeypatch.setattr(
        SUPPLIES["aim-tti"],
        "measure",
        lambda self: replace(measure(self), voltage_V=voltage_V * measure(self).voltage_V),
    )
    trial, coil, watcher = simulated()
    assert trial.passed is passed
    assert not coil.state.output
    assert watcher.told[-1] == ("disarm",)
    if not passed:
        outcomes = {step.check: step.outcome for step in trial.steps if not step.passed}
        assert outcomes == {"it measures voltage and current": f"{voltage_V:.3f} V measured, but 1 V was set"}
        assert trial.steps[-1].check == "it switches off"


@pytest.mark.parametrize(
    ("address", "line"),
    [
        ("/dev/ttyACM0", "serial line"),
        ("COM3", "serial line"),
        ("TCPIP::192.0.2.7::5025::SOCKET", "TCP socket"),
        ("tcpip::192.0.2.7::hislip0::instr", "HiSLIP"),
        ("TCPIP::192.0.2.7::INSTR", "VXI-11"),
        ("GPIB0::5::INSTR", "GPIB"),
        ("USB0::1::2::3::INSTR", "USB (VISA)"),
    ],
)
def test_the_form_states_the_kind_of_the_line_and_not_the_address(address: str, line: str) -> None:
    form = trial_form(SupplyTrial("korad", address), "", "", Path("wire.txt"))
    assert f"| line | {line} |" in form
    assert address not in form


def test_the_form_is_filled_from_the_identity_and_the_steps() -> None:
    identity = Identity("korad", "Maker, Model | 3, 0123 , 1.2, beta", "COM3", "SN 7")
    steps = [TrialStep("first", True, "1 | 2"), TrialStep("second", False, "no\nanswer")]
    trial = SupplyTrial("korad", "COM3", identity, steps)
    form = trial_form(trial, "A | B", "1.00 V\n0 A", Path("some") / "wire.txt")
    today = datetime.now(UTC).date().isoformat()
    assert form.splitlines() == [
        "# Tried on: Maker Model / 3",
        "",
        "| | |",
        "| --- | --- |",
        "| unit | Maker Model / 3 |",
        "| serial number | SN 7 |",
        "| firmware | 1.2, beta |",
        f"| driver | `korad` of eimi-lab {version('eimi-lab')} |",
        "| line | serial line |",
        f"| date | {today} |",
        "| who | A / B |",
        "| transcript | `wire.txt` |",
        "| front panel | 1.00 V 0 A |",
        "| passed | NO |",
        "",
        "| step | passed | outcome |",
        "| --- | --- | --- |",
        "| first | yes | 1 / 2 |",
        "| second | NO | no answer |",
    ]
    nameless = trial_form(replace(trial, identity=None, steps=steps[:1]), "", "", Path("wire.txt"))
    assert nameless.startswith("# Tried on: unknown\n")
    assert "| serial number |  |\n| firmware |  |" in nameless
    assert "| passed | yes |" in nameless

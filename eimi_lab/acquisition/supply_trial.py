"""Try the driver of a supply on a real supply without a coil, step by step, and record every message."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from eimi_drivers.clock import WallClock
from eimi_drivers.interfaces import Clock, Identity, InstrumentError, Limits, PowerSupply, Reading, SetPointRefused
from eimi_drivers.supplies.off import off_limit_A, switch_off
from eimi_drivers.supplies.recognised import recognise
from eimi_drivers.supplies.supply_names import open_supply
from eimi_lab.acquisition.guardian import Guardian, Ward, guarding
from eimi_lab.acquisition.supply_lock import only_run_on

LIMITS = Limits(current_A=1.0, voltage_V=5.0)
VOLTAGE_V, CURRENT_A = 1.0, 0.1
ON_FOR_S = 4.0
"""Shortest time (s) for which the output is on. A person needs this time to read the front panel."""

VOLTAGE_WITHIN_V = 0.1
READINGS = 10


@dataclass(frozen=True)
class TrialStep:
    """The outcome of one step in the trial of a supply.

    Parameters
    ----------
    check : str
        The property of the supply that the step checked.
    passed : bool
        Whether the step passed; the trial ends after a step that failed.
    outcome : str
        The measured values or the answer of the supply, in words, or the error message.
    """

    check: str
    passed: bool
    outcome: str


@dataclass
class SupplyTrial:
    """The outcomes of all steps in the trial of a supply.

    Parameters
    ----------
    driver, address : str
        The driver and the address of the supply.
    identity : Identity or None
        Identity of the supply; None if the supply did not identify itself.
    steps : list of TrialStep
        The steps in their order.
    """

    driver: str
    address: str
    identity: Identity | None = None
    steps: list[TrialStep] = field(default_factory=list)

    @property
    def passed(self) -> bool:
        """Whether all steps of the trial passed."""
        return all(step.passed for step in self.steps)


class _Failed(Exception):
    """The error that is raised if a step in the trial of a supply fails."""


def try_supply(
    driver: str, address: str, transcript: Path, before_switching_on: Callable[[], None] = lambda: None
) -> SupplyTrial:
    """Try a driver on a supply with nothing connected to its output, which is on at 1 V for some seconds.

    If this process ends while the output is on, a second process switches the output off.

    Parameters
    ----------
    driver, address : str
        The driver and the address, as in `[supply]` of a rig file.
    transcript : Path
        New file for every message to and from the supply.
    before_switching_on : callable
        Called before the output is switched on.

    Returns
    -------
    SupplyTrial
        The outcome of every step.

    Raises
    ------
    InstrumentError
        If the driver is unknown, the address cannot be opened, or another run uses the supply.
    SwitchOffFailed
        If the supply could not be confirmed off.
    """
    clock = WallClock()
    trial = SupplyTrial(driver, address)
    ward = Ward(driver, address, LIMITS.current_A, LIMITS.voltage_V)
    with (
        only_run_on(address),
        guarding(ward) as guardian,
        closing(open_supply(driver, address, LIMITS, clock, transcript)) as supply,
    ):
        try:
            _begin(trial, supply)
            before_switching_on()
            guardian.expect(_identified(trial))
            guardian.arm()
            with _switched_off_after(trial, supply, guardian, clock):
                _use(trial, supply, guardian, clock)
            _measure_zero(trial, supply, clock)
        except _Failed:
            pass
    return trial


def _step(trial: SupplyTrial, check: str, act: Callable[[], str]) -> None:
    try:
        trial.steps.append(TrialStep(check, True, act()))
    except InstrumentError as error:
        trial.steps.append(TrialStep(check, False, " ".join(str(error).split())))
        raise _Failed from error


def _identified(trial: SupplyTrial) -> Identity:
    assert trial.identity is not None
    return trial.identity


def _begin(trial: SupplyTrial, supply: PowerSupply) -> None:
    """Carry out the steps of the trial with the output off. Raises _Failed if a step fails."""

    def identifies() -> str:
        trial.identity = supply.identify()
        text = trial.identity.text
        recognised = recognise(text)
        if recognised is not None and recognised.driver != trial.driver and trial.driver != "scpi":
            raise InstrumentError(
                f"the supply answers {text!r} to identify itself; this fits the driver {recognised.driver}, not "
                f"{trial.driver}"
            )
        return text

    def is_off() -> str:
        if supply.output_on():
            raise InstrumentError("the output is on; switch it off at the front panel, and begin the trial again")
        return "off"

    def refuses() -> str:
        try:
            supply.set_current(1.01 * LIMITS.current_A)
        except SetPointRefused:
            return f"the driver refused {1.01 * LIMITS.current_A:g} A and sent nothing to the supply"
        raise InstrumentError(
            f"the limit is {LIMITS.current_A:g} A, but the driver did not refuse {1.01 * LIMITS.current_A:g} A"
        )

    _step(trial, "it identifies itself", identifies)
    _step(trial, "its output is off", is_off)
    _step(trial, "a current above the limit is refused", refuses)


def _use(trial: SupplyTrial, supply: PowerSupply, guardian: Guardian, clock: Clock) -> None:
    """Carry out the steps of the trial with the output on. Raises _Failed if a step fails."""

    def set_points() -> str:
        supply.set_voltage(VOLTAGE_V)
        supply.set_current(CURRENT_A)
        return f"the supply reads back {VOLTAGE_V:g} V and {CURRENT_A:g} A"

    def switches_on() -> str:
        supply.set_output(True)
        return "the supply reads back its protections and its watchdog; the output is on"

    def measures() -> str:
        readings: list[Reading] = []
        answers_s: list[float] = []
        until_s = clock.now() + ON_FOR_S
        while clock.now() < until_s or len(readings) < READINGS:
            began_s = clock.now()
            readings.append(supply.measure())
            answers_s.append(clock.now() - began_s)
            guardian.beat()
            clock.sleep(0.2)
        current_A, voltage_V = readings[-1].current_A, readings[-1].voltage_V
        if abs(current_A) > off_limit_A(supply):
            raise InstrumentError(
                f"a current of {current_A:.3f} A flows; disconnect everything from the output, and begin the trial "
                "again"
            )
        if abs(voltage_V - VOLTAGE_V) > VOLTAGE_WITHIN_V:
            raise InstrumentError(f"{voltage_V:.3f} V measured, but {VOLTAGE_V:g} V was set")
        return (
            f"measured {voltage_V:.3f} V and {current_A:.4f} A; a reading takes {statistics.median(answers_s):.3f} s "
            f"in the median and at most {max(answers_s):.3f} s ({len(readings)} readings)"
        )

    def reports_nothing() -> str:
        supply.check()
        return "none"

    _step(trial, "set-points are taken", set_points)
    _step(trial, "the output switches on", switches_on)
    _step(trial, "it measures voltage and current", measures)
    _step(trial, "errors and trips", reports_nothing)


@contextmanager
def _switched_off_after(trial: SupplyTrial, supply: PowerSupply, guardian: Guardian, clock: Clock) -> Iterator[None]:
    """Switch the supply off after the body of a with statement, also after an error. Raises SwitchOffFailed."""
    try:
        yield
    finally:
        off = switch_off(supply, clock)
        guardian.disarm()
        measured = (
            f"{off.current_A:.4f} A measured; the output counts as off at {off.limit_A:g} A or less"
            if off
            else "not measured"
        )
        trial.steps.append(TrialStep("it switches off", True, measured))


def _measure_zero(trial: SupplyTrial, supply: PowerSupply, clock: Clock) -> None:
    """Read the current that the supply measures while no current flows. Raises _Failed if the step fails."""

    def shows() -> str:
        readings_A = []
        for _ in range(READINGS):
            readings_A.append(supply.measure().current_A)
            clock.sleep(0.1)
        largest_A = max(readings_A, key=abs)
        return (
            f"mean of the measured currents {statistics.fmean(readings_A):.4f} A, largest current {largest_A:.4f} A "
            f"({READINGS} readings)"
        )

    _step(trial, "its meter without a current", shows)

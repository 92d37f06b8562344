"""Guide a person through the trial of a supply's driver on a real unit: `eimi instruments --try`."""

from __future__ import annotations

import sys
from datetime import UTC, datetime
from pathlib import Path

import typer

from eimi_lab.commands.result import Result
from eimi_lab.process.errors import InputError


def try_one_supply(driver: str | None, address: str | None, who: str | None, output: Path | None, yes: bool) -> Result:
    """Try one supply, and write the report and the transcript beside it.

    Parameters
    ----------
    driver, address : str or None
        The supply; if None, the only supply that is attached and recognised.
    who : str or None
        Name of the person, for the report; if None, the program asks.
    output : Path or None
        The file of the report; if None, its name consists of the driver and the date.
    yes : bool
        If true, ask no questions.

    Returns
    -------
    Result
        The steps and the files.

    Raises
    ------
    InputError
        No supply is given and not exactly one is recognised; questions are needed but there is no terminal; or a file
        exists.
    """
    from eimi_lab.acquisition.supply_trial import ON_FOR_S, VOLTAGE_V, try_supply
    from eimi_lab.acquisition.trial_form import trial_form
    from eimi_lab.process.outputs import refuse_existing, write_file

    if not yes and not sys.stdin.isatty():
        raise InputError(
            "--try asks questions; run it in a terminal, or add --yes if nothing is connected to the output"
        )
    if driver is None or address is None:
        driver, address = _only_supply()
    report = output or Path(f"tried_on_{driver}_{datetime.now(UTC):%Y%m%d_%H%M%S}.md")
    transcript = report.with_suffix(".wire.txt")
    refuse_existing(report, force=False)
    refuse_existing(transcript, force=False)
    if not yes:
        typer.echo(f"The driver {driver} will be tried on the supply at {address}.")
        typer.confirm("Is everything disconnected from its output?", abort=True)
        who = who if who is not None else typer.prompt("Who are you (name, laboratory)", default="")

    def before_switching_on() -> None:
        if not yes:
            typer.prompt(
                f"The output will be on at {VOLTAGE_V:g} V for {ON_FOR_S:g} s. Watch the front panel. Enter begins",
                default="",
                show_default=False,
            )

    trial = try_supply(driver, address, transcript, before_switching_on)
    panel = (
        "not asked" if yes else typer.prompt("What did the front panel show (on, voltage, current, off)", default="")
    )
    write_file(report, trial_form(trial, who or "", panel, transcript), force=False)
    lines = [f"{'passed' if step.passed else 'FAILED'}: {step.check}: {step.outcome}" for step in trial.steps]
    lines.append(f"{report} and {transcript}: send both with your result; the transcript contains the serial number")
    if not trial.passed:
        typer.echo("\n".join(lines))
        raise typer.Exit(1)
    return Result(lines, {"passed": trial.passed, "report": report, "transcript": transcript})


def _only_supply() -> tuple[str, str]:
    """Return driver and address of the only attached supply that has a driver. Raises InputError."""
    from eimi_drivers.discovery import discover
    from eimi_drivers.supplies.supply_names import SUPPLIES

    supplies = [each for each in discover().found if each.kind == "supply" and each.driver in SUPPLIES]
    if len(supplies) != 1:
        listed = "; ".join(f"{each.driver} at {each.address}" for each in supplies) or "none"
        raise InputError(
            f"--try: name driver and address, as in `eimi instruments --try korad /dev/ttyUSB0` (recognised: {listed})"
        )
    return supplies[0].driver, supplies[0].address

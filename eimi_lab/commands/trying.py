"""Test the driver of a supply on a real supply, with questions to the user: `eimi instruments --try`."""

from __future__ import annotations

import sys
from datetime import UTC, datetime
from pathlib import Path

import typer

from eimi_lab.commands.result import Result
from eimi_lab.process.errors import InputError


def try_one_supply(driver: str | None, address: str | None, who: str | None, output: Path | None, yes: bool) -> Result:
    """Test the driver of one supply, and write a report and a transcript of all messages.

    Parameters
    ----------
    driver, address : str or None
        Driver and address of the supply; None for the only attached supply.
    who : str or None
        Name of the user, for the report; if None, the program asks.
    output : Path or None
        File for the report; None for a name with the driver and the date.
    yes : bool
        If True, ask no questions.

    Returns
    -------
    Result
        The outcome of each step of the test, and the paths of the report and the transcript.

    Raises
    ------
    InputError
        If it is not clear which supply to test, if there is no terminal for the questions, or if a file exists already.
    """
    from eimi_lab.acquisition.supply_trial import ON_FOR_S, VOLTAGE_V, try_supply
    from eimi_lab.acquisition.trial_form import trial_form
    from eimi_lab.process.outputs import refuse_existing, write_file

    if not yes and not sys.stdin.isatty():
        raise InputError(
            "--try asks questions, but there is no terminal; run the command in a terminal, or add --yes if nothing is "
            "connected to the output of the supply"
        )
    if driver is None or address is None:
        driver, address = _only_supply()
    report = output or Path(f"tried_on_{driver}_{datetime.now(UTC):%Y%m%d_%H%M%S}.md")
    transcript = report.with_suffix(".wire.txt")
    refuse_existing(report, force=False)
    refuse_existing(transcript, force=False)
    if not yes:
        typer.echo(f"The driver {driver} will be tested on the supply at {address}.")
        typer.confirm("Is everything disconnected from the output of this supply?", abort=True)
        who = who if who is not None else typer.prompt("Who are you (name, laboratory)", default="")

    def before_switching_on() -> None:
        if not yes:
            typer.prompt(
                f"The output will be on at {VOLTAGE_V:g} V for {ON_FOR_S:g} s. Watch the front panel. Press Enter to "
                "begin",
                default="",
                show_default=False,
            )

    trial = try_supply(driver, address, transcript, before_switching_on)
    panel = (
        "not asked"
        if yes
        else typer.prompt("What did the front panel show (output on, voltage, current, output off)", default="")
    )
    write_file(report, trial_form(trial, who or "", panel, transcript), force=False)
    lines = [f"{'passed' if step.passed else 'FAILED'}: {step.check}: {step.outcome}" for step in trial.steps]
    lines.append(
        f"{report} and {transcript}: send both files to the project; the transcript contains the serial number"
    )
    if not trial.passed:
        typer.echo("\n".join(lines))
        raise typer.Exit(1)
    return Result(lines, {"passed": trial.passed, "report": report, "transcript": transcript})


def _only_supply() -> tuple[str, str]:
    """Return driver and address of the only attached supply. Raises InputError if there are none or several."""
    from eimi_drivers.discovery import discover
    from eimi_drivers.supplies.supply_names import SUPPLIES

    supplies = [each for each in discover().found if each.kind == "supply" and each.driver in SUPPLIES]
    if len(supplies) != 1:
        listed = "; ".join(f"{each.driver} at {each.address}" for each in supplies) or "none"
        raise InputError(
            f"--try: give driver and address, as in `eimi instruments --try korad /dev/ttyUSB0` (attached supplies: "
            f"{listed})"
        )
    return supplies[0].driver, supplies[0].address

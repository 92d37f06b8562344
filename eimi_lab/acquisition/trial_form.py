"""Fill in the form of docs/instruments.md that reports the trial of a supply driver on a real supply."""

from __future__ import annotations

from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from eimi_lab.acquisition.supply_trial import SupplyTrial

FORM = """# Tried on: {unit}

| | |
| --- | --- |
| unit | {unit} |
| serial number | {serial_number} |
| firmware | {firmware} |
| driver | `{driver}` of eimi-lab {version} |
| line | {line} |
| date | {date} |
| who | {who} |
| transcript | `{transcript}` |
| front panel | {panel} |
| passed | {passed} |

| step | passed | outcome |
| --- | --- | --- |
{steps}
"""
"""The form for the trial of a supply in Markdown. docs/instruments.md shows the form with empty fields."""


def trial_form(trial: SupplyTrial, who: str, panel: str, transcript: Path) -> str:
    """Return the filled form for the trial of a supply, in Markdown.

    Parameters
    ----------
    trial : SupplyTrial
        The outcome of every step.
    who : str
        The person and the laboratory.
    panel : str
        What the front panel showed, in words.
    transcript : Path
        The file with the messages to and from the supply.

    Returns
    -------
    str
        The form.
    """
    text = trial.identity.text if trial.identity else ""
    maker, model, _, firmware = ([part.strip() for part in text.split(",", 3)] + [""] * 4)[:4]
    steps = [f"| {step.check} | {'yes' if step.passed else 'NO'} | {_cell(step.outcome)} |" for step in trial.steps]
    return FORM.format(
        unit=_cell(f"{maker} {model}".strip() or "unknown"),
        serial_number=_cell(trial.identity.serial_number if trial.identity else ""),
        firmware=_cell(firmware),
        driver=trial.driver,
        version=version("eimi-lab"),
        line=_cell(_kind_of_line(trial.address)),
        date=datetime.now(UTC).date().isoformat(),
        who=_cell(who),
        transcript=transcript.name,
        panel=_cell(panel),
        passed="yes" if trial.passed else "NO",
        steps="\n".join(steps),
    )


def _cell(text: str) -> str:
    return text.replace("|", "/").replace("\n", " ")


def _kind_of_line(address: str) -> str:
    """Return the kind of the line to the supply, such as "serial line", without its address."""
    upper = address.upper()
    kinds = {"GPIB": "GPIB", "USB0": "USB (VISA)", "SOCKET": "TCP socket", "HISLIP": "HiSLIP", "TCPIP": "VXI-11"}
    return next((words for part, words in kinds.items() if part in upper), "serial line")

"""Write the table in docs/howto/faults.md from the faults of emulators: ``python docs/scripts/faults_table.py``."""

from __future__ import annotations

from pathlib import Path

from eimi_drivers.emulators.faults import Fault

PAGE = Path(__file__).parents[1] / "howto" / "faults.md"
BEGIN, END = "<!-- faults -->\n", "<!-- end of faults -->"


def page() -> str:
    """Return the text of docs/howto/faults.md with a new table of the faults that an emulated instrument can have."""
    before, _, following = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    after = following.partition(END)[2]
    rows = [f"| `{fault.word}` | {fault.effect} | {fault.correct} |" for fault in Fault]
    table = "\n".join(["| name | what it does | a correct program |", "| --- | --- | --- |", *rows])
    return f"{before}{BEGIN}\n{table}\n\n{END}{after}"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")

"""Write the tables in docs/howto/events.md from the classes of the events: ``python docs/scripts/events_table.py``."""

from __future__ import annotations

import dataclasses
import inspect
from pathlib import Path
from typing import Any

from eimi_lab.acquisition.events import EVENTS, Event, ShapeChange

PAGE = Path(__file__).parents[1] / "howto" / "events.md"
COMMON = {field.name for field in dataclasses.fields(Event)}


def meaning(kind: type[Any]) -> str:
    """Return the docstring of an event's class as one line of a table."""
    return " ".join(inspect.getdoc(kind).split()).replace("|", "\\|")  # type: ignore[union-attr]


def fields(kind: type[Any]) -> str:
    """Return the names of an event's fields as text, without the fields that all events have."""
    return ", ".join(f"`{field.name}`" for field in dataclasses.fields(kind) if field.name not in COMMON)


def tables() -> dict[str, str]:
    """Return the tables for the page about the events of a run, as Markdown, by their names in the page."""
    rows = [f"| `{name}` | {fields(kind)} | {meaning(kind)} |" for name, kind in EVENTS.items()]
    change = f"| {fields(ShapeChange)} | {meaning(ShapeChange)} |"
    return {
        "events": "\n".join(["| event | fields | meaning |", "| --- | --- | --- |", *rows]),
        "changes": "\n".join(["| fields | meaning |", "| --- | --- |", change]),
    }


def page() -> str:
    """Return the text of the page with new tables."""
    text = PAGE.read_text(encoding="utf-8")
    for place, table in tables().items():
        before, _, following = text.partition(f"<!-- {place} -->\n")
        _, end, after = following.partition(f"<!-- end of {place} -->")
        text = f"{before}<!-- {place} -->\n\n{table}\n\n{end}{after}"
    return text


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")

"""Write the tables of the page on events from the events' dataclasses: ``python docs/scripts/events_table.py``."""

from __future__ import annotations

import dataclasses
import inspect
from pathlib import Path
from typing import Any

from eimi_lab.acquisition.events import EVENTS, Event, ShapeChange

PAGE = Path(__file__).parents[1] / "howto" / "events.md"
COMMON = {field.name for field in dataclasses.fields(Event)}


def meaning(kind: type[Any]) -> str:
    """Return the docstring of an event in one line."""
    return " ".join(inspect.getdoc(kind).split()).replace("|", "\\|")  # type: ignore[union-attr]


def fields(kind: type[Any]) -> str:
    """Return the names of an event's fields, without the fields that every event has."""
    return ", ".join(f"`{field.name}`" for field in dataclasses.fields(kind) if field.name not in COMMON)


def tables() -> dict[str, str]:
    """Return the tables by the name of their place in the page."""
    rows = [f"| `{name}` | {fields(kind)} | {meaning(kind)} |" for name, kind in EVENTS.items()]
    change = f"| {fields(ShapeChange)} | {meaning(ShapeChange)} |"
    return {
        "events": "\n".join(["| event | fields | meaning |", "| --- | --- | --- |", *rows]),
        "changes": "\n".join(["| fields | meaning |", "| --- | --- |", change]),
    }


def page() -> str:
    """Return the page with new tables, made from the dataclasses of the events."""
    text = PAGE.read_text(encoding="utf-8")
    for place, table in tables().items():
        before, _, rest = text.partition(f"<!-- {place} -->\n")
        _, end, after = rest.partition(f"<!-- end of {place} -->")
        text = f"{before}<!-- {place} -->\n\n{table}\n\n{end}{after}"
    return text


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")

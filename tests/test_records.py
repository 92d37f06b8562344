"""A dataclass is frozen (its fields cannot be set again), unless this file lists the class as an exception.

The exceptions are objects whose contents grow while the program runs. A record is an object of a frozen dataclass.
"""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import pkgutil
from collections.abc import Iterator

import eimi_drivers
import eimi_fitting
import eimi_lab
from eimi_lab.acquisition.events import EVENTS, Event

CHANGING = {
    *("_Announced", "CameraBench", "SensorBench", "SupplyBench"),
    *("Cue", "_Ending", "SupplyTrial", "GenerationLog", "_Underway", "Progress", "View", "Fitting", "Tab", "_Held"),
    *("Elements", "_Counted", "BackLitSearch", "SolidLoads", "_State", "_End"),
}
"""Dataclasses whose attributes are set after the construction: benches, progress of a run, and states of a solver."""


BY_NAME = {
    *("Check", "DatasetPanel", "Estimate", "Fit", "FitRecord", "IdentifiedLaw", "LawRecord", "MotionFacts", "Order"),
    *("Placing", "ReportPanel", "RingDownRecord", "ShapeChange", "Source", "Stepping", "TensileRecord", "Tracks"),
    "_Panel",
}
"""Dataclasses whose fields can only be given by name."""


def dataclasses_of_the_packages() -> Iterator[type]:
    """Yield every dataclass that a module of the three packages defines."""
    for package in (eimi_drivers, eimi_fitting, eimi_lab):
        for info in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            if info.name.rpartition(".")[2] == "__main__":
                continue
            module = importlib.import_module(info.name)
            for _, found in inspect.getmembers(module, inspect.isclass):
                if found.__module__ == info.name and "__dataclass_params__" in vars(found):
                    yield found


def test_a_record_cannot_be_changed() -> None:
    """`dataclasses.replace` makes a changed copy; nobody can change a record that another part of the program holds."""
    found = set(dataclasses_of_the_packages())
    assert len(found) > 300
    assert all(dataclasses.is_dataclass(record) for record in found)
    changing = {record.__name__ for record in found if not record.__dataclass_params__.frozen}  # type: ignore[attr-defined]
    assert changing == CHANGING


def test_records_with_many_fields_take_them_by_name_alone() -> None:
    """The fields of events, of a run in progress and of large results of a fit can only be given by name.

    A new field can then stand in any place of the class.
    """
    found = {
        record.__name__
        for record in dataclasses_of_the_packages()
        if {field.kw_only for field in dataclasses.fields(record)} == {True} and not issubclass(record, Event)
    }
    assert found == BY_NAME
    for event in EVENTS.values():
        assert {field.kw_only for field in dataclasses.fields(event)} == {True}

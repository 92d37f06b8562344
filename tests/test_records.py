"""The dataclasses of this project are frozen, except those in the list CHANGING."""

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
    # Yield every dataclass that a module of the three packages defines.
    for package in (eimi_drivers, eimi_fitting, eimi_lab):
        for info in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            if info.name.rpartition(".")[2] == "__main__":
                continue
            module = importlib.import_module(info.name)
            for _, found in inspect.getmembers(module, inspect.isclass):
                if found.__module__ == info.name and "__dataclass_params__" in vars(found):
                    yield found


def test_a_record_cannot_be_changed() -> None:
    found = set(dataclasses_of_the_packages())
    assert len(found) > 300
    assert all(dataclasses.is_dataclass(record) for record in found)
    changing = {record.__name__ for record in found if not record.__dataclass_params__.frozen}  # type: ignore[attr-defined]
    assert changing == CHANGING


def test_records_with_many_fields_take_them_by_name_alone() -> None:
    found = {
        record.__name__
        for record in dataclasses_of_the_packages()
        if {field.kw_only for field in dataclasses.fields(record)} == {True} and not issubclass(record, Event)
    }
    assert found == BY_NAME
    for event in EVENTS.values():
        assert {field.kw_only for field in dataclasses.fields(event)} == {True}

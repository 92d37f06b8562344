"""Fixtures: one small fit whose numbers all differ, so that a test recognises each number where it is printed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.inference.evidence.quantity import Quantity
from eimi_fitting.inference.identification.whole_fit import identify
from eimi_fitting.inference.interval.budget import BudgetEntry, MeasureNext
from eimi_fitting.inference.interval.draws import Draws
from eimi_fitting.inference.interval.estimate import FreedNuisance
from eimi_fitting.inference.planning.choice_of_law import Choice
from eimi_fitting.laws import LAWS
from eimi_lab.config.specimen import SpecimenFile, load_specimen
from eimi_lab.config.toml import parse
from eimi_lab.dataset.layout import Header
from eimi_lab.dataset.points import Load, TrackedPoints, write_points
from eimi_lab.fits.evidence import Evidence, load_evidence
from eimi_lab.fits.records import CurveRecord, FitRecord, StateError
from eimi_lab.fits.tensile_files import read_tensile
from eimi_lab.fits.tensile_fits import fit_window
from eimi_lab.fits.tensile_record import TensileRecord
from eimi_lab.fits.validation import FitReference, Validation
from eimi_lab.reporting.shown import ShownFit

FIELD_MT = (0.0, 3.0, 6.0)
MODULUS = Quantity(50e3, "Pa", (40e3, 65e3), (49e3, 52e3))


@pytest.fixture(scope="session")
def evidence(tmp_path_factory: pytest.TempPathFactory) -> Evidence:
    # The data of a fit: simulated tracked points of a beam with the shear modulus 50 kPa in three fields.
    path = tmp_path_factory.mktemp("printed") / "beam.h5"
    text = load_specimen("type1").text.replace('section = "solid"', 'section = "plane-stress"')
    specimen = parse(SpecimenFile, text, "type1")
    model = BeamModel(specimen.mechanics(), 20, 2)
    rest = np.column_stack([np.linspace(2, 24, 8), np.zeros(8)])
    shapes = model.solve(LAWS["neo-hookean"], np.array([[50e3]]), Loads.along(FIELD_MT))
    places = model.positions(shapes, rest)[0] + np.random.default_rng(0).normal(0, 0.01, (3, 8, 2))
    names = tuple(f"p{i}" for i in range(8))
    points = [TrackedPoints(names, rest, place, np.full(8, 0.01)) for place in places]
    write_points(path, Header(specimen), 0.0, [Load(None, field, 0.0) for field in FIELD_MT], points)
    return load_evidence(path)


@pytest.fixture(scope="session")
def fitted(evidence: Evidence) -> FitRecord:
    return FitRecord.of(identify("neo-hookean", [evidence.experiment]), [evidence])


@pytest.fixture
def fit(fitted: FitRecord) -> FitRecord:
    # A small fit whose numbers all differ.
    entry = BudgetEntry("width", "width", 0.02, "mm", (0,), 3.0)
    small = [BudgetEntry("depth", "depth", 0.01, "mm", (0,), size) for size in (0.9, 0.8, 0.7, 0.6, 0.3, 0.4)]
    return replace(
        fitted,
        **{
            "initial_shear_modulus": MODULUS,
            "parameters": {"mu": MODULUS},
            "bulk_modulus": Quantity(7e6, "Pa", (5e6, 9e6)),
            "freed": (FreedNuisance("moment", (0,), Quantity(0.011, "1", (-0.02, 0.04)), 0.05),),
            "mean_error_mm": 0.0123,
            "mean_deviation_mm": 0.0045,
            "held_out_error_mm": 0.0234,
            "budget": (entry, *small),
            "measure_next": MeasureNext("width", "width", (45e3, 57e3)),
            "max_stretch": 1.25,
            "draws": Draws(1, ("mu",), tuple((x,) for x in np.linspace(40e3, 65e3, 401).tolist())),
            "tensile": (
                CurveRecord(
                    path="curve.csv",
                    sha256="0" * 64,
                    window_percent=50.0,
                    weight=0.5,
                    rows=40,
                    correlation_rows=4.0,
                    largest_strain=0.5,
                    rmse_alone_Pa=210.0,
                    rmse_Pa=350.0,
                ),
            ),
            "doubts": (),
            "by_state": tuple(
                StateError(
                    dataset=0, state=k, current_A=None, field_mT=field, error_mm=0.01 * (k + 1), deviation_mm=0.002
                )
                for k, field in enumerate(FIELD_MT)
            ),
        },
    )


@pytest.fixture
def tensile(tmp_path: Path) -> TensileRecord:
    strain = np.linspace(0.02, 1.0, 30)
    rows = [f"{e},{60 * (1 + e - (1 + e) ** -2)}" for e in strain]
    (tmp_path / "curve.csv").write_text("\n".join(["strain,stress_kPa", *rows]) + "\n")
    record = fit_window(read_tensile(tmp_path / "curve.csv"), "neo-hookean", 50.0)
    return replace(record, rmse_Pa=1234.0)


@pytest.fixture
def shown() -> Callable[..., ShownFit]:
    # Return a function from a stored fit to the object that a report prints.
    def shown(fit: FitRecord | TensileRecord, comparison: tuple[Choice, ...] = ()) -> ShownFit:
        return ShownFit(Path("fits.json"), 0, fit, comparison, "bending")

    return shown


@pytest.fixture
def validation() -> Callable[..., Validation]:
    # Return a function that returns invented errors of a fit on its own dataset.
    def validation(of: FitRecord, **changes: Any) -> Validation:
        values: dict[str, Any] = {
            "dataset": "beam.h5",
            "sha256": "0" * 64,
            "section": "plane-stress",
            "model": of.model,
            "fit": FitReference(path="fits.json", index=0, kind="bending", window_percent=None),
            "initial_shear_modulus": MODULUS,
            "seen": True,
            "states": of.datasets[0].states,
            "status": "ok",
            "mean_error_mm": 0.02,
            "mean_error_interval_mm": (0.015, 0.03),
            "mean_deviation_mm": 0.004,
            "max_stretch": 1.2,
            "stable": True,
            "within_fitted_stretch": True,
            "by_state": of.by_state,
        }
        return Validation(**{**values, **changes})

    return validation


@pytest.fixture(scope="session")
def choices() -> tuple[Choice, ...]:
    # The comparison of two laws on one dataset, in which the second law is better.
    return (
        Choice("neo-hookean", 1, 55.0, 7.5, 3.25, 0.02, 0.0123),
        Choice("yeoh", 3, 55.0, 0.0, 0.0, 0.98, 0.0045),
    )

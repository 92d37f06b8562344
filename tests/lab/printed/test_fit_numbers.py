"""Terminal, notebook and material card show each number of a fit with the right value, unit and place."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_fitting.inference.doubts.checks import Doubt
from eimi_fitting.inference.evidence.quantity import Quantity
from eimi_fitting.inference.planning.choice_of_law import Choice
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.tensile import engineering_stress
from eimi_lab.fits.bootstrap_record import BootstrapRecord, ReplicateRecord
from eimi_lab.fits.evidence import Evidence
from eimi_lab.fits.export import bulk_modulus_Pa
from eimi_lab.fits.fit_figures import drawn_errors as errors_in_a_notebook
from eimi_lab.fits.fit_figures import drawn_law
from eimi_lab.fits.fit_summary import comparison_table, remarks
from eimi_lab.fits.records import FitRecord
from eimi_lab.fits.states_used import FlaggedState, StatesUsed, WidenedState
from eimi_lab.fits.tensile_record import TensileRecord

OF_THE_RECORD = ("doubts", "stability", "model", "tensile", "by_state", "datasets")
"""Fields whose type in a fits file differs from their type in the object `Fit`."""


def test_the_line_of_a_fit_has_the_modulus_with_its_interval_and_the_error_in_micrometres(fit: FitRecord) -> None:
    assert "initial shear modulus 50000 Pa [40000, 65000], mean error 12.30 µm" in fit.summary()
    assert "Mean error 12.3 µm, mean deviation 4.5 µm." in fit.notes()
    large = replace(fit, initial_shear_modulus=Quantity(50e6, "Pa", (40e6, 65e6)))
    assert "50.000 MPa [40.000, 65.000]" in large.summary()


def test_the_remarks_of_a_fit_have_the_right_units(fit: FitRecord) -> None:
    lines = remarks(fit)
    assert "bulk modulus 7000 [5000, 9000] kPa" in lines
    assert "moment: fitted deviation from the given value 1.1 % [-2 %, 4 %], prior standard deviation 5 %" in lines
    assert any(
        line.startswith(
            "curve.csv: RMSE 0.35 kPa, or 0.21 kPa if the law is fitted to this curve alone (weight 0.5, 40 rows "
            "that count as 10.0"
        )
        for line in lines
    )
    assert "width ± 0.02 mm: ± 3 % of the modulus" in lines
    assert "2 smaller sources together: ± 0.5 % of the modulus" in lines
    assert "95 % interval from noise and mesh error alone: [49000, 52000] Pa" in lines
    assert any("the interval would be [45000, 57000] Pa" in line for line in lines)
    in_degrees = replace(fit.freed[0], deviation=Quantity(0.2, "deg", (0.1, 0.4)), prior_standard_deviation=0.3)
    lines = remarks(replace(fit, freed=(in_degrees,)))
    assert (
        "moment: fitted deviation from the given value 0.2 deg [0.1 deg, 0.4 deg], prior standard deviation 0.3 deg"
        in lines
    )


def test_the_comparison_of_laws_has_each_criterion_in_its_column(choices: tuple[Choice, ...]) -> None:
    _, first, second, points = comparison_table(choices)
    assert first.split() == ["neo-hookean", "1", "7.5", "3.2", "0.020", "12.30", "µm"]
    assert second.split() == ["yeoh", "3", "0.0", "0.0", "0.980", "4.50", "µm"]
    assert "count the data as 55.0 independent points" in points


def test_a_tensile_fit_s_misfit_is_in_kilopascal(tensile: TensileRecord) -> None:
    assert "RMSE 1.23 kPa over" in tensile.summary()
    assert "RMSE 1.23 kPa over" in tensile.notes()[0]
    nowhere = tensile.stability.model_copy(update={"stable_up_to_stretch": 1.0})
    assert "not stable at any stretch" in replace(tensile, stability=nowhere).summary()
    limited = tensile.stability.model_copy(update={"stable_up_to_stretch": 1.5})
    assert "stable up to a stretch of 1.50 only" in replace(tensile, stability=limited).summary()


def test_the_interval_of_a_bootstrap_contains_95_per_cent_of_its_replicates() -> None:
    def replicates(count: int) -> list[ReplicateRecord]:
        return [
            ReplicateRecord(
                replicate=k + 1,
                parameters={"mu": 0.0},
                initial_shear_modulus_Pa=1000.0 * k,
                mean_error_mm=0.0,
                evaluations=1,
                stop="",
                wall_s=0.0,
            )
            for k in range(count)
        ]

    assert BootstrapRecord.of(replicates(41)).initial_shear_modulus_interval_95_Pa == pytest.approx((1000.0, 39000.0))
    assert BootstrapRecord.of(replicates(39)).initial_shear_modulus_interval_95_Pa is None


def test_a_fit_of_two_datasets_keeps_dataset_and_index_of_each_state(fitted: FitRecord, evidence: Evidence) -> None:
    short = replace(evidence, path=Path("short.h5"), states=(replace(evidence.states[2], index=7),))
    held = {name: value for name, value in vars(fitted).items() if name not in OF_THE_RECORD}
    fit: Any = SimpleNamespace(
        **held,
        law=LAWS["neo-hookean"],
        error_mm=np.array([0.1, 0.2, 0.3, 0.4]),
        deviation_mm=np.array([0.01, 0.02, 0.03, 0.04]),
        residuals_mm=(np.zeros((1, 2, 1)), np.zeros((3, 2, 1))),
        corrections={},
        curves=(),
        curve_rmse_Pa=(),
        doubts=(Doubt("odd", 0, 0),),
        stable_to=None,
        stability_checked_to=6.0,
    )
    record = FitRecord.of(fit, [short, evidence])
    assert [(s.dataset, s.state, s.error_mm, s.deviation_mm) for s in record.by_state] == [
        (0, 7, 0.1, 0.01),
        (1, 0, 0.2, 0.02),
        (1, 1, 0.3, 0.03),
        (1, 2, 0.4, 0.04),
    ]
    assert [s.field_mT for s in record.by_state] == [6.0, 0.0, 3.0, 6.0]
    assert record.doubts_in_words() == ["short.h5, state 7: odd"]


def test_states_left_out_are_subtracted_from_the_total() -> None:
    used = StatesUsed(16, (FlaggedState(2, ("DEFOCUS",)), FlaggedState(7, ("DEFOCUS",))), (), (WidenedState(3, 0.02),))
    assert used.in_words() == (
        "14 of 16 states used; left out: DEFOCUS in 2 (states 2, 7); the uncertainty of the points was increased in "
        "1 state (the largest increase is 0.02 mm in state 3)"
    )


def test_the_figures_of_a_notebook_are_in_kilopascal_and_micrometres() -> None:
    law, drawn = LAWS["neo-hookean"], np.linspace(40e3, 60e3, 2001)[:, None]
    (axes,) = drawn_law(law, np.array([50e3]), drawn, 1.5).axes
    strain, stress = axes.lines[0].get_data()
    assert stress == pytest.approx(1e-3 * engineering_stress(law, np.array([50e3]), strain / 100))
    band = axes.collections[0].get_paths()[0].vertices
    ends = 1e-3 * engineering_stress(law, np.array([[40.5e3], [59.5e3]]), np.array([1.0]))[:, 0]
    at_end = band[np.isclose(band[:, 0], 100.0), 1]
    assert (at_end.min(), at_end.max()) == pytest.approx(tuple(ends), rel=1e-3)
    (axes,) = errors_in_a_notebook([0, 1], [2.0, 4.0], [0.01, 0.03], [0.002, 0.004]).axes
    assert axes.lines[0].get_ydata().tolist() == pytest.approx([10.0, 30.0])
    assert "µm" in axes.get_ylabel()


@pytest.mark.parametrize(("kPa", "ratio", "expected"), [(900.0, None, 9e5), (None, 2000.0, 1e8)])
def test_a_material_card_has_the_stated_bulk_modulus(
    fit: FitRecord, kPa: float | None, ratio: float | None, expected: float
) -> None:
    assert bulk_modulus_Pa(fit, "abaqus", kPa, ratio) == pytest.approx(expected)

"""The tables of the study have the right units, strain ranges and noise, for results that this file contains."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_fitting.laws import LAWS
from eimi_fitting.laws.tensile import engineering_stress
from eimi_lab.study.errors_by_route import mean_deviation_um, mean_error_um
from eimi_lab.study.observed import NOISE_MM, noise_mm
from eimi_lab.study.paper_tables import parameters, searches
from eimi_lab.study.routes import BENDING, Route, by_tension

STORED = {"error_mm": [0.01, 0.03], "deviation_mm": [0.004, 0.006], "edges_mm": None}
LOST = {"error_mm": None, "deviation_mm": None, "edges_mm": None}


def test_errors_and_deviations_are_in_micrometres() -> None:
    assert mean_error_um(STORED) == pytest.approx(20.0)
    assert mean_deviation_um(STORED) == pytest.approx(5.0)
    assert mean_error_um(LOST) == mean_deviation_um(LOST) == np.inf


def test_the_noise_of_a_specimen_is_reproducible_and_differs_from_that_of_others() -> None:
    one, again, other = (noise_mm((40, 50), of) for of in ("type1", "type1", "type2"))
    np.testing.assert_array_equal(one, again)
    assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < 0.1
    assert one.std() == pytest.approx(NOISE_MM, rel=0.05)


def test_a_window_contains_only_strains_up_to_its_limit() -> None:
    """A fit with a strain window of 20 % ignores the curve beyond 20 %, where it is twice as stiff."""
    strain = np.linspace(0.01, 1.0, 100)
    soft, stiff = (engineering_stress(LAWS["neo-hookean"], np.array([mu]), strain) for mu in (20e3, 40e3))
    stress = np.where(strain <= 0.2, soft, stiff)
    extent: Any = SimpleNamespace(windows_percent=(20.0, None), laws=("neo-hookean",))
    small, whole = by_tension(strain, stress, "own", extent)
    assert (small["window"], whole["window"]) == ("20 %", "full")
    assert small["modulus_Pa"] == pytest.approx(20e3)
    assert whole["modulus_Pa"] > 38e3


def test_tables_have_moduli_in_kilopascal_and_errors_in_micrometres() -> None:
    route = Route("neo-hookean", (46.3e3,), 46.3e3, BENDING)
    key = "ecoflex_00_50"
    fit = {"law": "neo-hookean", "evaluations": 80, "generations": 10, "unconverged": 1, "unstable": 2}
    fit |= {"mean_error_mm": 0.0123, "mean_deviation_mm": 0.0045, "not_fixed": []}
    findings: Any = SimpleNamespace(
        inputs=SimpleNamespace(extent=SimpleNamespace(types=("type1", "type2"), materials=(key,))),
        routes=lambda key, section: [route],
        errors={
            (key, s, kind): [STORED if kind == "type1" else LOST]
            for s in ("solid", "plane-strain")
            for kind in ("type1", "type2")
        },
        bending={(key, "solid"): [fit]},
    )
    for row in parameters(findings, key).rows:
        assert row[1:] == ("bending", "neo-hookean", "mu 46.30 kPa", "46.3", "20 (5)", "∞ (∞)")
    (row,) = searches(findings).rows
    assert row[2:8] == ("neo-hookean", "80", "10", "3", "12.3", "4.5")

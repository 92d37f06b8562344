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
from eimi_lab.study.paper_tables import _compressibility, _moment, _optimisers, _states, parameters, searches
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
    # The curve is twice as stiff beyond the limit of 20 %.
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


def test_the_compressibility_is_ordered_and_a_missed_truth_is_named() -> None:
    row = {"solid_percent": 1.234, "solid_error_um": 5.678, "plane_strain_percent": 9.876, "freed_percent": 0.1234}
    row |= {"freed_interval_percent": (-1.5, 2.5)}
    table = _compressibility(
        [
            row | {"bulk_over_shear": None, "bulk_over_shear_found": (9000.0, 300.0, np.inf)},
            row | {"bulk_over_shear": 50.0, "bulk_over_shear_found": (60.0, 55.0, 65.0)},
            row | {"bulk_over_shear": 10.0, "bulk_over_shear_found": (11.0, 10.0, 12.0)},
        ]
    )
    assert [cells[0] for cells in table.rows] == ["10", "50", "infinite"]
    assert table.rows[0][1:] == ("1.23", "5.68", "9.88", "0.123 [-1.5, 2.5]", "11 [10, 12]")
    assert table.rows[2][5] == "9000 [300, ∞]"
    assert table.note.endswith("The interval misses the truth at K/µ = 50.")


def test_an_identified_moment_has_its_interval_and_a_stated_one_a_dash() -> None:
    row = {"case": "N52", "percent": 1.5, "interval_percent": (-2.0, 3.0), "error_um": 4.25, "correlation": 0.98765}
    freed, stated = _moment([row | {"moment_percent": (0.5, -1.0, 2.0)}, row | {"moment_percent": None}]).rows
    assert freed == ("N52", "1.5", "[-2, 3]", "4.25", "0.5 [-1, 2]", "0.9877")
    assert stated[4] == "–"


@pytest.mark.parametrize(("half_percent", "words"), [((1.54, 1.0), "6 states are"), ((1.54, 1.01), "None of")])
def test_enough_states_are_the_fewest_with_an_interval_of_one_per_cent(
    half_percent: tuple[float, float], words: str
) -> None:
    rows = [
        {
            "states": states,
            "foretold_percent": {"0.1 px": 1.234, "1 px": 12.34},
            "fit_half_percent": half,
            "fit_percent": 0.5678,
        }
        for states, half in zip((3, 6), half_percent, strict=True)
    ]
    table = _states(rows)
    assert table.rows[0] == ("3", "1.2", "12", "1.5", "0.57")
    assert len(table.head) == 5
    assert table.note.startswith(words)


def test_evaluations_of_an_optimiser_are_medians_of_the_runs_that_arrived() -> None:
    row = {"law": "yeoh", "optimiser": "CMA-ES", "evaluations": [100, 300, 200], "least_error_um": [2.345, 1.234]}
    some, none, every = _optimisers(
        [row | {"to_one_percent": arrived} for arrived in ([80, None, 120], [None] * 3, [80, 90, 120])]
    ).rows
    assert some == ("yeoh", "CMA-ES", "100 (2 of 3 runs)", "80, 120", "200", "1.23 to 2.35")
    assert none[2:4] == ("never", "∞, ∞")
    assert every[2] == "90"

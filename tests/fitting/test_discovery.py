"""The search for the terms of a law names the terms if the data determine them, and else says "not identifiable"."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eimi_fitting.discovery.rows import Rows
from eimi_fitting.discovery.supports import supports
from eimi_fitting.discovery.terms_of_a_law import discover
from eimi_fitting.inference.evidence.tensile_curves import TensileCurve
from eimi_fitting.laws import LAWS, CannotFit, engineering_stress
from eimi_fitting.laws.sum_of_terms import SumOfTerms, Term
from tests.shared.hidden_laws import Hidden


def curve_of(law, parameters, noise=0.002, largest=3.0, rows=150):
    # Return a simulated tensile curve; `noise` is relative to the largest stress, `largest` is the largest strain.
    strain = np.linspace(largest / rows, largest, rows)
    stress = engineering_stress(law, np.array(parameters), strain)
    return TensileCurve(strain, stress + np.random.default_rng(1).normal(0, noise * stress.max(), rows))


@pytest.mark.parametrize(
    ("terms", "coefficients"),
    [(["i2"], [46e3]), (["i1", "ogden=-4"], [20e3, 9e3]), (["i2", "i1^2", "fung=0.2"], [20e3, 800.0, 1e3])],
)
def test_terms_of_a_curve_are_found_with_their_coefficients(terms, coefficients):
    discovery = discover([], [curve_of(SumOfTerms.of(*terms), coefficients)])
    assert discovery.identified, discovery.statement
    (law,) = discovery.alternatives
    assert [term.name for term in law.terms] == terms
    assert (law.intervals[:, 0] <= coefficients).all()
    assert (law.intervals[:, 1] >= coefficients).all()
    assert law.stable_to is None


def test_a_short_curve_gives_not_identifiable():
    discovery = discover([], [curve_of(SumOfTerms.of("i1", "gent=20"), [20e3, 10e3], largest=0.3)])
    assert not discovery.identified
    assert discovery.statement.startswith("not identifiable")


def test_a_curve_that_no_sum_of_terms_describes_is_not_identified():
    strain = np.linspace(0.02, 3.0, 150)
    stress = 40e3 * np.tanh(2 * strain) + np.random.default_rng(1).normal(0, 1.0, 150)
    discovery = discover([], [TensileCurve(strain, stress)])
    assert not discovery.identified


def test_bending_with_a_curve_identifies_the_terms_and_bending_alone_does_not():
    hidden = Hidden((Term.of("i1"), Term.of("gent=20")), np.array([20e3, 6e3]))
    rng = np.random.default_rng(4)
    experiment = hidden.bent(solid=False, rng=rng).of_states(np.array([1, 3, 5]))
    curve = hidden.curve(0.002, rng)
    both, alone = (discover([experiment], curves, modulus_Pa=27e3) for curves in ([curve], []))
    assert both.identified, both.statement
    assert both.alternatives[0].terms == hidden.terms
    assert both.alternatives[0].initial_shear_modulus_Pa == pytest.approx(26e3, rel=0.02)
    assert not alone.identified
    assert alone.statement.startswith("not identifiable")


def test_a_gent_term_is_left_out_if_the_curve_exceeds_its_limit():
    discovery = discover([], [curve_of(LAWS["neo-hookean"], [46e3], largest=4.0)])
    assert [term.name for term in discovery.left_out] == ["gent=20"]
    assert "gent=20" not in [term.name for term in discovery.library]


def test_a_compression_test_reaches_its_largest_compression():
    strain = np.linspace(-0.02, -0.88, 60)
    stress = engineering_stress(LAWS["neo-hookean"], np.array([46e3]), strain)
    noisy = stress * (1 + np.random.default_rng(1).normal(0, 1e-3, 60))
    library = [Term.of(name) for name in ("i1", "gent=10", "gent=20")]
    discovery = discover([], [TensileCurve(strain, noisy)], library=library)
    assert discovery.strain == -0.88
    assert [term.name for term in discovery.left_out] == ["gent=10"]  # I1 - 3 reaches 13.7


def test_prediction_errors_equal_those_of_a_fit_without_the_left_out_rows():
    rng = np.random.default_rng(2)
    columns, nuisances = rng.uniform(0.5, 1.5, (40, 3)), rng.normal(size=(40, 1))
    observed = columns @ [1.0, 2.0, 0.5] + 0.3 * nuisances[:, 0] + rng.normal(0, 0.1, 40)
    rows = Rows(observed, columns, nuisances, np.arange(40) // 4)  # ten groups for the cross-validation
    whole = next(s for s in supports(rows, np.array([True, True, True]), 3) if s.terms == (0, 1, 2))
    for group in range(10):
        kept = rows.groups != group
        kept_rows = np.vstack([np.column_stack([columns, nuisances])[kept], [0.0, 0.0, 0.0, 1.0]])
        best = np.linalg.lstsq(kept_rows, np.append(observed[kept], 0.0), rcond=None)[0]
        errors = np.column_stack([columns, nuisances])[~kept] @ best - observed[~kept]
        assert whole.prediction_errors[~kept] == pytest.approx(errors, abs=1e-6)


@pytest.mark.parametrize("words", ["gent", "gent=0", "fung=-1", "ogden=0", "i1=2", "ogden=nan", "arruda=3", ""])
def test_an_unknown_term_is_refused_with_a_list_of_valid_terms(words):
    with pytest.raises(ValueError, match="should be one of i1, i2"):
        Term.of(words)


def test_unusable_libraries_and_missing_data_are_refused():
    curve = curve_of(LAWS["neo-hookean"], [46e3])
    with pytest.raises(ValueError, match="adds to the initial shear modulus"):
        discover([], [curve], library=[Term.of("i1^2")])
    with pytest.raises(ValueError, match="twice"):
        discover([], [curve], library=[Term.of("i1"), Term.of("i1")])
    with pytest.raises(ValueError, match="at least one"):
        discover([], [])
    hardening = engineering_stress(SumOfTerms.of("i1", "i1^3"), np.array([-20e3, 35.0]), curve.strain)
    with pytest.raises(CannotFit, match="no set of terms with positive coefficients fits the data"):
        discover([], [replace(curve, stress_Pa=hardening)], library=[Term.of("i1"), Term.of("i1^3")])
    with pytest.raises(CannotFit, match="check the signs of strain and stress"):
        discover([], [replace(curve, stress_Pa=-curve.stress_Pa)])
    with pytest.raises(CannotFit, match="rows"):
        discover([], [replace(curve, strain=curve.strain[:4], stress_Pa=curve.stress_Pa[:4])])

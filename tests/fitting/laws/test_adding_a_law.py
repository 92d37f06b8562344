"""A user's law, registered as CONTRIBUTING.md describes, is accepted by every part of the tests."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.specimen import Magnet, Specimen
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation, edge_curves, points_on
from eimi_fitting.inference.evidence.tensile_curves import TensileCurve
from eimi_fitting.inference.identification.whole_fit import identify
from eimi_fitting.laws import LAWS, CannotFit, NotInSolver, engineering_stress, fit_tensile
from eimi_lab.config.materials import TrueMaterial
from eimi_lab.fits.export import Material, material_card
from examples.arruda_boyce import ArrudaBoyce

SPECIMEN = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-strain", Magnet(4.0, 3.0, 2.0, 1.2, 7500.0))
NOISE_MM = 1e-3
TRUTH = np.array([40e3, 2.5])


@pytest.fixture
def law(monkeypatch: pytest.MonkeyPatch) -> ArrudaBoyce:
    new = ArrudaBoyce()
    monkeypatch.setitem(LAWS, new.name, new)
    return new


def test_a_beam_and_a_tensile_curve_are_fitted_together(law: ArrudaBoyce) -> None:
    rng = np.random.default_rng(0)
    fine, loads = BeamModel(SPECIMEN, 30, 3), Loads.along(np.array([3.5, 7.05]))
    sides = points_on(edge_curves(fine, fine.solve(law, TRUTH[None], loads))[0], 3)[:, :, 4:-4:2]
    noisy, sigma = sides + rng.normal(0, NOISE_MM, sides.shape), np.full(sides.shape[2], NOISE_MM)
    observed = EdgeObservation.from_edges([(left, sigma, right, sigma) for left, right in noisy])
    strain = np.linspace(0.02, 1.5, 60)
    curve = TensileCurve(strain, engineering_stress(law, TRUTH, strain) + rng.normal(0, 200.0, 60))
    experiment = Experiment(BeamModel(SPECIMEN).refined(), loads, observed)
    fit = identify(law.name, [experiment], tensile=[curve], seed=1)
    modulus = float(law.initial_shear_modulus(TRUTH))
    low, high = fit.initial_shear_modulus.interval_95
    print(fit.parameters, fit.initial_shear_modulus.value, (low, high))
    assert fit.initial_shear_modulus.value == pytest.approx(modulus, rel=0.01)
    assert low < fit.initial_shear_modulus.value < high
    assert [estimate.value for estimate in fit.parameters.values()] == pytest.approx(TRUTH, rel=0.02)
    assert fit.error_mm.mean() == pytest.approx(NOISE_MM, rel=0.3)
    assert fit.stable_to is None


def test_a_virtual_specimen_and_material_cards_accept_the_new_law(law: ArrudaBoyce) -> None:
    true_material = TrueMaterial(model=law.name, parameters={"mu_Pa": 40e3, "lambda_m": 2.5})
    assert true_material.values == (40e3, 2.5)
    material = Material(law, TRUTH, 1e8, "S", ())
    card = material_card("abaqus", material)
    assert "*HYPERELASTIC, ARRUDA-BOYCE\n0.04, 2.5, 0.02\n" in card
    comsol = material_card("comsol", material)
    assert 'mu0 40000[Pa] "macroscopic shear modulus"\nNseg 6.25 "number' in comsol
    with pytest.raises(NotInSolver, match="sofa"):
        material_card("sofa", material)


@pytest.mark.parametrize("truth", [[40e3, 2.5], [40e3, 6.0]])
def test_intervals_of_a_tensile_fit_contain_the_truth(law: ArrudaBoyce, truth: list[float]) -> None:
    strain, rng = np.linspace(0.02, 1.0, 60), np.random.default_rng(1)
    clean, modulus = engineering_stress(law, np.array(truth), strain), float(law.initial_shear_modulus(np.array(truth)))
    inside = np.zeros(2)
    for _ in range(40):
        fit = fit_tensile(law, strain, clean + rng.normal(0, 1e3, 60))
        low, high = fit.initial_shear_modulus_interval_Pa
        inside += low <= modulus <= high, fit.intervals[1, 0] <= truth[1] <= fit.intervals[1, 1]
    print(truth, inside)
    assert np.all(inside >= 35)  # 38 of 40 intervals are expected to contain the truth


def test_a_tensile_curve_with_stresses_that_the_law_cannot_produce_is_refused(law: ArrudaBoyce) -> None:
    strain = np.linspace(0.1, 1.0, 10)
    with pytest.raises(CannotFit, match="no arruda-boyce law within the bounds of the search has stresses of this"):
        fit_tensile(law, strain, -1e4 * strain)
    for nonlinear in (law, LAWS["ogden"]):
        with pytest.raises(CannotFit, match="every stress is zero"):
            fit_tensile(nonlinear, strain, 0.0 * strain)


def test_a_parameter_that_only_the_bounds_limit_is_reported_as_not_determined(law: ArrudaBoyce) -> None:
    # Polymer chains far from their locking stretch are Gaussian, so that a short curve does not determine this stretch.
    strain = np.linspace(0.02, 0.2, 30)
    noise = np.random.default_rng(0).normal(0, 500.0, 30)
    fit = fit_tensile(law, strain, engineering_stress(law, np.array([40e3, 9.0]), strain) + noise)
    assert "lambda_m" in fit.not_fixed
    assert fit.intervals[1] == pytest.approx([0.7**-0.5, 10.0])


def test_the_initial_modulus_equals_the_published_series(law: ArrudaBoyce) -> None:
    # Abaqus Analysis User's Guide, Arruda-Boyce form.
    locking = 1.7
    series = 1 + 3 / (5 * locking**2) + 99 / (175 * locking**4) + 513 / (875 * locking**6)
    series += 42039 / (67375 * locking**8)
    assert law.initial_shear_modulus(np.array([1.0, locking])) == pytest.approx(series, rel=1e-12)


def test_the_example_runs() -> None:
    root = Path(__file__).parents[3]
    done = subprocess.run([sys.executable, "-m", "examples.arruda_boyce"], cwd=root, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "arruda-boyce" in done.stdout
    assert "*HYPERELASTIC, ARRUDA-BOYCE" in done.stdout

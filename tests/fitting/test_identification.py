"""A fit to simulated edges with noise finds the parameters of the material."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.specimen import Magnet, Specimen
from eimi_fitting.correlation import correlation_length
from eimi_fitting.inference.evidence.corrections import FINER_MESH, correction
from eimi_fitting.inference.evidence.experiment import DISCARDED_MM, Experiment, compare
from eimi_fitting.inference.evidence.measurements import EdgeObservation, PointObservation, edge_curves, points_on
from eimi_fitting.inference.identification.whole_fit import identify
from eimi_fitting.inference.interval import corrected_optimum
from eimi_fitting.inference.searching.modulus_range import NothingConverged
from eimi_fitting.laws import LAWS
from tests.shared.estimates import refined

SPECIMEN = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-strain", Magnet(4.0, 3.0, 2.0, 1.2, 7500.0))
FIELD_MT = np.linspace(0, 7.05, 4)
NOISE_MM = 1e-3


def measured(model: str, parameters: list[float], seed: int = 0) -> Experiment:
    # Return a simulated experiment: noisy edges of a beam of a known material, on a finer mesh than that of a fit.
    rng = np.random.default_rng(seed)
    fine, loads = BeamModel(SPECIMEN, 30, 3), Loads.along(FIELD_MT)
    shapes = fine.solve(LAWS[model], np.array([parameters]), loads)
    assert shapes.converged[0]
    sides = points_on(edge_curves(fine, shapes)[0], 3)[:, :, 4:-4:2]
    noisy = sides + rng.normal(0, NOISE_MM, sides.shape)
    sigma = np.full(sides.shape[2], NOISE_MM)
    observed = EdgeObservation.from_edges([(left, sigma, right, sigma) for left, right in noisy])
    return Experiment(BeamModel(SPECIMEN).refined(), loads, observed)


@pytest.fixture(scope="module")
def neo_hookean() -> Experiment:
    return measured("neo-hookean", [46e3])


def test_a_neo_hookean_modulus_is_identified_within_a_per_cent_and_its_interval(neo_hookean):
    fit = identify("neo-hookean", [neo_hookean], seed=3)
    assert fit.initial_shear_modulus.value == pytest.approx(46e3, rel=0.01)
    low, high = fit.initial_shear_modulus.interval_95
    assert low < fit.initial_shear_modulus.value < high
    assert fit.error_mm.shape == (4,)
    assert fit.error_mm.mean() == pytest.approx(NOISE_MM, rel=0.3)
    assert fit.polish.mean_error_after_mm <= fit.polish.mean_error_before_mm
    assert fit.stop
    assert not fit.identifiability.at_bound
    assert fit.evaluations == sum(1 for _ in fit.history) * 8
    assert fit.causes
    without_causes = identify("neo-hookean", [neo_hookean], seed=3, possible_causes=())
    assert without_causes.causes == ()
    assert without_causes.initial_shear_modulus == fit.initial_shear_modulus


def test_without_an_equilibrium_on_the_finer_mesh_there_is_a_doubt(neo_hookean, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(corrected_optimum, "correction", lambda *_: None)
    fit = identify("neo-hookean", [neo_hookean], seed=3)
    assert fit.mesh.change_percent is None
    (doubt,) = fit.doubts
    assert (doubt.dataset, doubt.state) == (0, None)
    assert "finer mesh" in doubt.words


def test_an_optimum_that_is_unstable_on_the_finer_mesh_still_gets_a_mesh_correction(neo_hookean):
    def compared(experiments, unstable=False):
        return replace(compare(LAWS["neo-hookean"], np.array([[46e3]]), experiments), unstable=np.array([unstable]))

    def unstable_if_finer(experiments):
        return compared(experiments, len(experiments[0].model.mesh.nodes) > len(neo_hookean.model.mesh.nodes))

    mesh_correction = correction(FINER_MESH, [neo_hookean], compared([neo_hookean]), unstable_if_finer)
    assert mesh_correction is not None
    change = (
        compared(mesh_correction.added([neo_hookean])).misfits[0].residuals
        - compared([neo_hookean]).misfits[0].residuals
    )
    assert 1e-5 < np.abs(change).max() < 1e-2


def test_the_same_seed_gives_the_same_result_and_another_seed_the_same_material(neo_hookean):
    first, again, other = (identify("neo-hookean", [neo_hookean], seed=s, most_generations=30) for s in (5, 5, 6))
    assert first.parameters == again.parameters
    assert other.values[0] == pytest.approx(first.values[0], rel=1e-2)


def test_a_mooney_rivlin_fit_reports_that_the_data_determine_only_the_sum(neo_hookean):
    fit = identify("mooney-rivlin", [neo_hookean], seed=1)
    assert fit.initial_shear_modulus.value == pytest.approx(46e3, rel=0.01)
    assert fit.identifiability.not_fixed == ("C01/(C10+C01)",)
    assert "they do not determine C01/(C10+C01)" in fit.identifiability.statement
    low, high = fit.parameters["C10"].interval_95
    assert high - low > 0.3 * 23e3


def test_several_specimens_are_fitted_together(neo_hookean):
    both = refined("neo-hookean", [neo_hookean, measured("neo-hookean", [46e3], seed=1)], 50e3)
    assert both.optimum.evaluation.comparison.error_mm.shape[1] == 8
    assert both.estimate.initial_shear_modulus.value == pytest.approx(46e3, rel=0.01)


def test_unstable_and_unsolvable_candidates_are_discarded_and_counted_separately(neo_hookean):
    result = compare(LAWS["yeoh"], np.array([[2e4, 1e3, 0.0], [2e4, -2e5, 0.0], [np.nan, 0, 0]]), [neo_hookean])
    assert result.objective_mm[0] < 1.0
    assert result.objective_mm[1:].tolist() == [DISCARDED_MM, DISCARDED_MM]
    assert result.unconverged[2]
    assert not result.unconverged[0]
    assert not result.unstable[0]


def test_a_fit_without_any_solvable_candidate_is_refused():
    model = BeamModel(SPECIMEN)
    crushed = Loads(np.zeros((2, 2)), np.array([[-1e30, 3e29], [-1e30, 3e29]]), np.zeros((2, 2)))
    rest = np.tile([[[10.0, 0.0]]], (2, 1, 1))
    experiment = Experiment(model, crushed, PointObservation(rest, rest, np.ones((2, 1))))
    with pytest.raises(NothingConverged, match="no beam can be simulated: check geometry, loads and units"):
        identify("neo-hookean", [experiment], seed=1, most_generations=2)


def test_the_correlation_length_of_white_and_of_averaged_noise():
    rng = np.random.default_rng(0)
    white = rng.normal(size=(400, 200))
    weights = np.ones_like(white)
    assert correlation_length(white, weights) == pytest.approx(1.0, abs=0.1)
    # A moving mean over m values has a triangular autocorrelation, whose sum is m.
    averaged = np.apply_along_axis(lambda r: np.convolve(r, np.ones(5) / 5, "valid"), 1, white)
    # (the sum up to the first negative value includes a little noise)
    assert correlation_length(averaged, np.ones_like(averaged)) == pytest.approx(5.0, rel=0.2)

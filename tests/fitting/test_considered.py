"""The interval of a fit contains the effect of every uncertain input, whether the fit estimates the input or not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.specimen import Magnet, Specimen
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation, PointObservation, edge_curves, points_on
from eimi_fitting.inference.evidence.sources import SOURCES, StatedSource
from eimi_fitting.inference.evidence.unknowns import NuisancePrior
from eimi_fitting.inference.identification.whole_fit import identify
from eimi_fitting.inference.interval import considered
from eimi_fitting.inference.interval.estimate import Estimate
from eimi_fitting.inference.planning.choice_of_law import Candidate, choose
from eimi_fitting.laws import LAWS
from tests.shared.estimates import refined

TRUTH_PA = 46e3
NOISE_MM = 2e-3
MAGNET = Magnet(4.0, 3.0, 2.0, 1.2, 7500.0)
BEAM = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-stress", MAGNET)
LOADS = Loads.along((2.0, 4.5, 7.0))


def noisy_edges(
    beam: Specimen = BEAM,
    loads: Loads = LOADS,
    scale: float = 1.0,
    seed: int = 1,
    law: str = "neo-hookean",
    parameters: tuple[float, ...] = (TRUTH_PA,),
) -> EdgeObservation:
    # Return the simulated noisy edges of a beam; by default neo-Hookean with a modulus of 46 kPa.
    # scale : factor on all coordinates, as from a wrong scale of the camera
    model = BeamModel(beam, 26, 2)
    shapes = model.solve(LAWS[law], np.array([parameters]), loads)
    sides = scale * points_on(edge_curves(model, shapes)[0], 2)[:, :, 1:-1]
    noisy = sides + np.random.default_rng(seed).normal(0, NOISE_MM, sides.shape)
    sigma = np.full(sides.shape[2], NOISE_MM)
    return EdgeObservation.from_edges([(left, sigma, right, sigma) for left, right in noisy])


def experiment(observed: EdgeObservation, beam: Specimen = BEAM, **stated: float) -> Experiment:
    # Return an experiment with the measured edges and the dimensions of `beam`.
    # stated : standard uncertainties of the inputs, by name
    stated_sources = tuple(
        StatedSource(source.replace("_", "-"), size, "specimen 1") for source, size in stated.items()
    )
    return Experiment(BeamModel(beam), LOADS, observed, stated=stated_sources)


def fitted(*experiments: Experiment, free: tuple[NuisancePrior, ...] = ()) -> Estimate:
    # Return the result of a neo-Hookean fit to these experiments, which starts near the optimum.
    return estimated("neo-hookean", *experiments, free=free)


def estimated(law: str, *seen_so: Experiment, free: tuple[NuisancePrior, ...] = ()) -> Estimate:
    # Return the result of a fit that starts at a modulus 10 % too large; `law` is the law of the material.
    return refined(law, seen_so, 1.1 * TRUTH_PA, free=free).estimate


def holds(interval: tuple[float, float] | None, value: float) -> bool:
    assert interval is not None
    return interval[0] <= value <= interval[1]


def half_width(fit: Estimate) -> float:
    low, high = fit.initial_shear_modulus.interval_95
    return 0.5 * (high - low)


THICKER = replace(BEAM, width_mm=3.03)


@pytest.fixture(scope="module")
def thicker() -> Estimate:
    # The result of a fit whose beam is wider than its file says, by 1.5 standard uncertainties.
    return identify("neo-hookean", [experiment(noisy_edges(THICKER), width=0.02)])


@pytest.fixture(scope="module")
def magnetic() -> Estimate:
    # The result of a fit with an uncertainty of 2 % of the magnetic moment.
    return fitted(experiment(noisy_edges(), remanence=0.02))


def test_the_interval_contains_the_truth_with_a_wrong_width_and_the_noise_interval_does_not(thicker):
    fit, modulus = thicker, thicker.initial_shear_modulus
    assert holds(modulus.interval_95, TRUTH_PA)
    assert not holds(modulus.interval_95_fit, TRUTH_PA)
    (entry,) = fit.budget
    assert (entry.source, entry.standard_uncertainty, entry.unit) == ("width", 0.02, "mm")
    # A fit with the true width gives the true modulus; the difference comes from 0.03 mm of the width.
    informed = fitted(experiment(noisy_edges(THICKER), beam=THICKER))
    error_percent = 100 * (modulus.value / informed.initial_shear_modulus.value - 1)
    assert entry.effect_percent == pytest.approx(abs(error_percent) * 2 / 3, rel=0.1)
    assert half_width(fit) == pytest.approx(1.96 * modulus.value * entry.effect_percent / 100, rel=0.15)
    low, high = fit.measure_next.initial_shear_modulus_interval_95_Pa
    assert fit.measure_next.source == "width"
    assert high - low == pytest.approx(half_width(fit), rel=0.15)


@pytest.mark.parametrize(
    ("source", "size", "hidden"),
    [
        ("scale", 0.003, {"scale": 1.0045}),
        ("remanence", 0.02, {"beam": replace(BEAM, magnet=replace(MAGNET, remanence_T=1.17))}),
    ],
)
def test_the_interval_contains_the_truth_with_a_wrong_scale_and_moment(source, size, hidden):
    modulus = fitted(experiment(noisy_edges(**hidden), **{source: size})).initial_shear_modulus
    assert holds(modulus.interval_95, TRUTH_PA)
    assert not holds(modulus.interval_95_fit, TRUTH_PA)


SHORT = ("scale", "depth")


@pytest.mark.parametrize(
    "source",
    [
        *SHORT,
        *(
            pytest.param(key, marks=pytest.mark.slow)
            for key, source_entry in SOURCES.items()
            if source_entry.stated_in and key not in (*SHORT, "stand-off", "tilt", "magnet-offset")
        ),
    ],
)
def test_the_effect_of_a_source_on_the_modulus_agrees_with_a_refit(source):
    size = SOURCES[source].usual
    observed = noisy_edges()
    fit = fitted(experiment(observed, **{source.replace("-", "_"): size}))
    parts = len(SOURCES[source].parts)
    moved = []
    for part in range(parts):
        deviation = size * np.eye(parts)[part]
        other = experiment(observed).under({source: deviation})
        if image := SOURCES[source].image:
            linear, shift = image(deviation[None])
            places = (observed.points_mm - shift[0]) @ np.linalg.inv(linear[0]).T
            other = replace(other, observed=replace(observed, points_mm=places))
        if field := SOURCES[source].field:
            factor = float(field(deviation[None])[0])
            other = replace(other, loads=replace(other.loads, field_T=factor * other.loads.field_T))
        moved.append(100 * (fitted(other).initial_shear_modulus.value / fit.initial_shear_modulus.value - 1))
    (entry,) = fit.budget
    assert entry.effect_percent == pytest.approx(float(np.linalg.norm(moved)), rel=0.2, abs=0.01)


def test_datasets_of_one_specimen_share_its_error_and_two_specimens_do_not(magnetic):
    first, second = noisy_edges(seed=1), noisy_edges(seed=2)
    both = fitted(experiment(first, remanence=0.02), experiment(second, remanence=0.02))
    other = replace(experiment(second), stated=(StatedSource("remanence", 0.02, "specimen 2"),))
    apart = fitted(experiment(first, remanence=0.02), other)
    assert [entry.datasets for entry in both.budget] == [(0, 1)]
    assert sorted(entry.datasets for entry in apart.budget) == [(0,), (1,)]
    assert half_width(both) == pytest.approx(half_width(magnetic), rel=0.05)
    assert half_width(apart) == pytest.approx(half_width(magnetic) / np.sqrt(2), rel=0.1)


def test_an_estimated_width_has_its_given_uncertainty_as_the_prior():
    fit = fitted(experiment(noisy_edges(THICKER), width=0.02, remanence=0.02), free=(NuisancePrior("width"),))
    (freed,) = fit.freed
    assert (freed.name, freed.prior_standard_deviation, freed.deviation.unit) == ("width", 0.02, "mm")
    assert freed.deviation.value == pytest.approx(0.03, abs=2e-3)
    assert fit.initial_shear_modulus.value == pytest.approx(TRUTH_PA, rel=0.005)
    assert [entry.source for entry in fit.budget] == ["remanence"]
    with pytest.raises(ValueError, match="depth: dataset 0 gives no standard uncertainty"):
        fitted(experiment(noisy_edges()), free=(NuisancePrior("depth"),))


def test_without_uncertain_inputs_the_interval_is_that_of_the_noise(thicker):
    fit = fitted(experiment(noisy_edges(), width=0.0))
    modulus = fit.initial_shear_modulus
    assert fit.budget == ()
    assert modulus.interval_95 == modulus.interval_95_fit
    assert fit.measure_next.source is None
    # The edges of a thicker beam cause residuals along both edges that are not noise.
    wrong = thicker.initial_shear_modulus
    assert wrong.interval_95_fit is not None
    assert modulus.interval_95_fit is not None
    assert np.ptp(wrong.interval_95_fit) < 3 * np.ptp(modulus.interval_95_fit)


def test_intervals_are_the_quantiles_of_the_draws(magnetic):
    drawn, remanence = magnetic.draws.column("mu"), magnetic.draws.column("remanence")
    assert np.quantile(drawn, [0.025, 0.975]) == pytest.approx(magnetic.parameters["mu"].interval_95)
    assert np.std(remanence) == pytest.approx(0.02, rel=0.1)
    # A magnet stronger than in the file needs a stiffer beam for the same edges.
    assert np.corrcoef(drawn, remanence)[0, 1] > 0.99


@pytest.mark.parametrize("off_mm", [0.2, -0.2])
def test_a_source_that_drives_a_parameter_to_a_bound_widens_the_interval_to_the_truth(off_mm):
    # The length is wrong by two standard uncertainties; the parameter at the bound is C01 / (C10 + C01).
    longer = replace(BEAM, length_mm=BEAM.length_mm + off_mm)
    edges = noisy_edges(longer, law="mooney-rivlin", parameters=(0.4 * TRUTH_PA, 0.1 * TRUTH_PA))
    stated = {"length": 0.1, "width": 0.02, "remanence": 0.01, "magnet_length": 0.03, "scale": 0.001}
    estimate = estimated("mooney-rivlin", experiment(edges, **stated))
    informed = estimated("mooney-rivlin", experiment(edges, longer, **stated))
    assert len(estimate.identifiability.at_bound) == 1
    assert informed.identifiability.at_bound == ()
    # Draws with the hidden error of the length have the modulus of a fit that knows this error.
    modulus = np.log(2 * (estimate.draws.column("C10") + estimate.draws.column("C01")))
    drawn = [estimate.draws.column(name) for name in ("length", "width", "remanence", "magnet's length", "scale")]
    level, slope, *_ = np.linalg.lstsq(np.column_stack([np.ones_like(modulus), *drawn]), modulus, rcond=None)[0]
    before, after = estimate.initial_shear_modulus.value, informed.initial_shear_modulus.value
    assert level + slope * off_mm - np.log(before) == pytest.approx(np.log(after / before), rel=0.12)
    assert holds(estimate.initial_shear_modulus.interval_95, after)


def test_a_misfit_of_the_law_at_a_bound_is_not_attributed_to_the_sources():
    # The length is right, and a Mooney-Rivlin fit to a Yeoh material drives C01 / (C10 + C01) to a bound.
    edges = noisy_edges(law="yeoh", parameters=(0.5 * TRUTH_PA, -0.8 * TRUTH_PA, TRUTH_PA))
    estimate = estimated("mooney-rivlin", experiment(edges, length=0.002))
    assert len(estimate.identifiability.at_bound) == 1
    modulus = estimate.initial_shear_modulus
    assert modulus.interval_95_fit is not None
    assert holds(modulus.interval_95, modulus.value)
    assert modulus.interval_95 == pytest.approx(modulus.interval_95_fit, abs=0.3 * np.ptp(modulus.interval_95_fit))


@pytest.mark.parametrize(
    ("law", "parameters"),
    [
        ("neo-hookean", (TRUTH_PA,)),
        pytest.param("yeoh", (0.5 * TRUTH_PA, 0.4 * TRUTH_PA, 0.0), marks=pytest.mark.slow),
    ],
)
def test_a_wrong_width_favours_no_law(law, parameters):
    # The residuals are ten times the noise, and larger than the differences between the laws.
    wrong = replace(BEAM, width_mm=3.03, length_mm=30.15)
    edges = experiment(noisy_edges(wrong, law=law, parameters=parameters), length=0.1, width=0.02, remanence=0.01)
    estimates = {model: estimated(model, edges) for model in ("neo-hookean", "mooney-rivlin", "yeoh")}
    identifiability = estimates[law].identifiability
    assert identifiability.noise_mm == pytest.approx(NOISE_MM, rel=0.15)
    assert identifiability.residual_mm > 5 * NOISE_MM
    assert identifiability.stated_squares == pytest.approx(2 * 1.5**2, rel=0.3)
    assert estimates[law].held_out_error_mm == pytest.approx(NOISE_MM, rel=0.2)
    choices = choose(
        [
            Candidate(
                model,
                len(estimate.identifiability.names),
                ((estimate.identifiability.noise_points, estimate.identifiability.noise_mm),),
                stated_squares=estimate.identifiability.stated_squares,
            )
            for model, estimate in estimates.items()
        ]
    )
    weights = {choice.model: choice.weight for choice in choices}
    if law == "yeoh":
        assert weights[law] > 0.9
    else:
        assert weights[law] > 0.3  # the other laws contain this law and do not fit better


def test_datasets_of_one_specimen_are_compared_with_one_error_of_its_width():
    # One beam is wider and one narrower than the file says: only two separate errors of the width explain this.
    beams = [replace(BEAM, width_mm=3.0 + off) for off in (0.03, -0.03)]
    one, other = (experiment(noisy_edges(beam, seed=seed), width=0.02) for seed, beam in enumerate(beams, 1))
    apart = replace(other, stated=(StatedSource("width", 0.02, "specimen 2"),))
    shared, told_apart = (estimated("neo-hookean", one, second).identifiability for second in (other, apart))
    assert told_apart.noise_mm == pytest.approx(NOISE_MM, rel=0.15)
    assert told_apart.stated_squares == pytest.approx(2 * 1.5**2, rel=0.3)
    assert shared.noise_mm is not None
    assert shared.noise_mm > 5 * NOISE_MM
    assert shared.stated_squares < 0.5


def test_tracked_points_at_the_tip_stay_valid_on_a_shorter_beam():
    strip = Specimen(30.0, 3.0, 10.0, 1070.0, "plane-stress")
    model, loads = BeamModel(strip), Loads.along([0.0], gravity_angle_deg=90.0, tip_force_N=[0.002])
    rest = np.column_stack([np.linspace(10, 30, 5), np.zeros(5)])
    moved = model.positions(model.solve(LAWS["neo-hookean"], np.array([[TRUTH_PA]]), loads), rest)[0]
    tracked = PointObservation(rest[None], moved, np.full((1, 5), 0.01))
    shorter = Experiment(model, loads, tracked).under({"length": np.array([-0.5])})
    assert shorter.model.specimen.length_mm == 29.5
    assert isinstance(shorter.observed, PointObservation)
    step = shorter.observed.moved_mm - shorter.observed.rest_mm
    assert step == pytest.approx(moved - rest, abs=1e-12)
    assert shorter.observed.rest_mm.max() == pytest.approx(29.5)


@pytest.mark.parametrize(("source", "part", "size"), [("taper", 0, 20.0), ("rest-shape", 2, 60.0)])
def test_the_effect_of_an_error_that_no_beam_can_have_is_that_of_a_smaller_error(
    source: str, part: int, size: float
) -> None:
    candidate = considered.Candidate(LAWS["neo-hookean"], np.array([[TRUTH_PA]]))
    small = 0.02
    large, expected = considered.changes_by(
        candidate, experiment(noisy_edges()), [(source, part, size), (source, part, small)]
    )
    assert large is not None
    assert expected is not None
    assert np.linalg.norm(large) == pytest.approx(size / small * np.linalg.norm(expected), rel=0.25)

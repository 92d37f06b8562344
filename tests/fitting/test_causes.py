"""The likely cause of the residuals of a fit, such as a tilted camera, is found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eimi_fitting.beam.coil_field import CoilShape
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.outline import edge_curves, points_on
from eimi_fitting.beam.rest_modes import with_modes
from eimi_fitting.beam.specimen import Magnet, Specimen
from eimi_fitting.inference.doubts.cause_doubts import rivals
from eimi_fitting.inference.doubts.causes import NONE, Cause
from eimi_fitting.inference.doubts.collinear_causes import classes, shared_equally
from eimi_fitting.inference.doubts.marginal_likelihood import weigh
from eimi_fitting.inference.doubts.possible_causes import Assumed, PossibleCause
from eimi_fitting.inference.doubts.table_of_causes import POSSIBLE_CAUSES
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation, PointObservation
from eimi_fitting.inference.evidence.parameter_priors import Prior
from eimi_fitting.inference.evidence.sources import StatedSource, loads_under, specimen_under
from eimi_fitting.inference.evidence.unknowns import Setup
from eimi_fitting.inference.identification.fit import Fit
from eimi_fitting.inference.identification.whole_fit import identify
from eimi_fitting.inference.searching.measured_rest_shape import measured_rest_shape
from eimi_fitting.laws import LAWS

TRUTH_PA = 46e3
NOISE_MM = 2e-3
MAGNET = Magnet(4.0, 3.0, 2.0, 1.2, 7500.0)
BEAM = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-stress", MAGNET)
FIELDS_MT = np.array([0.0, 2.3, 4.7, 7.0, 4.7, 2.3, 0.0, -2.3, -4.7, -7.0])
LOADS = Loads.along(FIELDS_MT)
CREEP = 1 - 0.1 * np.linspace(0, 1, len(FIELDS_MT))
NOTHING = Setup.of((), 1)


def fit_of(
    specimen: Specimen = BEAM,
    loads: Loads = LOADS,
    setup: Setup = NOTHING,
    stiffness: np.ndarray | float = 1.0,
    stated: tuple[StatedSource, ...] = (),
    seen: Callable[[np.ndarray], np.ndarray] = lambda places: places,
    is_rest_measured: bool = False,
    last: int | None = -2,
) -> Fit:
    # Return a fit that assumes the usual beam and camera, to simulated edges of a different beam or camera.
    # specimen, loads, setup : true beam, loads and errors of the camera
    # stiffness : true stiffness relative to the usual one, for all load steps or for each
    # stated : standard uncertainties in the files
    # seen : function from true positions to positions in the picture
    # is_rest_measured : whether the fit uses the measured shape without a field
    # last : last point used on each edge; None for all points
    model = BeamModel(specimen, 40, 4)
    moduli = np.unique(TRUTH_PA * np.broadcast_to(stiffness, len(loads)))
    shapes = model.solve(LAWS["neo-hookean"], moduli[:, None], loads)
    row = np.searchsorted(moduli, TRUTH_PA * np.broadcast_to(stiffness, len(loads)))
    sides = points_on(edge_curves(model, shapes)[row, np.arange(len(loads))], 2)[:, :, 4:last]
    noisy = seen(setup.imaged(sides)) + np.random.default_rng(1).normal(0, NOISE_MM, sides.shape)
    observed = EdgeObservation(noisy, np.full(noisy.shape[:3], NOISE_MM))
    experiment = Experiment(BeamModel(BEAM).refined(), LOADS, observed, stated=stated)
    shape = measured_rest_shape(experiment) if is_rest_measured else None
    return identify("neo-hookean", [shape.applied(experiment) if shape else experiment])


@pytest.mark.parametrize(
    ("name", "value", "wrong"),
    [
        (NONE, 0.0, {}),
        pytest.param("roll", 1.0, {"setup": Setup.of([("roll", 0, 1.0)], 1)}, marks=pytest.mark.slow),
        pytest.param("width", -0.05, {"specimen": replace(BEAM, width_mm=2.95)}, marks=pytest.mark.slow),
        pytest.param("rest_shape", 1.0, {"specimen": with_modes(BEAM, (1.0,))}, marks=pytest.mark.slow),
        ("field_gradient", -1.8, {"loads": replace(LOADS, coil=CoilShape((0.0, 1.0), curvature_per_m2=-90.0))}),
        ("creep", 0.1, {"stiffness": CREEP}),
    ],
)
def test_the_only_error_of_a_bench_is_the_most_probable_cause(name, value, wrong):
    fit = fit_of(**wrong)
    first = fit.causes[0]
    assert first.name == name
    assert first.probability > 0.8
    assert first.value == pytest.approx(value, rel=0.1)
    if name != NONE:
        corrected = fit.initial_shear_modulus.value * (1 + 0.01 * first.shift_percent)
        assert corrected == pytest.approx(TRUTH_PA, rel=0.02)
        low, high = fit.initial_shear_modulus.interval_95
        assert low <= corrected <= high
        assert high - low < 4 * abs(corrected - fit.initial_shear_modulus.value) + 0.01 * TRUTH_PA
        (doubt,) = (doubt for doubt in fit.doubts if doubt.kind == "cause")
        least, most = doubt.modulus_percent
        assert least <= first.shift_percent <= most or most - least < 0.1
        assert doubt.short.endswith("%")


def _possible(name: str) -> PossibleCause:
    return next(cause for cause in POSSIBLE_CAUSES if cause.name == name)


def test_the_cause_taper_undoes_both_measured_modes_of_the_width():
    measured = with_modes(BEAM, (), (0.02, 0.015))
    observed = EdgeObservation(np.zeros((len(LOADS), 2, 3, 2)), np.full((len(LOADS), 2, 3), NOISE_MM))
    experiment = Experiment(BeamModel(measured), LOADS, observed)
    assumed = Assumed(LAWS["neo-hookean"], np.array([[TRUTH_PA]]), None, experiment)
    stated = _possible("taper").change(assumed, -np.array([0.04, 0.0225])).with_errors.model.specimen
    widths = np.array(stated.rest_shape.widths)[:, 1]
    assert widths == pytest.approx(np.zeros(len(widths)), abs=1e-12)


def test_a_magnet_whose_moment_points_out_of_the_picture_makes_the_beam_wider_toward_its_tip():
    along, half = np.linspace(2.0, 24.0, 12), 0.5 * BEAM.width_mm
    sides = np.stack([np.stack([along, np.full(12, y)], axis=-1) for y in (-half, half)])
    field_mT = 0.02  # a weak field: the beam stays straight
    observed = EdgeObservation(np.tile(sides, (2, 1, 1, 1)), np.full((2, 2, 12), NOISE_MM))
    experiment = Experiment(BeamModel(BEAM), Loads.along([0.0, field_mT], gravity_angle_deg=None), observed)
    assumed = Assumed(LAWS["neo-hookean"], np.array([[TRUTH_PA]]), None, experiment)
    changed = _possible("magnetisation_out_of_plane").change(assumed, np.array([3.0])).experiment.observed.points_mm
    twist_per_m = np.radians(3.0) * MAGNET.moment_A_m2 * 1e-3 * field_mT / (TRUTH_PA * 28.2e-12)  # J of 3 x 5 mm
    assert changed[0] == pytest.approx(sides, abs=1e-12)
    narrower = half - changed[1, :, :, 1] * [[-1], [1]]
    assert narrower == pytest.approx(np.tile(0.5 * BEAM.depth_mm * 1e-3 * twist_per_m * along, (2, 1)), rel=0.06)


@given(
    share=st.floats(-0.02, 0.02).filter(lambda share: abs(share) > 1e-3),
    x=st.floats(-1.5, 1.5),
    y=st.floats(-1.0, 1.0),
    seed=st.integers(0, 1000),
)
def test_a_distortion_about_a_displaced_lens_axis_is_exact_and_leaves_no_scale(share, x, y, seed):
    true = np.random.default_rng(seed).uniform([0, -8], [30, 12], (2, 2, 9, 2))
    used = true.reshape(-1, 2)
    centre = 0.5 * (used.min(axis=0) + used.max(axis=0))
    farthest_mm = np.sqrt(((used - centre) ** 2).sum(axis=1).max())
    axis = centre + farthest_mm * np.array([x, y])

    def by(places):
        from_axis = (places - axis) / farthest_mm
        return farthest_mm * share * (from_axis**2).sum(axis=-1, keepdims=True) * from_axis

    experiment = Experiment(BeamModel(BEAM), LOADS.take(np.arange(2)), EdgeObservation(true, np.full((2, 2, 9), 0.1)))
    assumed = Assumed(LAWS["neo-hookean"], np.array([[TRUTH_PA]]), None, experiment)
    amplitudes = np.array([share, share * x, share * y, *by(np.zeros(2))])
    changed = _possible("distortion").change(assumed, amplitudes).experiment.observed.points_mm
    assert changed == pytest.approx(true - by(true), abs=1e-12)


def test_a_cause_has_the_same_effect_on_the_modulus_with_and_without_a_stated_uncertainty():
    # The pictures are 1 % too large.
    strip = Specimen(30.0, 3.0, 10.0, 1070.0, section="plane-stress")
    model = BeamModel(strip)
    loads = Loads.along([0.0] * 4, 0.0, 0.0, [0.001, 0.002, 0.004, -0.003], tip_force_angle_deg=90.0)
    rest = np.column_stack([np.linspace(6, 30, 9), np.zeros(9)])
    true = model.positions(model.solve(LAWS["neo-hookean"], np.array([[46e3]]), loads), rest)[0]
    moved = 1.01 * true + np.random.default_rng(1).normal(0, 0.05, true.shape)
    observed = PointObservation(np.tile(rest, (4, 1, 1)), moved, np.full((4, 9), 0.05))
    shifts = []
    for stated in ((), (StatedSource("scale", 0.006, "a scale"),)):
        fit = identify("neo-hookean", [Experiment(model, loads, observed, stated=stated)], seed=1)
        causes = {cause.name: cause.shift_percent for cause in fit.causes}
        shifts.append([causes["scale"], causes["distance"]])
    assert shifts[1] == pytest.approx(shifts[0], abs=0.1)
    assert shifts[0][0] < -0.2


@pytest.mark.parametrize(
    ("law", "priors", "scale_percent", "clamp_percent"),
    [
        ("neo-hookean", (), -0.2, 3.7),
        ("mooney-rivlin", (), -0.2, 3.7),  # its two parameters are not determined separately
        ("neo-hookean", (Prior("mu", 46e3, 20.0),), 0.0, 0.0),  # the prior determines the modulus
    ],
)
def test_two_inputs_with_stated_uncertainties_have_their_own_effects_on_the_modulus(
    law, priors, scale_percent, clamp_percent
):
    # The pictures are 1 % too large, and the clamp is 0.25 mm from its stated place. Fits to corrected points change
    # the modulus of both laws by -1.5 to -1.9 % and by 3.7 to 3.9 %.
    strip = Specimen(30.0, 3.0, 10.0, 1070.0, section="plane-stress")
    model = BeamModel(strip)
    loads = Loads.along([0.0] * 4, 0.0, 0.0, [0.001, 0.002, 0.004, -0.003], tip_force_angle_deg=90.0)
    rest = np.column_stack([np.linspace(6, 30, 9), np.zeros(9)])
    true = model.positions(model.solve(LAWS["neo-hookean"], np.array([[46e3]]), loads), rest)[0]
    moved = 1.01 * true + [0.0, 0.25] + np.random.default_rng(1).normal(0, 0.05, true.shape)
    observed = PointObservation(np.tile(rest, (4, 1, 1)), moved, np.full((4, 9), 0.05))
    stated = (StatedSource("scale", 0.006, "a scale"), StatedSource("clamp", 0.15, "a clamp"))
    fit = identify(law, [Experiment(model, loads, observed, stated=stated)], seed=1, priors=priors)
    causes = {cause.name: cause.shift_percent for cause in fit.causes}
    assert causes["scale"] == pytest.approx(scale_percent, abs=0.15)
    assert causes["clamp_offset"] == pytest.approx(clamp_percent, abs=0.15)


@pytest.mark.slow
def test_a_distortion_is_found_alone_although_a_picture_at_rest_shows_a_bulge_of_the_beam():
    centre = np.array([15.0, 5.0])

    def seen(places):
        from_centre = places - centre
        return centre + from_centre * (1 + 0.01 * (from_centre**2).sum(axis=-1, keepdims=True) / 20.0**2)

    fit = fit_of(seen=seen, is_rest_measured=True)
    assert fit.causes[0].name == "distortion"
    assert max((cause.probability for cause in fit.causes[1:]), default=0.0) < 0.1


@pytest.mark.slow
def test_two_causes_are_found_although_one_of_them_bends_the_beam_at_rest():
    # Alone, a field along the beam explains most of the weak moment, so that a pair needs an exact comparison.
    weak = replace(LOADS, field_T=0.97 * LOADS.field_T + np.array([0.0, 5e-5]))
    fit = fit_of(loads=weak, is_rest_measured=True)
    assert {cause.name for cause in fit.causes[:2]} == {"moment", "background_field"}


def test_an_error_that_the_fit_has_estimated_is_the_cause_and_gives_no_doubt():
    tilted = replace(BEAM, magnet=replace(MAGNET, magnetisation_angle_deg=3.0))
    fit = fit_of(tilted, stated=(StatedSource("magnetisation-angle", 3.0, "specimen"),))
    assert fit.causes[0].name == "magnetisation_angle"
    assert fit.causes[0].value == pytest.approx(3.0, abs=0.2)
    assert [doubt for doubt in fit.doubts if doubt.kind == "cause"] == []


@pytest.mark.parametrize("size", [pytest.param(0.01, marks=pytest.mark.slow), 0.03])
def test_a_wrong_distance_cannot_be_distinguished_from_a_wrong_scale(size):
    fit = fit_of(setup=Setup.of([("scale", 0, size)], 1))
    first, second = fit.causes[:2]
    assert {first.name, second.name} == {"scale", "distance"}
    assert first.like == (second.name,)
    assert first.probability == pytest.approx(second.probability, abs=0.02)
    assert first.probability < 0.9
    (doubt,) = (doubt for doubt in fit.doubts if doubt.kind == "cause")
    assert "cannot be told apart" in doubt.words


def test_points_that_are_seen_beyond_the_tip_do_not_decide_between_scale_and_distance():
    # The distance of a point from an edge has a kink at the end of the edge.
    fit = fit_of(setup=Setup.of([("scale", 0, 0.01)], 1), last=None)
    first, second = fit.causes[:2]
    assert {first.name, second.name} == {"scale", "distance"}
    assert first.probability == pytest.approx(second.probability, abs=0.02)
    assert first.like == (second.name,)


@pytest.mark.slow
def test_a_strong_stiffening_is_another_law_and_nothing_else():
    law, loads = LAWS["yeoh"], Loads.along(FIELDS_MT[:4])
    model = BeamModel(BEAM, 40, 4)
    shapes = model.solve(law, np.array([[7e3, 14e3, 14e3]]), loads)
    sides = points_on(edge_curves(model, shapes)[0], 2)[:, :, 4:-2]
    noisy = sides + np.random.default_rng(1).normal(0, NOISE_MM, sides.shape)
    observed = EdgeObservation(noisy, np.full(noisy.shape[:3], NOISE_MM))
    fit = identify("neo-hookean", [Experiment(BeamModel(BEAM).refined(), loads, observed)])
    first, *others = fit.causes
    assert first.name == "law"
    assert first.value == pytest.approx(14e3 / (2 * 7e3), rel=0.1)
    assert max(cause.probability for cause in others) < 0.1
    corrected = fit.initial_shear_modulus.value * (1 + 0.01 * first.shift_percent)
    assert corrected == pytest.approx(2 * 7e3, rel=0.01)


def test_collinear_causes_share_their_probability_and_others_do_not():
    rng = np.random.default_rng(0)
    one, other = 20 * rng.normal(size=(2, 60))
    explained = np.stack([0 * one, one, one + 0.1 * rng.normal(size=60), other, one])
    evidence = np.array([3.0, 0.0, 2.0, 1.0])
    groups = classes(-explained, [1, 1, 1, 1], evidence, np.array([False, False, False, True]))
    assert sorted(groups) == [(0, 1), (2,), (3,)]
    hypotheses = [(), (0,), (1,), (2,), (3,), (0, 2), (1, 2), (0, 1)]
    score = rng.normal(size=8)
    is_uncertain = np.array([False] * 8)
    shared = shared_equally(score, hypotheses, is_uncertain, groups)
    assert np.logaddexp.reduce(shared) == pytest.approx(np.logaddexp.reduce(score))
    assert shared[1] == shared[2]
    assert shared[5] == shared[6]
    assert shared[[0, 3, 4, 7]] == pytest.approx(score[[0, 3, 4, 7]])
    is_uncertain[2] = True  # the inputs of this hypothesis deviate, those of the other ones do not
    assert shared_equally(score, hypotheses, is_uncertain, groups)[:4] == pytest.approx(score[:4])


@given(seed=st.integers(0, 10_000), true=st.integers(0, 4), size=st.floats(0.5, 3.0))
def test_residuals_of_one_cause_and_noise_have_the_largest_evidence_for_that_cause(seed, true, size):
    rng = np.random.default_rng(seed)
    columns = np.concatenate(
        [rng.normal(size=(6, 60)), np.zeros((1, 60))]
    )  # the law, five causes, and a column without effect
    y = 2.0 * columns[0] + size * columns[1 + true] + 0.1 * rng.normal(size=60)
    members = np.array([[0, 6], *([0, 1 + cause] for cause in range(5))])
    posterior = weigh(columns, members, np.tile(y, (6, 1)), np.full(60, 0.01), np.ones(60))
    assert np.argmax(posterior.log_evidence) == 1 + true
    assert posterior.means[1 + true, 1 + true] == pytest.approx(size, abs=0.1)


def test_the_evidence_is_the_normal_density_of_the_residuals():
    rng = np.random.default_rng(0)
    columns = np.concatenate([rng.normal(size=(2, 8)), np.zeros((1, 8))])
    y, noise = rng.normal(size=(1, 8)), rng.uniform(0.5, 2.0, 8)
    posterior = weigh(columns, np.array([[0, 1]]), y, noise, np.zeros(8))  # no error without a name, for any eta
    covariance = np.diag(noise) + columns.T @ columns
    expected = -0.5 * (y[0] @ np.linalg.solve(covariance, y[0]) + np.linalg.slogdet(covariance)[1])
    assert posterior.log_evidence[0] == pytest.approx(expected)


def _turned_field(degrees: float) -> Loads:
    return loads_under(LOADS, {"field": np.array([degrees])})


# The direction of magnetisation is exact, so that it does not explain a wrong direction of the field.
_EXACT = StatedSource("magnetisation-angle", 0.0, "specimen")


def test_a_direction_of_the_field_within_its_stated_uncertainty_is_no_error_of_the_bench():
    stated = (_EXACT, StatedSource("field", 0.5, "calibration"), StatedSource("width", 0.02, "specimen"))
    fit = fit_of(loads=_turned_field(0.5), stated=stated)
    assert [cause.name for cause in fit.causes if cause.probability > 0.1 and cause.name != NONE] in (
        [],
        ["field_direction"],
    )
    assert all(cause.is_within_stated for cause in fit.causes if cause.name == "field_direction")
    assert fit.doubts == ()


def test_a_direction_of_the_field_that_no_file_states_is_the_cause():
    fit = fit_of(loads=_turned_field(3.0), stated=(_EXACT,))
    first, second = fit.causes[:2]
    assert {first.name, second.name} == {"field_direction", "magnetisation_angle"}
    assert first.like == (second.name,)
    assert {cause.name: cause.value for cause in (first, second)} == {
        "field_direction": pytest.approx(3.0, rel=0.1),
        "magnetisation_angle": pytest.approx(-3.0, rel=0.1),
    }
    (doubt,) = (doubt for doubt in fit.doubts if doubt.kind == "cause")
    assert "cannot be told apart" in doubt.words


def test_several_deviations_within_their_stated_uncertainties_are_no_wrong_cause():
    # Together they look like other errors if at most two of them are allowed.
    deviations = {
        "width": np.array([0.02]),
        "remanence": np.array([-0.02]),
        "offset": np.array([0.02]),
        "axis": np.array([0.1]),
        "field": np.array([0.5]),
        "clamp": np.array([0.02, -0.02]),
    }
    stated = tuple(StatedSource(source, float(abs(value[0])), "bench") for source, value in deviations.items())
    seen = Setup.of([("axis", 0, 0.1), ("clamp", 0, 0.02), ("clamp", 1, -0.02)], 1)
    loads = loads_under(LOADS, deviations)
    fit = fit_of(specimen_under(BEAM, deviations), loads, seen, stated=(*stated, _EXACT))
    named = {cause.name: cause.value for cause in fit.causes if cause.probability > 0.9 and cause.name != NONE}
    true = {"width": 0.02, "moment": -0.02 / 1.2, "background_field": 0.02, "field_direction": 0.5, "clamp_angle": 0.1}
    for name, value in named.items():
        assert value == pytest.approx(true.get(name, 0.0), rel=0.5)
    assert all(cause.is_within_stated for cause in fit.causes if cause.name in named)
    assert [doubt for doubt in fit.doubts if doubt.kind in ("cause", "beyond_noise")] == []


def test_evidence_and_means_do_not_depend_on_which_coefficients_are_common():
    rng = np.random.default_rng(3)
    columns = np.concatenate([rng.normal(size=(5, 30)), np.zeros((1, 30))])
    noise, error = rng.uniform(0.5, 2.0, 30), rng.uniform(0.5, 2.0, 30)
    y = rng.normal(size=(2, 30))
    # The coefficients 0 and 1 are common at the beginning, or in another order and not common at the beginning.
    together = weigh(columns, np.array([[0, 1, 2, 3], [0, 1, 4, 5]]), y, noise, error)
    apart = weigh(columns, np.array([[2, 0, 3, 1], [0, 4, 1, 5]]), y, noise, error)
    for name in ("log_evidence", "means", "squares", "error_squared"):
        np.testing.assert_allclose(getattr(together, name), getattr(apart, name), atol=1e-10)


def test_rivals_share_one_probability_and_causes_together_do_not():
    def cause(name: str, probability: float) -> Cause:
        return Cause(name, probability, 1.0, "mm", 1.0, "")

    alone, other, small = cause("scale", 0.6), cause("distance", 0.4), cause("roll", 0.01)
    assert rivals([alone, other, small]) == (other,)
    collinear = replace(alone, like=("roll",))
    assert rivals([collinear, other, small]) == (small,)
    assert rivals([cause("scale", 1.0), cause("roll", 0.99)]) == ()

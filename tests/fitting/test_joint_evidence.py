"""One fit can use edges, tracked points, tensile curves and several specimens, and can estimate uncertain inputs."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.specimen import Magnet, Specimen
from eimi_fitting.inference.doubts.checks import NotExplained
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation, PointObservation, edge_curves, points_on
from eimi_fitting.inference.evidence.tensile_curves import TensileCurve
from eimi_fitting.inference.evidence.unknowns import NuisancePrior
from eimi_fitting.inference.identification.whole_fit import identify
from eimi_fitting.inference.searching.named_causes import NamedCause
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.tensile import engineering_stress
from tests.shared.estimates import refined

SPECIMEN = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-strain", Magnet(4.0, 3.0, 2.0, 1.2, 7500.0))
NOISE_MM = 3e-3


def edges_of(
    model: str,
    parameters: list[float],
    *,
    gravity: float | None = 0.0,
    field_factor: float = 1.0,
    field_mT: tuple[float, ...] = (0.0, 4.0, 7.0),
    turned_deg: float = 0.0,
) -> Experiment:
    # Return a simulated experiment: noisy edges of a beam with a known law.
    # gravity : direction of gravity in the beam frame (degrees); None without gravity
    # field_factor : true field divided by the field in the file
    # turned_deg : roll of the camera (degrees)
    rng = np.random.default_rng(1)
    loads = Loads.along(field_mT, gravity_angle_deg=gravity)
    fine = BeamModel(SPECIMEN, 52, 6)
    shapes = fine.solve(LAWS[model], np.array([parameters]), loads, field_factor=np.array([field_factor]))
    sides = points_on(edge_curves(fine, shapes)[0], 1)[:, :, 1:-1]
    c, s = np.cos(np.radians(turned_deg)), np.sin(np.radians(turned_deg))
    edges = sides @ np.array([[c, s], [-s, c]]) + rng.normal(0, NOISE_MM, sides.shape)
    sigma = np.full(sides.shape[2], NOISE_MM)
    observed = EdgeObservation.from_edges([(left, sigma, right, sigma) for left, right in edges])
    return Experiment(BeamModel(SPECIMEN).refined(), loads, observed)


def relative_width(fit) -> float:
    # Return the half-width of the interval of the modulus divided by the modulus.
    low, high = fit.initial_shear_modulus.interval_95
    return float(0.5 * (high - low) / fit.initial_shear_modulus.value)


def ends(fit) -> list[tuple[float, float]]:
    # Return the lower and upper end of the interval of each parameter.
    return [quantity.interval_95 for quantity in fit.parameters.values()]


def test_a_tensile_curve_separates_c10_from_c01():
    truth = [15e3, 6e3]
    bent = edges_of("mooney-rivlin", truth)
    strain = np.linspace(0.02, 0.6, 30)
    stress = engineering_stress(LAWS["mooney-rivlin"], np.array([truth]), strain)[0]
    curve = TensileCurve(strain, stress + np.random.default_rng(2).normal(0, 200, 30))
    without = refined("mooney-rivlin", [bent], 46e3).estimate
    with_curve = identify("mooney-rivlin", [bent], seed=1, tensile=[curve])
    assert without.identifiability.not_fixed == ("C01/(C10+C01)",)
    assert "determine only 2(C10+C01)" in without.identifiability.statement
    assert without.identifiability.directions[0].words == "2(C10+C01)"
    assert with_curve.identifiability.not_fixed == ()
    assert with_curve.values == pytest.approx(truth, rel=0.05)
    for value, (low, high), (low_before, high_before) in zip(truth, ends(with_curve), ends(without), strict=True):
        assert low < value < high
        assert high - low < 0.1 * (high_before - low_before)
    assert with_curve.curve_rmse_Pa[0] == pytest.approx(200, rel=0.4)


def test_an_unknown_moment_widens_the_modulus_by_its_prior():
    # Without gravity, the data determine only the ratio of modulus and magnetic moment.
    bent = edges_of("neo-hookean", [46e3], gravity=None)
    fixed = refined("neo-hookean", [bent], 50e3).estimate
    freed = identify("neo-hookean", [bent], seed=1, free=[NuisancePrior("moment", 0.02)])
    assert relative_width(fixed) < 2e-3
    assert relative_width(freed) == pytest.approx(1.96 * 0.02, rel=0.15)
    (moment,) = freed.freed
    assert (moment.name, moment.deviation.unit, moment.prior_standard_deviation) == ("moment", "1", 0.02)
    low, high = moment.deviation.interval_95
    assert 0.5 * (high - low) == pytest.approx(1.96 * 0.02, rel=0.1)
    assert freed.identifiability.correlation[0][1] > 0.99
    assert "the data determine their ratio only" in freed.identifiability.statement


def test_with_gravity_the_data_determine_the_magnetic_moment():
    bent = edges_of("neo-hookean", [46e3], field_factor=1.05, field_mT=(0.0, 3.0, 6.0, 9.0))
    taken_for_right = refined("neo-hookean", [bent], 50e3).estimate
    freed = refined("neo-hookean", [bent], 50e3, free=[NuisancePrior("moment", 0.1)]).estimate
    assert taken_for_right.initial_shear_modulus.value < 45e3
    low, high = freed.initial_shear_modulus.interval_95
    assert low < 46e3 < high
    (moment,) = freed.freed
    assert moment.deviation.interval_95[0] < 0.05 < moment.deviation.interval_95[1]
    assert abs(moment.deviation.value - 0.05) < 0.02


def test_roll_and_clamp_are_identified_for_each_dataset_and_the_coil_constant_for_all():
    turned = edges_of("neo-hookean", [46e3], turned_deg=0.2)
    fit = identify("neo-hookean", [turned], seed=1, free=[NuisancePrior("roll", 0.3), NuisancePrior("clamp", 0.05)])
    by_name = {value.name: value for value in fit.freed}
    assert set(by_name) == {"roll", "clamp x", "clamp y"}
    assert by_name["roll"].deviation.value == pytest.approx(0.2, abs=0.02)
    assert abs(by_name["clamp y"].deviation.value) < 0.01
    assert fit.initial_shear_modulus.value == pytest.approx(46e3, rel=0.01)
    assert fit.error_mm.mean() == pytest.approx(NOISE_MM, rel=0.3)
    freed = [NuisancePrior("coil", 0.01), NuisancePrior("roll", 0.3)]
    both = refined("neo-hookean", [turned, turned], 46e3, free=freed).estimate
    assert [(v.name, v.datasets) for v in both.freed] == [
        ("coil constant", (0, 1)),
        ("roll of dataset 0", (0,)),
        ("roll of dataset 1", (1,)),
    ]


def test_edges_and_tracked_points_of_two_specimens_are_fitted_together():
    plain = Specimen(30.0, 3.0, 10.0, 1070.0, "plane-stress")
    loads = Loads.along([0.0, 0.0], 90.0, 90.0, [0.001, 0.002])
    model = BeamModel(plain).refined()
    rest = np.column_stack([np.linspace(5, 29, 9), np.zeros(9)])
    shapes = model.solve(LAWS["neo-hookean"], np.array([[46e3]]), loads)
    moved = model.positions(shapes, rest)[0]
    points = PointObservation(np.tile(rest, (2, 1, 1)), moved, np.full((2, 9), 0.01))
    fit = identify("neo-hookean", [edges_of("neo-hookean", [46e3]), Experiment(model, loads, points)], seed=1)
    assert fit.error_mm.shape == (5,)
    assert fit.initial_shear_modulus.value == pytest.approx(46e3, rel=0.005)
    low, high = fit.initial_shear_modulus.interval_95
    assert low < 46e3 < high


def test_a_free_bulk_modulus_is_reported_as_not_fixed_and_refused_in_plane_stress():
    bent = edges_of("neo-hookean", [46e3])
    fit = identify("neo-hookean", [bent], seed=1, free_bulk=True)
    assert fit.identifiability.not_fixed == ("log10 K/mu",)
    low, high = fit.bulk_modulus.interval_95
    assert low < 0.1 * high
    assert high > 1e8
    low, high = fit.initial_shear_modulus.interval_95
    assert low < 46e3 < high
    flat = replace(bent, model=BeamModel(replace(SPECIMEN, section="plane-stress")))
    with pytest.raises(ValueError, match="only if the section is plane-strain"):
        identify("neo-hookean", [flat], free_bulk=True)


# tests/lab/test_fit_auxiliary.py tests other wrong data.
GARBAGE = {
    "left for right": (lambda p: p[:, ::-1], NotExplained),
    "wrong sign of the field": (lambda p: p[:, ::-1] * [1, -1], NamedCause),
}


@pytest.mark.parametrize("kind", GARBAGE)
def test_edges_that_no_material_explains_are_refused(kind: str):
    change, refusal = GARBAGE[kind]
    good = edges_of("neo-hookean", [46e3])
    points = np.ascontiguousarray(change(good.observed.points_mm))
    bad = replace(good, observed=replace(good.observed, points_mm=points))
    with pytest.raises(refusal, match="no material explains the measured shape of the beam") as raised:
        identify("neo-hookean", [bad], seed=1, most_generations=30)
    assert raised.value.experiment == 0


def test_residuals_far_above_the_stated_noise_are_a_doubt():
    good = edges_of("neo-hookean", [46e3])
    assert identify("neo-hookean", [good], seed=1).doubts == ()
    longer = replace(good, observed=replace(good.observed, points_mm=1.03 * good.observed.points_mm))
    far, scale = identify("neo-hookean", [longer], seed=1).doubts
    assert (far.dataset, far.state) == (scale.dataset, scale.state) == (0, None)
    assert "times the given uncertainty of the measured places" in far.words
    assert scale.words.startswith("these causes of the residuals cannot be told apart: ")
    words = re.search(r"scale of the picture \(\+(\S+) %, probability (\S+),", scale.words)
    assert words
    assert float(words[1]) == pytest.approx(3.0, abs=0.2)
    assert float(words[2]) == pytest.approx(0.5, abs=0.02)  # another cause has the same effect on the edges

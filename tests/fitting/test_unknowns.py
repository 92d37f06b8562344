"""A fit may have unknowns besides the parameters of the law; one entry in a table adds an unknown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.outline import outline
from eimi_fitting.beam.specimen import Magnet, Specimen
from eimi_fitting.beam.view import View
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation, edge_curves, points_on
from eimi_fitting.inference.evidence.sources import SOURCES, Source, StatedSource
from eimi_fitting.inference.evidence.unknowns import NuisancePrior, Setup, freed_number, nuisances, shared
from eimi_fitting.inference.identification.whole_fit import identify
from eimi_fitting.laws import LAWS
from tests.shared.estimates import refined

NOISE_MM = 3e-3


@pytest.fixture
def bent() -> Experiment:
    # A simulated experiment: noisy edges of a beam with a modulus of 46 kPa in three fields.
    magnet = Magnet(length_mm=4.0, width_mm=3.0, depth_mm=2.0, remanence_T=1.2, density_kg_m3=7500.0)
    beam = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-strain", magnet)
    model, loads = BeamModel(beam, 26, 2), Loads.along((0.0, 4.0, 7.0))
    shapes = model.solve(LAWS["neo-hookean"], np.array([[46e3]]), loads)
    sides = points_on(edge_curves(model, shapes)[0], 1)[:, :, 1:-1]
    edges = sides + np.random.default_rng(1).normal(0, NOISE_MM, sides.shape)
    sigma = np.full(sides.shape[2], NOISE_MM)
    observed = EdgeObservation.from_edges([(left, sigma, right, sigma) for left, right in edges])
    return Experiment(BeamModel(beam), loads, observed)


def test_a_new_unknown_needs_only_one_entry_in_the_table(bent: Experiment, monkeypatch: pytest.MonkeyPatch) -> None:
    def magnified(deviation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return (1 + deviation[:, :, None]) * np.eye(2), np.zeros((len(deviation), 2))

    scale = Source(words="magnification", parts=("magnification",), unit="1", largest=0.5, usual=0.01, image=magnified)
    monkeypatch.setitem(SOURCES, "magnification", scale)
    points = 1.01 * bent.observed.points_mm
    larger = replace(bent, observed=replace(bent.observed, points_mm=points))
    fit = identify("neo-hookean", [larger], free=[NuisancePrior("magnification", 0.02)])
    (freed,) = fit.freed
    assert (freed.name, freed.deviation.unit, freed.prior_standard_deviation) == ("magnification", "1", 0.02)
    assert freed.deviation.value == pytest.approx(0.01, abs=1e-3)
    assert fit.initial_shear_modulus.value == pytest.approx(46e3, rel=0.01)
    assert fit.mean_error_mm == pytest.approx(NOISE_MM, rel=0.3)


def test_a_freed_tilt_of_the_camera_is_found_in_the_shapes_of_the_beam() -> None:
    beam = Specimen(40.0, 3.0, 6.0, 1070.0, "plane-strain")
    model = BeamModel(beam, 26, 2)
    loads = Loads.along(np.zeros(4), gravity_angle_deg=90.0, tip_force_N=[0.0, 4e-3, 8e-3, 1.6e-2])
    shapes = model.solve(LAWS["neo-hookean"], np.array([[60e3]]), loads)
    ruler = np.array([[0.0, -20.0], [50.0, -20.0]])
    straight = View(np.array([20.0, 5.0]), 180.0, ruler_mm=ruler)
    tilted = replace(straight, tilt_deg=(2.0, -1.0))
    sides = points_on(outline(model, shapes, tilted)[0], 1)[:, :, 1:-3]
    edges = sides + np.random.default_rng(2).normal(0, 2 * NOISE_MM, sides.shape)
    sigma = np.full(sides.shape[2], 2 * NOISE_MM)
    observed = EdgeObservation.from_edges([(left, sigma, right, sigma) for left, right in edges], straight)
    photographs = Experiment(BeamModel(beam), loads, observed)
    blind = refined("neo-hookean", [photographs], 60e3)
    fit = identify("neo-hookean", [photographs], free=[NuisancePrior("tilt", 2.0)])
    assert [one.name for one in fit.freed] == ["tilt along the beam", "tilt across the beam"]
    for one, hidden in zip(fit.freed, tilted.tilt_deg, strict=True):
        assert one.deviation.value == pytest.approx(hidden, abs=0.4)
    assert fit.initial_shear_modulus.value == pytest.approx(60e3, rel=0.01)
    assert abs(blind.estimate.initial_shear_modulus.value - 60e3) > 3 * abs(fit.initial_shear_modulus.value - 60e3)
    assert fit.mean_error_mm < 0.5 * blind.optimum.evaluation.comparison.error_mm[0].mean()


@pytest.mark.parametrize("kind", ["tilt", "stand-off"])
def test_an_input_of_the_lens_is_not_freed_without_a_view(bent: Experiment, kind: str) -> None:
    with pytest.raises(ValueError, match=rf"^{kind}: dataset 0 has no edges with a view, and cannot determine"):
        identify("neo-hookean", [bent], free=[NuisancePrior(kind, 2.0)])


def test_the_correction_of_the_camera_inverts_its_error() -> None:
    places = np.random.default_rng(0).uniform(-5, 30, (2, 7, 2))
    values = [("roll", 0, np.array([12.0])), ("clamp", 0, np.array([0.4])), ("clamp", 1, np.array([-0.7]))]
    setup = Setup.of(values, 1)
    assert setup.corrected(setup.imaged(places))[0] == pytest.approx(places, abs=1e-12)
    # The points are rotated counter-clockwise, and then displaced.
    assert Setup.of([("roll", 0, 90.0), ("clamp", 1, 0.5)], 1).imaged(np.array([1.0, 0.0])) == pytest.approx([0.0, 1.5])


@pytest.mark.parametrize("datasets", [1, 3])
def test_every_freed_number_has_its_name_in_the_result(datasets: int) -> None:
    freed = nuisances([NuisancePrior(key, source.usual) for key, source in SOURCES.items()], datasets)
    assert len({nuisance.name for nuisance in freed}) == len(freed)
    for nuisance in freed:
        assert freed_number(nuisance.name) == (nuisance.source, nuisance.part)
        assert (len(nuisance.datasets) == datasets) == (SOURCES[nuisance.source].common or datasets == 1)


@pytest.mark.parametrize("sizes", [(0.06, 0.0), (0.0, 0.06), (0.02, 0.06)])
def test_the_largest_of_the_uncertainties_that_files_give_for_one_specimen_counts(sizes: tuple[float, ...]) -> None:
    stated = [(StatedSource("width", size, "specimen m"),) for size in sizes]
    (group,) = shared("width", stated)
    assert (group.datasets, group.standard_uncertainty) == ((0, 1), 0.06)

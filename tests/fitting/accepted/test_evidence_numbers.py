"""Residuals, model corrections, bootstrap samples and drawn parameters equal stored reference numbers."""

# If a change is wanted, read the differences before you copy a new description over the accepted one.

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eimi_fitting.beam.beside import SolidBeside
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.view import View
from eimi_fitting.inference.evidence._coarse import coarsened
from eimi_fitting.inference.evidence.corrections import (
    FINER_MESH,
    SOLID,
    by_better_model,
    correction,
    polished,
    refinements,
    solid_beside,
)
from eimi_fitting.inference.evidence.experiment import Experiment, compare, joined
from eimi_fitting.inference.evidence.measurements import EdgeObservation, signed_distance
from eimi_fitting.inference.evidence.objective import Problem
from eimi_fitting.inference.evidence.unknowns import Setup, Unknowns
from eimi_fitting.inference.interval.bootstrap import resampled
from eimi_fitting.inference.interval.draws import draw_parameters
from eimi_fitting.inference.searching.polish import polish
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.search_space import search_space
from tests.shared.accepted_numbers import check, described
from tests.shared.quick_fits import BEAM, LOADS, PARAMETERS, edges, experiment, points

ACCEPTED = Path(__file__).parent / "evidence"
SOLID_BEAM = replace(BEAM, section="solid", depth_mm=4.0)
VIEW = View(np.array([12.0, 1.0]), 150.0, (1.0, -0.5))
MANY = Loads.along(np.linspace(-2.0, 3.0, 19), gravity_angle_deg=75.0)
LAW, TRUE = LAWS["mooney-rivlin"], np.array([PARAMETERS["mooney-rivlin"], (18e3, 5e3), (15e3, 8e3)])


def distances() -> Iterator[str]:
    x = np.linspace(0.0, 10.0, 7)
    line = np.column_stack([x, 0.02 * x**2])
    curve = np.stack([line[0:-1:2], line[1::2], line[2::2]], axis=1)
    given = np.array([[x, y] for x in (-3.0, -0.4, 0.0, 1.7, 5.0, 9.9, 10.3, 12.0) for y in (-1.5, 0.01, 0.9, 2.2)])
    yield from described(signed_distance(curve, given), "one curve")
    both = np.stack([curve, curve + np.array([0.0, 1.0])])
    yield from described(signed_distance(both, np.stack([given, given + 0.1])), "two curves")


def misfits() -> Iterator[str]:
    deep = experiment(replace(points(SOLID_BEAM, LOADS), depth_mm=np.tile(np.linspace(-1.5, 1.0, 6), (4, 1))))
    deep = replace(deep, solid=SolidBeside(SOLID_BEAM, 4, 1))
    setup = Setup.of([("scale", 0, np.array([0.01, 0.0, -0.02])), ("moment", 0, np.full(3, 0.03))], 3)
    for name, one in (
        ("edges", experiment(edges(BEAM, MANY), BEAM, MANY)),
        ("through a lens", experiment(edges(view=VIEW))),
        ("points", experiment(points(BEAM, LOADS))),
        ("solid", replace(experiment(edges(SOLID_BEAM), SOLID_BEAM), solid=SolidBeside(SOLID_BEAM, 4, 1))),
        ("points of a solid", replace(experiment(points(SOLID_BEAM, LOADS)), solid=SolidBeside(SOLID_BEAM, 4, 1))),
        ("deep points of a solid", deep),
    ):
        sets = TRUE[:1] if one.solid else TRUE
        setups = Setup.of([("roll", 0, np.array([1.0]))], 1) if one.solid else setup
        change = 0.01 * np.sin(
            np.arange(np.prod((*one.observed.sigma_mm.shape[:1], 2, *one.observed.sigma_mm.shape[-1:])))
        )
        one = replace(one, change=change.reshape(len(one.loads), 2, -1))
        found = compare(LAW, sets, [one], setups=[setups])
        yield from described((found.misfits, found.unconverged, found.unstable, found.max_stretch), name)
        yield from described((found.error_mm, found.deviation_mm, found.objective_mm), name)
        again = compare(LAW, sets, [replace(one, change=None)], near=found.near if not one.solid else ())
        yield from described(again.misfits, f"{name} plain")
        yield from described(one.recorrected(again.misfits[0], replace(one, change=None)), f"{name} recorrected")
        few = one.of_states(np.array([0, 2]))
        yield from described((few.loads, few.change, few.observed.sigma_mm), f"{name} few")
    two = [compare(LAW, TRUE[rows], [experiment(edges())], keep=True) for rows in ([1], [0, 2])]
    whole = joined([(np.array([1]), two[0]), (np.array([0, 2]), two[1])])
    yield from described((whole.misfits, whole.max_stretch, len(whole.shapes), len(whole.near)), "joined")
    yield from described(whole.take(np.array([2, 0])).error_mm, "taken")
    thin = coarsened([experiment(edges(BEAM, MANY), BEAM, MANY)])[0]
    yield from described((thin.observed, thin.model.along, thin.model.across), "coarse")


def corrections() -> Iterator[str]:
    for name, one in (("planar", experiment(edges(view=VIEW))), ("solid", experiment(edges(SOLID_BEAM), SOLID_BEAM))):
        fine = polished(one)

        def at(experiments: list[Experiment]) -> object:
            return compare(LAW, TRUE[:1], experiments, keep=True)

        here = at([fine])
        yield from described([refinement.name for refinement in refinements([one])], name)
        for refinement in (FINER_MESH, SOLID):
            found = correction(refinement, [fine], here, at)
            yield from described((found.changes, found.better.error_mm, refinement.remaining_share), name)
            yield from described([len(model.mesh.nodes) for model in found.models], name)
            second = correction(refinement, [fine], here, at, [found])
            yield from described(second.changes, f"{name} again")
            yield from described([e.change for e in found.added([replace(fine, change=np.ones(1))])], f"{name} added")
        misfit, curves, _ = by_better_model(fine, here, at)
        yield from described((misfit, curves), f"{name} better")
    for specimen in (SOLID_BEAM, replace(SOLID_BEAM, length_mm=12.0), replace(SOLID_BEAM, length_mm=90.0)):
        beside = solid_beside(specimen)
        yield from described((beside.planar.along, beside.planar.across, beside.planar.plane), "mesh")


def samples() -> Iterator[str]:
    given = [experiment(edges()), experiment(points(BEAM, MANY), BEAM, MANY)]
    for seed, replicate in ((1, 0), (1, 3), (4, 0)):
        for one in resampled(given, seed, replicate):
            yield from described((one.loads.field_T, one.observed.sigma_mm), f"{seed} {replicate}")
    correlation = np.array([[1.0, -0.7, 0.2], [-0.7, 1.0, 0.1], [0.2, 0.1, 1.0]])
    intervals = np.array([[8.0, 13.0], [4.0, 6.0], [-1.0, 3.0]])
    values = np.array([10.0, 5.0, 0.5])
    drawn = draw_parameters(("a", "b", "c"), values, intervals, correlation, lambda p: p[:, 0] + 0.3 * p[:, 1], 7)
    yield from described((drawn.seed, drawn.names, np.array(drawn.values)), "drawn")


def steps() -> Iterator[str]:
    space = search_space(LAW)
    space = replace(space, lower=(5e3, *space.lower[1:]), upper=(5e5, *space.upper[1:]))
    given = Problem(LAW, Unknowns(space), (experiment(edges()), experiment(points(BEAM, LOADS, "mooney-rivlin"))))
    for unit in ((0.5, 0.5), (0.9, 0.02), (0.1, 0.99)):
        found = polish(given.nearby(30.0), np.array(unit), enough=1e-3)
        yield from described((found.unit, found.distance, found.polish), f"{unit}")
        yield from described((found.evaluation.objective_mm, found.evaluation.misfits), f"{unit}")


PARTS = {"distances": distances, "misfits": misfits, "corrections": corrections, "samples": samples, "steps": steps}


@pytest.mark.parametrize("name", PARTS)
def test_evidence_has_the_accepted_numbers(name: str, tmp_path: Path) -> None:
    check(PARTS[name](), ACCEPTED / f"{name}.txt", tmp_path, 2e-5, 1e-9)


def test_a_point_beside_a_straight_edge_has_its_distance_and_one_beyond_the_end_at_first_no_other() -> None:
    x = np.linspace(0.0, 10.0, 5)
    line = np.column_stack([x, 0 * x])
    curve = np.stack([line[0:-1:2], line[1::2], line[2::2]], axis=1)
    found = signed_distance(curve, np.array([[3.0, 0.5], [3.0, -0.5], [10.4, 0.3], [11.5, 0.3], [-0.4, -0.3]]))
    # The edge is continued by a twentieth of its length, 0.5 mm.
    np.testing.assert_allclose(found, [0.5, -0.5, 0.3, np.hypot(0.3, 1.0), -0.3], atol=1e-9)


def test_an_observation_pads_shorter_edges_with_points_that_are_not_used() -> None:
    found = edges()
    assert isinstance(found, EdgeObservation)
    assert np.isfinite(found.sigma_mm).sum(axis=(1, 2)).tolist() == [21, 19, 21, 21]
    assert BeamModel(BEAM).across == 1

"""Each step of the search for the causes of residuals gives the accepted numbers, without simulations."""

# If a change is wanted, read the differences before you copy a new description over the accepted one.

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.rest_modes import with_modes
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.beam.view import View
from eimi_fitting.inference.doubts.cause_doubts import cause_doubts, is_as_stated
from eimi_fitting.inference.doubts.causes import Weighed, weighed_causes
from eimi_fitting.inference.doubts.checks import deflection_mm, doubts, noise_ratio
from eimi_fitting.inference.doubts.coefficients import Coefficients
from eimi_fitting.inference.doubts.deviating_inputs import deviations
from eimi_fitting.inference.doubts.edge_coefficients import projection
from eimi_fitting.inference.doubts.marginal_likelihood import Posterior
from eimi_fitting.inference.doubts.named_error import estimate_beside
from eimi_fitting.inference.doubts.possible_causes import PossibleCause
from eimi_fitting.inference.doubts.signatures import LinearisedFit, Solved, columns_of
from eimi_fitting.inference.doubts.stated_inputs import stated_columns
from eimi_fitting.inference.doubts.table_of_causes import POSSIBLE_CAUSES
from eimi_fitting.inference.doubts.weighing import Weighing
from eimi_fitting.inference.evidence.corrections import polished
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.objective import Problem
from eimi_fitting.inference.evidence.unknowns import NuisancePrior, Unknowns, nuisances
from eimi_fitting.inference.interval.corrected_optimum import SearchEnd, refine
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.search_space import search_space
from tests.shared.accepted_numbers import check, described
from tests.shared.quick_fits import BEAM, edges, experiment, points

ACCEPTED = Path(__file__).parent / "doubts"
STRIP = Specimen(25.0, 2.5, 8.0, 1070.0, "plane-stress")
UNDER_FORCE = Loads.along([0.0] * 3, gravity_angle_deg=80.0, tip_force_N=[4e-4, -9e-4, 2.1e-3])
UP_AND_DOWN = Loads.along((0.7, 2.9, 1.5, 3.4, 2.2), gravity_angle_deg=75.0, field_angle_deg=85.0)
NAMES = {cause.name: cause for cause in POSSIBLE_CAUSES}
VIEW = View(np.array([12.0, 1.0]), 150.0, (1.0, -0.5))
ELSEWHERE = ("rest_shape", "taper", "creep", "hysteresis", "camera_pitch", "clamp_angle", "distortion")
FEW = ("clamp_offset", "scale", "moment", "rest_shape", "clamp_softness")


def measured(one: Experiment, bend_mm: float) -> Experiment:
    # Return the experiment with a measured bend in its model.
    bent = with_modes(one.model.specimen, (bend_mm, 0.1, 0.0))
    return replace(one, model=one.model.of(bent), measured={"rest-shape": (bend_mm, 0.1, 0.0)})


CASES: dict[str, tuple[str, Any, tuple[NuisancePrior, ...], tuple[str, ...]]] = {
    "wrong scale": (
        "neo-hookean",
        lambda: [experiment(edges(law="neo-hookean", scale=1.03), width=0.02)],
        (),
        tuple(name for name in NAMES if name not in ELSEWHERE),
    ),
    "two beams": (
        "mooney-rivlin",
        lambda: [
            experiment(edges(replace(BEAM, width_mm=3.1)), width=0.05, remanence=0.02),
            experiment(edges(STRIP, UNDER_FORCE, seed=3), STRIP, UNDER_FORCE, "2", width=0.02),
        ],
        (NuisancePrior("roll", 0.3),),
        ("clamp_offset", "moment", "width"),
    ),
    "measured bend": (
        "yeoh",
        lambda: [
            measured(experiment(edges(with_modes(BEAM, (0.8, 0.3, 0.1)), UP_AND_DOWN, "yeoh"), BEAM, UP_AND_DOWN), 0.5)
        ],
        (),
        (*FEW, "creep", "hysteresis", "taper", "camera_pitch"),
    ),
    "points": (
        "yeoh",
        lambda: [experiment(points(STRIP, UNDER_FORCE), STRIP, UNDER_FORCE, length=0.05)],
        (NuisancePrior("clamp", 0.1),),
        ("clamp_offset", "scale", "distance", "distortion", "width", "taper", "clamp_angle"),
    ),
}


def problem(law: str, experiments: list[Experiment], free: tuple[NuisancePrior, ...]) -> Problem:
    space = search_space(LAWS[law])
    space = replace(space, lower=(5e3, *space.lower[1:]), upper=(5e5, *space.upper[1:]))
    freed = nuisances(free, len(experiments), [one.stated for one in experiments])
    return Problem(LAWS[law], Unknowns(space, freed), tuple(polished(one) for one in experiments))


@cache
def ended(name: str) -> tuple[SearchEnd, list[Experiment]]:
    law, experiments, free, _ = CASES[name]
    given = experiments()
    start = problem(law, given, free)
    unit = np.full(start.unknowns.searched, 0.4)
    unit[0] = 0.5
    return refine(start, unit, 3), given


def weighed_with(end: SearchEnd, causes: list[PossibleCause]) -> tuple[Weighed, Weighing, Posterior]:
    # Return the probabilities of the causes, with the comparison of all sets of causes from which they follow.
    results: list[tuple[Weighing, Posterior]] = []

    class Recorded(Weighing):
        def evidence_of_sets(self) -> Posterior:
            results.append((self, super().evidence_of_sets()))
            return results[0][1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("eimi_fitting.inference.doubts.causes.Weighing", Recorded)
        return weighed_causes(end.problem, end.optimum, end.effects, causes), *results[0]


def of_case(name: str) -> Iterator[str]:
    end, given = ended(name)
    causes = [NAMES[key] for key in CASES[name][3]]
    about = LinearisedFit.of(end.problem, end.optimum, causes)
    for key in ("kept", "law_spread", "slopes", "residuals", "used", "in_error"):
        yield from described(getattr(about, key), f"about.{key}")
    columns = {cause: found for cause in causes if (found := columns_of(about, cause))}
    stated = stated_columns(about, causes)
    weighed, weighing, posterior = weighed_with(end, causes)
    for kind, some in (("cause", columns), ("input", stated)):
        for cause, found in some.items():
            yield from described(found, f"{kind} {cause.name}")
    project = projection(end.problem.experiments, about.residuals, about.used)
    yield from described(replace(project, over_states=[np.abs(turn) for turn in project.over_states]), "projection")
    yield from described(project.smooth(project.of(about.slopes)), "smooth")
    coefficients = Coefficients.of(about, project, end.effects, stated, columns)
    absolute = {key: np.abs(getattr(coefficients, key)) for key in ("rows", "remaining")}  # the signs are arbitrary
    yield from described(replace(coefficients, columns=[], **absolute), "coefficients")
    yield from described((weighing.log_prior, weighing.blocks, weighing.is_uncertain, posterior), "posterior")
    yield from described(weighing.classes(posterior), "classes")
    best = int(np.argmax(posterior.log_evidence + weighing.log_prior))
    yield from described((best, weighing.hypotheses[best], weighing.alone(best).start), "best")
    for cause in range(len(weighing.blocks)):
        rows = weighing.rows_of_inputs(cause)
        yield from described((rows, weighing.stated_size(cause), weighing.shown(cause)), f"of cause {cause}")
        if rows:
            yield from described(weighing.if_exact(best, rows), f"exact {cause}")
            yield from described(weighing.squares_of(best, posterior, rows), f"squares {cause}")
    if weighing.is_uncertain[best]:
        yield from described(deviations(weighing, posterior, best), "deviations")
    yield from described(weighing.remaining(best, posterior.means[best]), "remaining")
    yield from described(replace(weighed, in_the_fit=frozenset(), most_probable=frozenset()), "weighed")
    yield from described((sorted(weighed.in_the_fit), sorted(weighed.most_probable)), "weighed")
    final = end.optimum.evaluation.comparison
    yield from described(cause_doubts(weighed, end.estimate, final, given), "cause doubts")
    yield from described((is_as_stated(weighed, given), doubts(final, given)), "doubts")
    for one, misfit in zip(given, final.misfits, strict=True):
        yield from described((deflection_mm(one), noise_ratio(one, misfit)), "ratio")
    beside = estimate_beside(end.problem, end.optimum, end.effects, weighed, end.estimate, ["mesh"], 5)
    yield from described(beside and replace(beside, draws=None), "beside")


@pytest.mark.parametrize("name", CASES)
def test_the_causes_of_residuals_have_the_accepted_numbers(name: str, tmp_path: Path) -> None:
    check(of_case(name), ACCEPTED / f"{name.replace(' ', '_')}.txt", tmp_path, 2e-5, 1e-9)


def of_changes(name: str, one: Experiment) -> Iterator[str]:
    end, _ = ended("measured bend")
    cause = NAMES[name]
    sizes = np.array(cause.sizes) * np.linspace(1.0, -0.7, len(cause.sizes))
    about = LinearisedFit.of(replace(end.problem, experiments=(one,)), end.optimum, [cause])
    assumed = about.solved[0].assumed
    for factor in (1.0, -0.6, 0.0):
        changed = cause.change(assumed, factor * sizes)
        yield from described((changed.law.name, changed.parameters, changed.deviations), f"{name} {factor}")
        yield from described((changed.experiment.loads, changed.experiment.observed.points_mm), f"{name} {factor}")
        solved = Solved.of(changed, about.solved[0])
        yield from described(solved and (solved.residuals, solved.between_ends()), f"{name} {factor}")


@pytest.mark.parametrize("lens", ["telecentric", "near"])
def test_each_cause_changes_the_assumptions_of_a_fit_as_accepted(lens: str, tmp_path: Path) -> None:
    one = ended("measured bend")[0].problem.experiments[0]
    if lens == "near":
        one = replace(one, observed=replace(one.observed, view=VIEW))
    lines = (line for name in NAMES if NAMES[name].change for line in of_changes(name, one))
    check(lines, ACCEPTED / f"changes_{lens}.txt", tmp_path, 2e-5, 1e-9)

"""Each step of a fit (optimum, slopes, noise, intervals) gives the accepted numbers.

The beams are not simulated: `tests.shared.quick_beam` replaces the equilibrium by a closed form.
"""

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
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.beam.view import View
from eimi_fitting.inference.evidence.corrections import polished
from eimi_fitting.inference.evidence.objective import Problem
from eimi_fitting.inference.evidence.parameter_priors import Prior
from eimi_fitting.inference.evidence.tensile_curves import TensileCurve, TensileEvidence
from eimi_fitting.inference.evidence.unknowns import NuisancePrior, Unknowns, nuisances
from eimi_fitting.inference.interval.corrected_optimum import SearchEnd, refine
from eimi_fitting.inference.interval.noise import linearise_noise
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.search_space import search_space
from eimi_fitting.laws.tensile import engineering_stress
from tests.shared.accepted_numbers import check, described
from tests.shared.quick_fits import BEAM, PARAMETERS, edges, experiment, points

ACCEPTED = Path(__file__).parent / "inference"
WIDER = replace(BEAM, width_mm=3.05)
STRIP = Specimen(25.0, 2.5, 8.0, 1070.0, "plane-stress")
UNDER_FORCE = Loads.along([0.0] * 3, gravity_angle_deg=80.0, tip_force_N=[4e-4, -9e-4, 2.1e-3])
STRAIN = Specimen(28.0, 2.0, 6.0, 1070.0, "plane-strain", replace(BEAM.magnet, width_mm=1.5))
SOLID = replace(BEAM, section="solid", depth_mm=4.0)
VIEW = View(np.array([12.0, 1.0]), 150.0, (1.0, -0.5))


def curve(law: str, factor: float = 1.02) -> TensileCurve:
    strain = np.linspace(0.02, 0.6, 12)
    stress = factor * engineering_stress(LAWS[law], np.array([PARAMETERS[law]]), strain)[0]
    return TensileCurve(strain, stress + np.random.default_rng(4).normal(0, 150.0, 12), 0.7)


def problem(law: str, experiments: list[Any], **more: Any) -> Problem:
    space = search_space(LAWS[law])
    space = replace(space, lower=(5e3, *space.lower[1:]), upper=(5e5, *space.upper[1:]))
    if more.get("bulk"):
        space = space.with_bulk()
    freed = nuisances(more.get("free", ()), len(experiments), [one.stated for one in experiments])
    return Problem(
        LAWS[law],
        Unknowns(space, freed),
        tuple(polished(one) for one in experiments),
        tuple(TensileEvidence.of(one, law) for one in more.get("curves", ())),
        tuple(more.get("priors", ())),
    )


def cases() -> dict[str, Any]:
    second = replace(BEAM, length_mm=26.0, width_mm=2.6)
    weaker = Loads.along((1.0, -2.0, 4.1), gravity_angle_deg=20.0, field_angle_deg=70.0)
    one = {"width": 0.02, "remanence": 0.02, "clamp": 0.01, "gravity": 0.3}
    return {
        "exact inputs": lambda: problem("neo-hookean", [experiment(edges(law="neo-hookean"))]),
        "wrong width": lambda: problem(
            "neo-hookean", [experiment(edges(WIDER, law="neo-hookean"), width=0.02, coil=0.01, taper=0.02)]
        ),
        "very wrong width": lambda: problem(
            "mooney-rivlin", [experiment(edges(replace(BEAM, width_mm=3.3)), width=0.1, scale=0.02, length=0.2)]
        ),
        "two datasets": lambda: problem(
            "mooney-rivlin",
            [
                experiment(edges(WIDER, scale=1.004), **one, scale=0.003),
                experiment(edges(second, weaker, seed=3), second, weaker, "2", width=0.03, coil=0.01, clamp=0.01),
            ],
            free=(NuisancePrior("moment", 0.02), NuisancePrior("roll", 0.2)),
            curves=(curve("mooney-rivlin"), curve("mooney-rivlin", 1.15)),
            priors=(Prior("C01", 5e3, 2e3), Prior("initial_shear_modulus", 43e3, 3e3)),
        ),
        "tracked points": lambda: problem(
            "yeoh",
            [experiment(points(STRIP, UNDER_FORCE), STRIP, UNDER_FORCE, length=0.05, depth=0.05, density=4.0)],
            priors=(Prior("C20", 3e3, 4e3),),
        ),
        "compressible": lambda: problem(
            "neo-hookean", [experiment(edges(STRAIN, law="neo-hookean"), STRAIN, width=0.02)], bulk=True
        ),
        "solid": lambda: problem(
            "yeoh", [experiment(edges(SOLID, law="yeoh"), SOLID, remanence=0.01), experiment(edges(law="yeoh"))]
        ),
        "through a lens": lambda: problem(
            "mooney-rivlin",
            [experiment(edges(view=VIEW), stand_off=1.0, tilt=0.3, background_field=0.03, field=0.4)],
            free=(NuisancePrior("stand-off", 3.0), NuisancePrior("magnetisation-angle", 2.0)),
        ),
    }


@cache
def ended(name: str) -> SearchEnd:
    given = cases()[name]()
    unit = np.full(given.unknowns.searched, 0.4)
    unit[0] = 0.5
    return refine(given, unit, 3)


def of_noise(noise: Any) -> Iterator[str]:
    yield from described(noise.about, "about")
    for name in ("law_prior_information", "hessian", "score"):
        yield from described(getattr(noise.about, name), f"about.{name}")
    yield from described(noise.about.covariance(1.3), "about.covariance")
    yield from described(noise.explained, "explained")
    yield from described([source.changes for source in noise.sources], "changes")
    yield from described([source.freed for source in noise.sources], "sources")
    yield from described(noise.mean_model_mm, "mean_model_mm")


def of_end(name: str) -> Iterator[str]:
    end = ended(name)
    problem = end.problem
    yield from described(end.optimum.unit, "unit")
    yield from described(end.optimum.polish, "last polish")
    yield from described(end.polish, "polish")
    yield from described(end.max_stretch, "max_stretch")
    yield from described([one.change for one in problem.experiments], "change")
    for effect in end.effects:
        yield from described((effect.moved, effect.remaining_share, effect.least_percent), "effect")
        yield from described(effect.correction.changes, "correction")
    yield from described((end.prior_distances, end.not_considered), "priors")
    drawn = np.array(end.estimate.draws.values)
    yield from described(replace(end.estimate, draws=None), "estimate")
    yield from described((end.estimate.draws.names, drawn, np.sort(drawn, axis=0)[::40]), "draws")
    yield from of_noise(linearise_noise(problem, end.optimum, end.effects))
    evaluation = problem.evaluate(np.array([end.optimum.unit, 0.9 * end.optimum.unit + 0.05]), 30.0)
    yield from described((evaluation.objective_mm, evaluation.standardised, evaluation.misfits), "evaluation")


@pytest.mark.parametrize("name", cases())
def test_a_fit_has_the_accepted_numbers(name: str, tmp_path: Path) -> None:
    check(of_end(name), ACCEPTED / f"{name.replace(' ', '_')}.txt", tmp_path, 2e-5, 1e-9)


@pytest.mark.parametrize(
    ("name", "deviations", "noise_mm"),
    [
        ("wrong width", 2.5, 0.002),  # 0.05 mm, which is 2.5 times the stated uncertainty
        ("very wrong width", 3.0, 0.03),  # the effect of 0.3 mm is not linear
        ("exact inputs", 0.0, 0.002),
    ],
)
def test_errors_of_inputs_explain_residuals_and_the_noise_remains(
    name: str, deviations: float, noise_mm: float
) -> None:
    found = ended(name).estimate.identifiability
    assert np.sqrt(found.stated_squares) == pytest.approx(deviations, abs=0.1)
    assert found.noise_mm == pytest.approx(noise_mm, rel=0.4)

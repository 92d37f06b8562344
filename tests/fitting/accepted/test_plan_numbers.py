"""Planned load states, the modulus estimated during a run, rest shapes, and fits agree with stored reference values."""

# If a change is wanted, read the differences before you copy a new description over the accepted one.

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.rest_modes import with_modes
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.inference.doubts.table_of_causes import POSSIBLE_CAUSES
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.parameter_priors import Prior
from eimi_fitting.inference.evidence.sources import StatedSource
from eimi_fitting.inference.evidence.tensile_curves import TensileCurve
from eimi_fitting.inference.identification.whole_fit import identify
from eimi_fitting.inference.planning import modulus_so_far, section_bias
from eimi_fitting.inference.planning.compressibility import compressibility_bias
from eimi_fitting.inference.planning.design_of_experiment import EdgeNoise, KnownLaw, candidates
from eimi_fitting.inference.planning.exchange import exchange
from eimi_fitting.inference.planning.rival_laws import rivals
from eimi_fitting.inference.planning.sensitivity import edge_sensitivity
from eimi_fitting.inference.searching.measured_rest_shape import measured_rest_shape
from eimi_fitting.inference.searching.search import search
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.tensile import engineering_stress
from tests.shared.accepted_numbers import check, described
from tests.shared.quick_fits import BEAM, LOADS, PARAMETERS, edges, experiment, points

ACCEPTED = Path(__file__).parent / "plans"
SOLID = replace(BEAM, section="solid", depth_mm=4.0)
STRIP = Specimen(25.0, 2.5, 8.0, 1070.0, "plane-strain")
UNDER_FORCE = Loads.along([0.0] * 3, gravity_angle_deg=80.0, tip_force_N=[4e-4, -9e-4, 2.1e-3])
MANY = Loads.along(np.linspace(-1.0, 4.0, 11), gravity_angle_deg=75.0)
STATED = tuple(
    StatedSource(source, size, "1")
    for source, size in (("width", 0.02), ("clamp", 0.05), ("coil", 0.01), ("gravity", 0.3), ("remanence", 0.02))
)
KNOWN = KnownLaw(LAWS["mooney-rivlin"], np.array(PARAMETERS["mooney-rivlin"]))


def plans() -> Iterator[str]:
    noise = EdgeNoise(0.003, 90, 4.5, 0.4)
    goals = (("initial shear modulus", KNOWN, BEAM), ("C01", KNOWN, SOLID))
    alone = KnownLaw(LAWS["neo-hookean"], np.array([40e3]))
    for goal, known, specimen in (*goals, ("mu", alone, BEAM)):
        found = candidates(known, specimen, MANY, STATED, noise, goal)
        yield from described(found, goal)
        choice = exchange(found, 4)
        yield from described((choice, found.half_width_percent(choice), found.effects_percent(choice)), goal)
        yield from described(found.variance(np.array([[0, 1, 5], [3, 4, 9], [8, 9, 10]])), goal)
    yield from described([found.least_percent(count) for count in (2, 5)], "least")
    other = KnownLaw(LAWS["yeoh"], np.array(PARAMETERS["yeoh"]))
    apart = rivals(KNOWN, other, BEAM, MANY, STATED, noise)
    choice = exchange(apart, 3)
    yield from described((apart, choice, apart.apart(choice)), "rivals")
    slopes = edge_sensitivity(BeamModel(BEAM), LAWS["yeoh"], np.array([[2e4, 1e3, 0.0], [1e4, 2e3, 5e2]]), LOADS)
    yield from described(slopes, "slopes")


def biases() -> Iterator[str]:
    section_bias.expected_bias.cache_clear()
    for name, specimen in (("solid", SOLID), ("planar", BEAM), ("strip", STRIP)):
        planar = BeamModel(specimen, 13, 1, specimen.planar_section)
        yield from described(section_bias.bending_loads(planar), f"{name} loads")
        yield from described(section_bias.expected_bias(specimen), f"{name} bias")
        yield from described(compressibility_bias(specimen, 0.47), f"{name} compressible")
    section_bias.expected_bias.cache_clear()


def during_a_run() -> Iterator[str]:
    section_bias.expected_bias.cache_clear()
    for name, specimen in (("solid", SOLID), ("planar", BEAM)):
        whole = experiment(edges(specimen, law="neo-hookean"), specimen, width=0.02, remanence=0.01)
        before = None
        for count in (2, 3, 4):
            before = modulus_so_far.modulus_so_far(whole.of_states(np.arange(count)), before)
            yield from described(replace(before, depth=None), f"{name} {count}")
    section_bias.expected_bias.cache_clear()


def rest_shapes() -> Iterator[str]:
    loads = Loads.along((0.0, 0.01, 1.5, -2.0, 3.0), gravity_angle_deg=1.5)
    for name, bends, widths in (
        ("bent", (0.4, 0.2, 0.0), ()),
        ("all", (-0.3, 0.1, 0.05), (0.05, 0.02)),
        ("none", (), ()),
    ):
        specimen = with_modes(BEAM, bends, widths)
        one = experiment(edges(specimen, loads, "neo-hookean"), BEAM, loads, width=0.02)
        found = measured_rest_shape(one)
        if found is None:
            yield f"{name}: None"
            continue
        yield from described((replace(found, specimen="as measured"), found.in_words), name)
        yield from described((found.specimen.rest_shape, found.specimen.width_mm), name)
        applied = found.applied(one, "a picture")
        yield from described((applied.stated, applied.measured), f"{name} applied")


class Valley:
    # The objectives of points on a curved valley; a corner of the cube is not valid.

    def __init__(self, units: np.ndarray) -> None:
        bent = units[:, 0] - 0.6 + 0.8 * (units[:, -1] - 0.3) ** 2
        rest = (units[:, 1:] - np.linspace(0.2, 0.7, units.shape[1])[1:]) ** 2
        self.unconverged = units.sum(axis=1) > 0.9 * units.shape[1]
        self.unstable = units[:, 0] < 0.02
        objective = 30.0 * np.sqrt(bent**2 + 0.1 * rest.sum(axis=1) + 1e-4)
        self.objective_mm = np.where(self.unconverged | self.unstable, 1e6, objective)


def searches() -> Iterator[str]:
    for name, n, options in (
        ("one", 1, {}),
        ("three", 3, {"seed": 4, "enough_mm": 0.3}),
        ("small", 3, {"population": 6, "most_generations": 12, "restarts": 2}),
        ("bipop", 2, {"restarts": 2, "bipop": True, "most_generations": 30}),
    ):
        kept: list[Any] = []
        found = search(Valley, n, progress=lambda generation, objectives: kept.append(objectives), **options)  # noqa: B023
        summary = {
            key: getattr(found, key) for key in ("unit", "objective_mm", "evaluations", "discarded", "stop", "runs")
        }
        yield from described(summary, name)
        yield from described([found.history[0], found.history[-1], len(kept)], name)
        yield from described(np.array([generation.discarded for generation in found.history]), f"{name} discarded")
        again = search(Valley, n, replay=kept[: len(kept) // 2], **options)
        assert again.history == found.history


def fit_of(law: str, experiments: list[Experiment], **options: Any) -> Iterator[str]:
    fit = identify(law, experiments, seed=2, **options)
    given = {key: value for key, value in vars(fit).items() if key not in ("wall_s", "draws", "history", "law")}
    yield from described((given, fit.values), law)
    yield from described((fit.history[0], fit.history[-1], np.sort(np.array(fit.draws.values), axis=0)[::50]), law)


def fits() -> Iterator[str]:
    strain = np.linspace(0.02, 0.6, 12)
    stress = engineering_stress(LAWS["mooney-rivlin"], np.array([PARAMETERS["mooney-rivlin"]]), strain)[0]
    pulled = TensileCurve(strain, 1.02 * stress + np.random.default_rng(4).normal(0, 150.0, 12))
    causes = [cause for cause in POSSIBLE_CAUSES if cause.name in ("scale", "moment", "width")]
    yield from fit_of(
        "neo-hookean",
        [experiment(edges(law="neo-hookean"), width=0.02, background_field=0.02)],
        possible_causes=causes,
    )
    yield from fit_of(
        "mooney-rivlin",
        [experiment(edges(), remanence=0.02), experiment(points(STRIP, UNDER_FORCE), STRIP, UNDER_FORCE)],
        possible_causes=(),
        tensile=(pulled,),
        priors=(Prior("C01", 5e3, 2e3),),
        restarts=1,
        population=7,
        most_generations=14,
    )
    yield from fit_of("neo-hookean", [experiment(edges(law="neo-hookean", scale=1.03))], possible_causes=causes)


PARTS = {
    "plans": plans,
    "biases": biases,
    "during a run": during_a_run,
    "rest shapes": rest_shapes,
    "searches": searches,
    "fits": fits,
}


@pytest.mark.parametrize("name", PARTS)
def test_the_numbers_are_as_accepted(name: str, tmp_path: Path) -> None:
    check(PARTS[name](), ACCEPTED / f"{name.replace(' ', '_')}.txt", tmp_path, 2e-5, 1e-9)

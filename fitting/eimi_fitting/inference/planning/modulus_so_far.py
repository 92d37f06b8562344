"""Estimate the shear modulus of a Neo-Hookean beam during a run, after every load case."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.beside import SolidOptions
from eimi_fitting.beam.depth_effect import DepthEffect
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.inference.evidence._coarse import coarsened
from eimi_fitting.inference.evidence.corrections import SOLID, correction, polished
from eimi_fitting.inference.evidence.experiment import Comparison, Experiment
from eimi_fitting.inference.evidence.objective import Evaluation, Problem
from eimi_fitting.inference.evidence.unknowns import Unknowns, nuisances
from eimi_fitting.inference.interval.considered import considered
from eimi_fitting.inference.interval.covariance import linearise
from eimi_fitting.inference.interval.estimate import estimate
from eimi_fitting.inference.interval.noise import Effect, Explained, Noise
from eimi_fitting.inference.planning.section_bias import expected_bias
from eimi_fitting.inference.searching.modulus_range import scanned, within
from eimi_fitting.inference.searching.polish import Optimum, Polish, difference_batch, polish
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.search_space import search_space

Array = NDArray[np.float64]

_LAW = LAWS["neo-hookean"]
_POINTS_A_STATE = 20.0  # independent points in a state; a guess that only the scan uses
_PASSES = 2  # the second correction is computed at the optimum after the first
_FIRST = np.zeros(1, np.intp)
_MOST_SOLVED = 7  # states of the solid through which the depth effect is interpolated
_CARRIED = 0.02  # relative change of the modulus up to which the depth effect is carried on
_LEAST_PERCENT = 0.15  # smallest remaining error of the solid, in per cent of the modulus
_WIDTH_GROWS = 1.05  # factor on the narrowest interval by which the noise may widen a later one


@dataclass(frozen=True)
class _Depth:
    # The difference between the shapes of the solid and of the planar beam model, computed at one modulus.
    effect: DepthEffect
    modulus_Pa: float


@dataclass(frozen=True)
class ModulusSoFar:
    """The initial shear modulus, estimated from the load cases that were measured so far."""

    value_Pa: float
    interval_95_Pa: tuple[float, float]
    # Mean of the root mean square residuals of the load cases.
    error_mm: float
    # Number of load cases.
    states: int
    # The largest contribution to the interval, in words.
    limited_by: str
    # Bounds of the modulus in the search.
    bounds_Pa: tuple[float, float]
    # (1,): optimum of the fit, scaled to 0..1 between the bounds.
    unit: Array
    # Width of the narrowest interval in the run.
    narrowest_Pa: float
    # Width of the 95 % interval due to noise and mesh error alone.
    noise_Pa: float
    # Correction of the displacements by a three-dimensional beam model.
    depth: _Depth | None = field(default=None, repr=False)

    @property
    def width_Pa(self) -> float:
        """Width of the 95 % interval of the modulus in Pa."""
        return self.interval_95_Pa[1] - self.interval_95_Pa[0]


def modulus_so_far(experiment: Experiment, before: ModulusSoFar | None = None) -> ModulusSoFar:
    """Estimate the modulus of a Neo-Hookean beam from the load cases that were measured so far."""
    # Raises NothingActs if no load bends the beam, and NothingConverged if the beam has no equilibrium for any modulus.
    now = _estimated(experiment, before)
    if before is None:
        return now
    (low, high), more_noise_Pa2 = before.interval_95_Pa, max(now.noise_Pa**2 - before.noise_Pa**2, 0.0)
    # A new state can make the interval wider, because some uncertainties have a larger effect if the beam bends more.
    # The width depends on the loads and hardly on the edges, so that the narrow interval keeps its probability of 95 %.
    # The residuals of all states, as noise, must hardly widen the earlier interval, and it must contain the new
    # estimate.
    is_valid = np.hypot(before.width_Pa, np.sqrt(more_noise_Pa2)) <= _WIDTH_GROWS * before.width_Pa
    if not (is_valid and low <= now.value_Pa <= high):
        return now
    if now.width_Pa <= _WIDTH_GROWS * before.narrowest_Pa:
        return replace(now, narrowest_Pa=min(now.narrowest_Pa, before.narrowest_Pa))
    return replace(before, error_mm=now.error_mm, bounds_Pa=now.bounds_Pa, unit=now.unit, depth=now.depth)


def _estimated(experiment: Experiment, before: ModulusSoFar | None) -> ModulusSoFar:
    specimen = experiment.model.specimen
    flat = polished(replace(experiment, solid=None, change=None))
    problem = Problem(_LAW, Unknowns(search_space(_LAW), nuisances((), 1, [flat.stated])), (flat,), ())
    if before is None:
        on_coarse = replace(flat, model=BeamModel(specimen, plane=specimen.planar_section))
        scan = scanned(replace(problem, experiments=tuple(coarsened([on_coarse]))), _POINTS_A_STATE * len(flat.loads))
        bounds = scan.searched()
        low, high = np.log(bounds)
        unit = np.array([np.clip((np.log(scan.best_Pa) - low) / (high - low), 0.0, 1.0)])
    else:
        bounds, unit = before.bounds_Pa, before.unit
    problem = within(problem, bounds)
    whole = problem.unknowns.whole(unit)[0]
    is_solid = specimen.section == "solid"
    corrected = _with_depth(problem, whole, before.depth if before else None) if is_solid else None
    problem, optimum, effects, depth = corrected or (problem, polish(problem.nearby(1.0), whole), (), None)
    # Without a correction by the solid, the modulus of the planar model is divided by 1 + bias.
    planar_share = 1.0 if depth or not is_solid else 1.0 / (1.0 + expected_bias(specimen))
    fitted = estimate(problem, optimum, effects, _noise(problem, optimum), (), 1)
    modulus, first = fitted.initial_shear_modulus, fitted.measure_next
    low_Pa, high_Pa = (planar_share * end for end in modulus.interval_95)
    of_noise_Pa = np.ptp(modulus.interval_95_fit or modulus.interval_95)
    return ModulusSoFar(
        value_Pa=planar_share * modulus.value,
        interval_95_Pa=(low_Pa, high_Pa),
        error_mm=float(optimum.evaluation.objective_mm[0]),
        states=len(flat.loads),
        limited_by="the noise of the edges" if first.source is None else first.words,
        bounds_Pa=bounds,
        unit=np.asarray(optimum.unit)[: problem.unknowns.searched],
        narrowest_Pa=high_Pa - low_Pa,
        noise_Pa=planar_share * float(of_noise_Pa),
        depth=depth,
    )


def _with_depth(
    problem: Problem, unit: Array, before: _Depth | None
) -> tuple[Problem, Optimum[Evaluation], tuple[Effect, ...], _Depth] | None:
    # Correct the residuals by a three-dimensional beam model, and fit again.
    plain, depth, corrected = problem.experiments, before, problem
    batch, distance = difference_batch(unit)
    optimum = Optimum(unit, problem.evaluate(batch, 1.0, keep=True), distance, Polish(0.0, 0.0, 0))
    effects: tuple[Effect, ...] = ()
    percent = max(100 * SOLID.remaining_share * abs(expected_bias(plain[0].model.specimen)), _LEAST_PERCENT)
    for _ in range(_PASSES):
        modulus_Pa = float(problem.unknowns.parameters(optimum.unit[None])[0, 0])
        # The depth effect is a smooth function of the bending and hardly depends on the modulus: it serves for later
        # states.
        if depth and abs(modulus_Pa / depth.modulus_Pa - 1) > _CARRIED:
            depth = None
        options = SolidOptions("interpolate", earlier=depth.effect if depth else None)
        at = partial(_alone, problem, optimum.unit)
        here = problem.recorrected(optimum.evaluation, corrected).comparison.take(_FIRST)
        change = correction(SOLID, plain, here, at, options=options)
        effect = change.effects[0] if change else None
        # The depth effect cannot be interpolated over the bending.
        if change is None or effect is None:
            return None
        depth = _Depth(effect.thinned(_MOST_SOLVED), depth.modulus_Pa if depth else modulus_Pa)
        now = replace(problem, experiments=change.added(plain))
        start = now.recorrected(optimum.evaluation, corrected), optimum.distance
        optimum, corrected = polish(now.nearby(1.0), optimum.unit, start), now
        effects = (Effect(change.without_shapes(), np.zeros(len(unit)), 0.0, percent),)
    return (corrected, optimum, effects, depth) if depth else None


def _alone(problem: Problem, unit: Array, experiments: Sequence[Experiment]) -> Comparison:
    return problem.evaluate(unit[None], 1.0, experiments).comparison


def _noise(problem: Problem, optimum: Optimum[Evaluation]) -> Noise:
    # All residuals at the optimum count as noise.
    about = linearise(problem, optimum)
    explained = Explained(about.states, about.hessian, float((about.priors**2).sum()))
    return Noise(about, explained, considered(problem, optimum.unit))

"""Choose the load cases to measure next, so that the interval of a modulus or law parameter becomes narrow.

The edges are simulated with the law of an earlier fit.
"""

# The covariance of the unknowns of the law is
#
#     inv(H) (t^2 A + P) inv(H) + S S',    A = w sum J'J,    H = A + P,    S = inv(H) w sum J'C,
#
# where the sums extend over the edge points of the chosen load cases, and
#
# - J is the derivative of an edge point by the unknowns,
# - C is the change of an edge point by one standard uncertainty of each uncertain input,
# - w is the inverse variance of an edge point, and P the inverse prior covariance of the unknowns,
# - t is the 97.5 % quantile of Student's distribution, divided by that of the normal distribution.

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from eimi_fitting.beam.equilibrium import Status
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.inference.evidence.corrections import FINER_MESH, MESH_ORDER, correction
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation, edge_curves, points_on
from eimi_fitting.inference.evidence.objective import Problem
from eimi_fitting.inference.evidence.quantity import NORMAL_95
from eimi_fitting.inference.evidence.sources import StatedSource
from eimi_fitting.inference.evidence.unknowns import Unknowns
from eimi_fitting.inference.interval.considered import considered
from eimi_fitting.inference.interval.identifiability import Identifiability
from eimi_fitting.inference.searching.polish import difference_batch
from eimi_fitting.laws.law import Law
from eimi_fitting.laws.search_space import search_space

Array = NDArray[np.float64]
Choice = NDArray[np.intp]

MODULUS = "initial shear modulus"
_DECADES = 1.5  # searched below and above the modulus, as in `inference.searching.modulus_range`
_SLOPE_STEP = 1e-4
_FIT_ALONG = 26  # elements along `BeamModel.refined`, the mesh of the final fit


@dataclass(frozen=True)
class KnownLaw:
    """A hyperelastic law with the parameters of an earlier fit."""

    law: Law
    parameters: Array

    def unknowns(self) -> tuple[Unknowns, Array]:
        """Return the unknowns of a fit of this law, and its parameters scaled to 0..1 between the bounds of the fit."""
        modulus = float(self.law.initial_shear_modulus(self.parameters))
        space = search_space(self.law)
        # The bounds are 1.5 decades below and above the modulus of the earlier fit.
        lower, upper = (modulus * 10.0**end for end in (-_DECADES, _DECADES))
        space = replace(space, lower=(lower, *space.lower[1:]), upper=(upper, *space.upper[1:]))
        scale = np.where(np.array(self.law.units) == "Pa", modulus, 1.0)
        solution = scipy.optimize.least_squares(
            lambda unit: (space.parameters(unit[None])[0] - self.parameters) / scale,
            np.full(len(space.names), 0.5),
            bounds=(0.0, 1.0),
            xtol=1e-12,
            ftol=1e-12,
            gtol=1e-12,
        )
        return Unknowns(space), np.asarray(solution.x)


@dataclass(frozen=True)
class EdgeNoise:
    """The expected errors in a planned run: the noise of the measured edges, and the error of the beam model.

    Attributes
    ----------
    residual_mm : float
        Standard deviation of the position of an edge point.
    points : int
        Number of points on both edges.
    alike : float
        Number of neighbouring edge points that count as one independent point.
    left_percent : float
        95 % bound of the error of the modulus due to the beam model.
    """

    residual_mm: float
    points: int
    alike: float
    left_percent: float = 0.0

    @staticmethod
    def of(earlier: Identifiability, states: int, left_percent: float = 0.0) -> EdgeNoise:
        """Return the expected errors in a planned run, from the result of an earlier fit.

        Parameters
        ----------
        earlier : Identifiability
            The result of the earlier fit.
        states : int
            Number of load cases of the earlier fit.
        left_percent : float
            95 % bound of the error of the modulus due to the beam model.
        """
        # All residuals count as noise if the earlier fit did not separate noise from errors of uncertain inputs.
        independent = earlier.noise_points or earlier.independent_points
        return EdgeNoise(
            residual_mm=earlier.noise_mm or earlier.residual_mm,
            points=round(earlier.points / states),
            alike=earlier.points / independent,
            left_percent=left_percent,
        )


@dataclass(frozen=True)
class Candidates:
    """The load cases from which a plan chooses, with the derivatives of their edges.

    The plan makes the interval of one quantity narrow: the initial shear modulus or a parameter of the law.

    Attributes
    ----------
    loads : Loads
        The S load cases.
    states : ndarray of int, shape (S,)
        Index of each load case in the list of all possible load cases.
    normal : ndarray, shape (S, n, n)
        Hessian of minus the log-likelihood of the edges by the n unknowns of the law.
    source_score : ndarray, shape (S, n, c)
        Change of the gradient of the log-likelihood by one standard uncertainty of each of c inputs.
    sources : tuple of str
        Names of the inputs.
    prior : ndarray, shape (n, n)
        Inverse prior covariance of the unknowns.
    goal : ndarray, shape (n,)
        Relative derivative of the quantity by the unknowns.
    points : float
        Number of independent edge points in a load case.
    irreducible : float
        Relative standard deviation of the quantity due to the error of the beam model.
    """

    loads: Loads
    states: Choice
    normal: Array
    source_score: Array
    sources: tuple[str, ...]
    prior: Array
    goal: Array
    points: float
    irreducible: float

    def __len__(self) -> int:
        return len(self.normal)

    def variance(self, choices: Choice) -> Array:
        """Return the relative variance of the modulus or law parameter, for several choices of load cases."""
        information, source_score = self.normal[choices].sum(axis=1), self.source_score[choices].sum(axis=1)
        goal = np.tile(self.goal, (len(choices), 1))[..., None]
        direction = np.linalg.solve(information + self.prior, goal)[..., 0]
        noise = np.einsum("di,dij,dj->d", direction, information, direction)
        prior = np.einsum("di,ij,dj->d", direction, self.prior, direction)
        sources = (np.einsum("di,dic->dc", direction, source_score) ** 2).sum(axis=1)
        return np.asarray(self._widened(choices.shape[1]) ** 2 * noise + prior + sources + self.irreducible**2)

    def half_width_percent(self, choice: Choice) -> float:
        """Return the half-width of the 95 % interval of the modulus or law parameter in per cent."""
        return 100 * NORMAL_95 * float(np.sqrt(self.variance(choice[None])[0]))

    def effects_percent(self, choice: Choice) -> dict[str, float]:
        """Return the standard deviation of the modulus or law parameter due to each uncertain input in per cent."""
        signed = self.signed_effects_percent(choice)
        return {name: abs(signed[name]) for name in sorted(signed, key=lambda name: -abs(signed[name]))}

    def signed_effects_percent(self, choice: Choice) -> dict[str, float]:
        """Return the change of the modulus or law parameter by one standard uncertainty of each input in per cent."""
        information, source_score = self.normal[choice].sum(axis=0), self.source_score[choice].sum(axis=0)
        effect = 100 * (np.linalg.solve(information + self.prior, self.goal) @ source_score)
        return {name: float(value) for name, value in zip(self.sources, effect, strict=True)}

    def _widened(self, states: int) -> float:
        # The factor by which an estimated noise level widens an interval (Student's t).
        freedom = max(min(self.points * states - len(self.goal), 2 * states - 1), 1.0)
        return float(scipy.special.stdtrit(freedom, 0.975)) / NORMAL_95

    def least_percent(self, states: int) -> float:
        """Return a lower bound of the half-width of the 95 % interval in per cent, for any choice of load cases.

        Raises
        ------
        ValueError
            If the law has more than one unknown.
        """
        if len(self.goal) > 1:
            raise ValueError(
                f"the smallest possible interval is known for a law with one unknown only, not with {len(self.goal)}"
            )
        information, prior = self.normal[:, 0, 0], float(self.prior[0, 0])
        # Every chosen state is assumed to determine the goal as well as the best state.
        most = states * float(information.max())
        noise = (self.goal[0] / (most + prior)) ** 2 * (self._widened(states) ** 2 * most + prior)
        informative = information > 1e-9 * information.max()
        alone = self.goal[0] * self.source_score[informative, 0] / information[informative, None]  # (S', C)
        heavy = 1e3 * max(float(np.abs(alone).max(initial=0.0)), 1e-6)  # enforces that the weights sum to one
        # The error by an input is a weighted mean over the states. The best weights give the smallest sum of squared
        # errors.
        rows = np.vstack([alone.T, np.full((1, int(informative.sum())), heavy)])
        weights, _ = scipy.optimize.nnls(rows, np.append(np.zeros(alone.shape[1]), heavy))
        share = most / (most + prior)  # the prior reduces the error of the estimate by this factor
        sources = (share * (weights / weights.sum()) @ alone) ** 2
        return 100 * NORMAL_95 * float(np.sqrt(noise + sources.sum() + self.irreducible**2))


def candidates(
    known: KnownLaw,
    specimen: Specimen,
    loads: Loads,
    stated: Sequence[StatedSource],
    noise: EdgeNoise,
    goal: str = MODULUS,
    along: int = _FIT_ALONG,
) -> Candidates:
    """Return the load cases from which a plan chooses, with the derivatives of their edges.

    Parameters
    ----------
    known : KnownLaw
        The law and parameters of an earlier fit.
    specimen : Specimen
        The specimen of the planned run.
    loads : Loads
        The possible load cases.
    stated : sequence of StatedSource
        Uncertain inputs.
    noise : EdgeNoise
        Noise of the edges, and error of the beam model.
    goal : str
        `MODULUS` or the name of a parameter of the law.
    along : int
        Number of elements along the beam in the fit after the run.

    Raises
    ------
    KeyError
        If the law does not have the parameter ``goal``.
    ValueError
        If no load case has an equilibrium.
    """
    model = planar_model(specimen)
    states = states_reached(known, model, loads)
    experiment = experiment_without_noise(known, model, loads.take(states), stated, noise)
    unknowns, unit = known.unknowns()
    problem = Problem(known.law, unknowns, (experiment,))
    slopes = slopes_of(problem, unit)
    scale = weight_of_point(noise, slopes.shape[-1])
    moved = {s.name: change for s in considered(problem, unit) if (change := s.changes[0]) is not None}
    if specimen.section != "solid":  # a solid specimen is fitted on the mesh of the solid
        moved |= _mesh(problem, unit, along)
    moves = np.array(list(moved.values())).reshape(len(moved), *slopes.shape[1:])
    return Candidates(
        loads=experiment.loads,
        states=states,
        normal=scale * np.einsum("ikgn,jkgn->kij", slopes, slopes),
        source_score=scale * np.einsum("ikgn,ckgn->kic", slopes, moves),
        sources=tuple(moved),
        prior=np.diag(unknowns.prior),
        goal=_goal(known, unknowns, unit, goal),
        points=noise.points / noise.alike,
        irreducible=noise.left_percent / 100 / NORMAL_95,
    )


def planar_model(specimen: Specimen) -> BeamModel:
    """Return a planar beam model with few elements, to compute derivatives quickly."""
    # The derivatives of the edges of a solid section differ by only a few per cent.
    return BeamModel(replace(specimen, section=specimen.planar_section))


def states_reached(known: KnownLaw, model: BeamModel, loads: Loads) -> Choice:
    """Return the indices of the loads with a stable equilibrium.

    Raises
    ------
    ValueError
        If there are none.
    """
    converged = model.solve(known.law, known.parameters[None], loads).status[0] == Status.CONVERGED
    if not converged.any():
        raise ValueError(f"none of the {len(loads)} states has a stable equilibrium: check loads, specimen and law")
    return np.flatnonzero(converged)


def experiment_without_noise(
    known: KnownLaw, model: BeamModel, loads: Loads, stated: Sequence[StatedSource], noise: EdgeNoise
) -> Experiment:
    """Return an experiment with edges that are simulated for a known law."""
    shapes = model.solve(known.law, known.parameters[None], loads)
    edges = points_on(edge_curves(model, shapes)[0], 4)[:, :, 4:-4]
    observed = EdgeObservation(edges, np.full(edges.shape[:3], noise.residual_mm))
    return Experiment(model, loads, observed, stated=tuple(stated))


def slopes_of(problem: Problem, unit: Array) -> Array:
    """Return the derivatives of the residuals in mm by the unknowns, which are scaled to 0..1."""
    # (n, K, 2, m)
    batch, distance = difference_batch(unit)
    residuals = problem.evaluate(batch, 1.0).comparison.misfits[0].residuals
    n = len(unit)
    return np.asarray((residuals[1 : n + 1] - residuals[n + 1 :]) / distance[:, None, None, None])


def _mesh(problem: Problem, unit: Array, along: int) -> dict[str, Array]:
    # The standard error of the edges (mm) due to a mesh of `along` elements.
    mesh_correction = correction(
        FINER_MESH,
        problem.experiments,
        problem.evaluate(unit[None], 1.0).comparison,
        lambda experiments: problem.evaluate(unit[None], 1.0, experiments).comparison,
    )
    if mesh_correction is None:  # no equilibrium on the finer mesh
        return {}
    scale = (problem.experiments[0].model.along / along) ** MESH_ORDER
    return {FINER_MESH.name: scale * FINER_MESH.remaining_share / NORMAL_95 * mesh_correction.changes[0]}


def weight_of_point(noise: EdgeNoise, points_per_edge: int) -> float:
    """Return the weight in 1/mm^2 of each simulated edge point in a sum of squares."""
    return noise.points / (2 * points_per_edge) / (noise.alike * noise.residual_mm**2)


def _goal(known: KnownLaw, unknowns: Unknowns, unit: Array, goal: str) -> Array:
    # (n,): the derivatives of the modulus or law parameter by the unknowns, divided by its value.
    names = known.law.parameter_names
    if goal != MODULUS and goal not in names:
        raise KeyError(goal)

    def value(units: Array) -> Array:
        parameters = unknowns.parameters(units)
        if goal == MODULUS:
            return known.law.initial_shear_modulus(parameters)
        return np.asarray(parameters[:, names.index(goal)])

    step = _SLOPE_STEP * np.eye(len(unit))
    ahead, behind = np.minimum(unit + step, 1.0), np.maximum(unit - step, 0.0)
    slope = (value(ahead) - value(behind)) / np.diag(ahead - behind)
    return np.asarray(slope / abs(float(value(unit[None])[0])))

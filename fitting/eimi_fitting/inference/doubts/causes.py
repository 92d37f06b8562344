"""Weigh the possible causes of the residuals against each other by the evidence of a linear Gaussian model.

Let r be the residuals at the optimum with every input at its stated value, J their slopes in the unknowns x of the law,
and C_a the signature of the cause a: the change of the residuals for its amplitudes s_a (`possible_causes`). With the
causes of the hypothesis H,

    -r = J dx + sum_{a in H} C_a s_a + d + e
    dx ~ N(0, inv(P)),   s_a ~ |s_a / size_a|^2 N(0, size_a^2),   d ~ N(0, eta^2 G),   e ~ N(0, sigma^2 tau)

P is the prior of the fit, and size_a the usual size of such a mistake. The prior of s_a vanishes at zero, so that a
second cause of negligible size does not repair small errors of the model (moment prior: Johnson and Rossell 2010, J. R.
Stat. Soc. B 72:143). Its factor multiplies the evidence of the normal prior by the mean of |s_a / size_a|^2. The
columns of J contain the remaining errors of the finer mesh and of the solid, too, as the interval does. The noise e has
the level sigma and the correlation tau of neighbouring points. The error d is what no listed cause explains; it is
smooth along an edge and over the loads (Kennedy and O'Hagan 2001, J. R. Stat. Soc. B 63:425). Everything is linear and
Gaussian, so that the evidence has a closed form. With L = sigma^2 tau + eta^2 G, the columns A of J and C_a, each times
its prior standard deviation, and b = A' inv(L) r,

    ln p(r | H, eta) = -1/2 (ln det L + r' inv(L) r) - 1/2 ln det(1 + A' inv(L) A) + 1/2 b' inv(1 + A' inv(L) A) b

(Bishop 2006, Pattern Recognition and Machine Learning, section 3.5; Woodbury's identity). It is averaged over eta from
0 to 1 mm, uniformly in ln eta. The hypotheses are no cause, one cause, and two causes together. Each of the M causes is
present with the prior probability 1 / M, so that the probability of a hypothesis is proportional to
p(r | H) (M - 1)^-|H|. The probability of a cause is the sum over the hypotheses that contain it; that of `none` is the
probability that the noise and d alone explain the residuals.

Residuals are compared by their coefficients in orthonormal polynomials along each edge, which contain all that smooth
signatures have; sigma and tau come from the remainder. A signature is linear only in small amplitudes. The probable
hypotheses are therefore simulated at their amplitudes, and what differs from the linear model is added to r
(Gauss-Newton). The error of these simulations, 0.2 per cent of each move, is added to the noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.correlation import correlation_length
from eimi_fitting.inference.doubts.possible_causes import POSSIBLE_CAUSES, PossibleCause, strengths
from eimi_fitting.inference.doubts.signatures import About, Column, columns_of
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation
from eimi_fitting.inference.evidence.objective import Evaluation, Problem
from eimi_fitting.inference.interval.noise import Effect
from eimi_fitting.inference.searching.polish import Optimum

Array = NDArray[np.float64]

_DEGREES = 8  # number of polynomials along an edge
_ERRORS_MM = np.concatenate([[0.0], np.geomspace(1e-4, 1.0, 17)])  # eta
_LOAD_RANGE = 0.5  # correlation length of d over the loads, as a share of the largest load
_SIDES = np.array([[1.0, 1.0], [1.0, -1.0]]) / np.sqrt(2)  # a shift of the beam, and a change of its width
_APART = 0.2  # variance of an error of the width, where that of both edges together is 2
_OF_ONE_STATE = 0.1  # share of the variance of d that is not common to neighbouring loads
_SIMULATED, _SIMULATED_PAIRS = 6, 4  # hypotheses of one and of two causes that are simulated in each pass
_PASSES = 8  # largest number of passes
_FAR = (
    200.0,
    30.0,
)  # logarithm of the probability below the best from which on a hypothesis is not simulated: first, later
# Moves up to which signatures are linear: in prior sizes, and in shares of the range of the law's coordinates.
_LINEAR, _LINEAR_LAW = 0.005, 2e-4
# Error of a move, as a share of it. The corrections by finer meshes and by the solid are those at the optimum; 20 per
# cent of the modulus beside it they are wrong by this much.
_OF_MOVE = 0.002
_FEWEST = 10  # points of the remainder from which the noise is estimated
_LEAST = 1e-3  # probability below which a cause is left out of the result
_MOST_SIZES = 5.0  # largest amplitude, in prior sizes
NONE = "none"


@dataclass(frozen=True)
class Cause:
    """One possible cause of the residuals.

    Parameters
    ----------
    name : str
        Its name; ``"none"`` stands for noise and an error that no listed cause explains.
    probability : float
        Probability that it is present.
    value : float
        Its most probable amplitude in ``unit``; of several amplitudes their root sum of squares, with the sign of the
        largest. Zero for ``"none"``.
    unit : str
        Unit of the value; ``"1"`` for a share.
    shift_percent : float
        Change of the initial shear modulus, in per cent, if this cause is taken into account; if the fit has taken it
        into account, the change by which it did so.
    decide_by : str
        The measurement that decides whether it is the cause.
    """

    name: str
    probability: float
    value: float
    unit: str
    shift_percent: float
    decide_by: str


@dataclass(frozen=True)
class Weighed:
    """The causes in the order of their probability, and what they would leave.

    Parameters
    ----------
    causes : tuple of Cause
    in_the_fit : frozenset of str
        Causes that the fit has taken into account, because they were freed or measured.
    error_mm : dict of str to tuple of ndarray, shape (K,)
        Root mean square residual of each state, for each experiment, if the cause is taken into account alone.
    """

    causes: tuple[Cause, ...]
    in_the_fit: frozenset[str]
    error_mm: dict[str, tuple[Array, ...]]


@dataclass(frozen=True)
class Projection:
    """The coefficients of residuals along the edges, and their variances.

    Parameters
    ----------
    bases : tuple of ndarray, shape (K, G, m, D)
        Orthonormal polynomials of each experiment; zero where a point is not used.
    over_states, over_groups : tuple of ndarray, shape (K, K) and (G, G)
        Rotation of the states, and of the two edges, of each experiment to independent combinations.
    noise, error : ndarray, shape (N,)
        Variance of each coefficient by noise, and by an error d with eta of 1 mm.
    """

    bases: tuple[Array, ...]
    over_states: tuple[Array, ...]
    over_groups: tuple[Array, ...]
    noise: Array
    error: Array

    def of(self, residuals: Sequence[Array | None]) -> Array:
        """Return the coefficients (..., N) of residuals (..., K, G, m) of each experiment; None stands for zero."""
        lead = next(r.shape[:-3] for r in residuals if r is not None)
        parts = []
        for basis, turn, mix, residual in zip(self.bases, self.over_states, self.over_groups, residuals, strict=True):
            if residual is None:
                parts.append(np.zeros((*lead, basis.shape[0] * basis.shape[1] * basis.shape[3])))
                continue
            along = np.einsum("...kgm,kgmd->...kgd", residual, basis)
            parts.append(np.einsum("kl,gh,...kgd->...lhd", turn, mix, along).reshape(*lead, -1))
        return np.concatenate(parts, axis=-1)


def projection(experiments: Sequence[Experiment], residuals: Sequence[Array], used: Sequence[Array]) -> Projection:
    """Return the coefficients that describe residuals, with the variances of noise and of an unnamed error.

    Parameters
    ----------
    experiments : sequence of Experiment
    residuals, used : sequence of ndarray, shape (K, G, m)
        Residuals at the optimum in mm, and a positive number for every point that counts.
    """
    bases, turns, mixes, noises, errors = [], [], [], [], []
    for experiment, residual, weights in zip(experiments, residuals, used, strict=True):
        is_used = weights > 0
        basis = _polynomials(is_used)
        remainder = residual - np.einsum("kgd,kgmd->kgm", np.einsum("kgm,kgmd->kgd", residual, basis), basis)
        counts = is_used.sum(axis=-1)
        noise = _noise(experiment, remainder * is_used, is_used, counts)
        values, turn = np.linalg.eigh(_over_loads(experiment))
        by_degree = 1.0 / (1 + np.arange(basis.shape[-1])) ** 4
        is_edges = isinstance(experiment.observed, EdgeObservation)
        mix, of_groups = (_SIDES, np.array([2 - _APART, _APART])) if is_edges else (np.eye(2), np.ones(2))
        errors.append((counts.mean() * values[:, None, None] * of_groups[:, None] * by_degree).ravel())
        mixes.append(mix)
        noises.append(np.broadcast_to(noise, (len(values), *noise.shape)).ravel())
        bases.append(basis)
        turns.append(turn)
    return Projection(tuple(bases), tuple(turns), tuple(mixes), np.concatenate(noises), np.concatenate(errors))


def _polynomials(is_used: NDArray[np.bool_]) -> Array:
    """Return polynomials (K, G, m, D) in the place along each edge that are orthonormal over its used points."""
    degrees = min(_DEGREES, is_used.shape[-1])
    place = np.cumsum(is_used, axis=-1) / np.maximum(is_used.sum(axis=-1, keepdims=True), 1)
    powers = np.polynomial.legendre.legvander(2 * place - 1, degrees - 1) * is_used[..., None]
    basis, triangle = np.linalg.qr(powers)
    independent = np.abs(np.diagonal(triangle, axis1=-2, axis2=-1)) > 1e-9
    return np.asarray(basis * independent[..., None, :])


def _noise(experiment: Experiment, remainder: Array, is_used: NDArray[np.bool_], counts: NDArray[np.intp]) -> Array:
    """Return the variance (G, D) of the coefficients by noise: from the remainder, or as stated if that is too short.

    The stated uncertainty of tracked points is common to all points of a state.
    """
    degrees = min(_DEGREES, is_used.shape[-1])
    free = int(np.maximum(counts - degrees, 0).sum())
    sigma = experiment.observed.sigma_mm
    stated = np.sqrt(np.mean(sigma[np.isfinite(sigma)] ** 2)) if np.isfinite(sigma).any() else 1.0
    variance = np.full((is_used.shape[1], degrees), stated**2)
    if not isinstance(experiment.observed, EdgeObservation):
        variance[:, 0] *= max(float(counts.mean()), 1.0)
    elif free >= _FEWEST:
        variance[:] = (remainder**2).sum() / free * correlation_length(remainder, is_used.astype(float))
    return np.maximum(variance, 1e-18)


def _over_loads(experiment: Experiment) -> Array:
    """Return the covariance (K, K) of the unnamed error over the states: states of similar loads err alike."""
    loads = experiment.loads
    strongest = loads.field_T[np.argmax(np.linalg.norm(loads.field_T, axis=1))]
    signed = strengths(loads) * np.where(loads.field_T @ strongest < 0, -1.0, 1.0)
    apart = (signed[:, None] - signed) / _LOAD_RANGE
    return np.asarray((1 - _OF_ONE_STATE) * np.exp(-0.5 * apart**2) + _OF_ONE_STATE * np.eye(len(signed)))


@dataclass(frozen=True)
class Posterior:
    """The hypotheses after the residuals, with normal priors of all coefficients.

    Parameters
    ----------
    log_evidence : ndarray, shape (H,)
        Logarithm of the evidence of each hypothesis, averaged over eta.
    means : ndarray, shape (H, C)
        Mean of each coefficient, in its prior standard deviations; zero for columns that are not in the hypothesis.
    squares : ndarray, shape (H, C)
        Mean square of each coefficient, likewise.
    """

    log_evidence: Array
    means: Array
    squares: Array


def weigh(columns: Array, members: NDArray[np.intp], y: Array, noise: Array, error: Array) -> Posterior:
    """Return the evidence of hypotheses and the means of their coefficients, see the module.

    Parameters
    ----------
    columns : ndarray, shape (C, N)
        The columns A', each times the prior standard deviation of its coefficient; the last one is zero.
    members : ndarray, shape (H, q)
        Columns of each hypothesis; the last column fills the place of missing ones.
    y : ndarray, shape (H, N)
        Minus the residuals, for each hypothesis.
    noise, error : ndarray, shape (N,)
        Variance of the noise, and of the unnamed error for eta of 1 mm.
    """
    h, q = members.shape
    logs, means, squares = np.zeros((len(_ERRORS_MM), h)), *np.zeros((2, len(_ERRORS_MM), h, q))
    for i, eta in enumerate(_ERRORS_MM):
        precision = 1 / (noise + eta**2 * error)
        gram = (columns * precision) @ columns.T
        projected = np.take_along_axis((y * precision) @ columns.T, members, axis=1)
        system = np.eye(q) + gram[members[:, :, None], members[:, None, :]]
        covariance = np.linalg.inv(system)
        means[i] = (covariance @ projected[..., None])[..., 0]
        squares[i] = means[i] ** 2 + np.diagonal(covariance, axis1=1, axis2=2)
        logs[i] = 0.5 * (np.log(precision).sum() - (y**2 * precision).sum(axis=1))
        logs[i] += 0.5 * ((projected * means[i]).sum(axis=1) - np.linalg.slogdet(system)[1])
    largest = logs.max(axis=0)
    weights = np.exp(logs - largest)
    total = weights.sum(axis=0)
    averages = np.zeros((2, h, len(columns)))
    for average, values in zip(averages, (means, squares), strict=True):
        np.put_along_axis(average, members, np.einsum("eh,ehq->hq", weights / total, values), axis=1)
        average[:, -1] = 0.0
    return Posterior(largest + np.log(total / len(_ERRORS_MM)), *averages)


def weighed_causes(
    problem: Problem,
    optimum: Optimum[Evaluation],
    effects: Sequence[Effect] = (),
    possible: Sequence[PossibleCause] = POSSIBLE_CAUSES,
) -> Weighed:
    """Weigh the possible causes of the residuals at an optimum.

    Parameters
    ----------
    problem : Problem
        The problem of the fit, corrections included.
    optimum : Optimum
        Its optimum.
    effects : sequence of Effect
        The corrections in the problem. Their remaining errors explain residuals under every hypothesis.
    possible : sequence of PossibleCause
        The causes to weigh.

    Returns
    -------
    Weighed
        The causes; empty if the coarse model has no equilibrium at the optimum. An input that was freed or measured is
        a cause, too: its deviation counts from the stated value.
    """
    about = About.of(problem, optimum, possible)
    if not about.solved:
        return Weighed((), frozenset(), {})
    columns_by_cause = {cause: columns for cause in possible if (columns := columns_of(about, cause))}
    if not columns_by_cause:
        return Weighed((), frozenset(), {})
    weighing = _Weighing(about, effects, columns_by_cause)
    posterior = weighing.posterior()
    score = posterior.log_evidence + weighing.log_prior
    probability = np.exp(score - score.max())
    probability /= probability.sum()
    none = float(posterior.means[0, 0])
    in_the_fit = frozenset(cause.name for cause, columns in columns_by_cause.items() if any(c.start for c in columns))
    causes, errors = [Cause(NONE, float(probability[0]), 0.0, "", 0.0, "")], {}
    for i, cause in enumerate(columns_by_cause):
        alone = posterior.means[1 + i]
        errors[cause.name] = weighing.remaining_mm(alone)
        holds = np.array([i in hypothesis for hypothesis in weighing.hypotheses])
        total = float(probability[holds].sum())
        if total < _LEAST:
            continue
        mean = probability[holds] @ posterior.means[holds] / total
        amplitudes = mean[weighing.blocks[i]]
        size = float(np.copysign(np.linalg.norm(amplitudes), amplitudes[np.argmax(np.abs(amplitudes))]))
        before = none if cause.name in in_the_fit else 0.0
        shift = problem.unknowns.modulus_percent(float(alone[0]) - before)
        causes.append(Cause(cause.name, total, size, cause.unit, shift, cause.decide_by))
    return Weighed(tuple(sorted(causes, key=lambda cause: -cause.probability)), in_the_fit, errors)


class _Weighing:
    """The hypotheses about one optimum: their columns, and the residuals that each has to explain."""

    def __init__(
        self, about: About, effects: Sequence[Effect], columns_by_cause: Mapping[PossibleCause, Sequence[Column]]
    ) -> None:
        self._about, self._causes = about, tuple(columns_by_cause)
        self._columns = [column for columns in columns_by_cause.values() for column in columns]
        # The columns of every hypothesis: the law, then the remaining errors of the corrections.
        law = self._common = len(about.law_spread) + len(effects)
        blocks: list[list[int]] = []
        for columns in columns_by_cause.values():
            first = blocks[-1][-1] + 1 if blocks else law
            blocks.append(list(range(first, first + len(columns))))
        self.blocks = blocks
        self._project = projection(about.problem.experiments, about.residuals, about.used)
        shares = (effect.remaining_share for effect in effects)
        self._scale = np.array([*about.law_spread, *shares, *(column.size for column in self._columns), 1.0])
        changes = [*(effect.correction.changes for effect in effects), *(column.changes for column in self._columns)]
        slopes = [self._project.of(about.slopes), *(self._project.of(change)[None] for change in changes)]
        rows = np.concatenate([*slopes, np.zeros((1, slopes[0].shape[-1]))])
        self._rows = self._scale[:, None] * rows
        causes = range(len(self._causes))
        self.hypotheses = [(), *((i,) for i in causes), *combinations(causes, 2)]
        kept = list(range(law))
        widest = law + sum(sorted(map(len, blocks))[-2:])
        self._members = np.full((len(self.hypotheses), widest), len(self._rows) - 1)
        for row, hypothesis in enumerate(self.hypotheses):
            indices = kept + [index for i in hypothesis for index in blocks[i]]
            self._members[row, : len(indices)] = indices
        self._holds = np.array([[i in hypothesis for i in causes] for hypothesis in self.hypotheses])
        self.log_prior = -np.log(max(len(self._causes) - 1, 1)) * np.array([len(h) for h in self.hypotheses], float)
        # What the residuals were if the freed and measured inputs had their stated values.
        self._stated = [np.array(residual) for residual in about.residuals]
        for column in self._columns:
            for residual, change in zip(self._stated, column.changes, strict=True):
                if change is not None:
                    residual -= column.start * change

    def posterior(self) -> Posterior:
        """Return evidence and amplitudes of all hypotheses; the probable ones are simulated (Gauss-Newton)."""
        y = np.tile(-self._project.of(self._stated), (len(self.hypotheses), 1))
        result = self._weigh(y, np.zeros(y.shape[1]))
        simulated_at = np.zeros_like(result.means)  # where the linear model is exact
        for index in range(_PASSES):
            moved = np.abs(result.means - simulated_at) / self._scale
            moved[:, : len(self._about.law_spread)] *= _LINEAR / _LINEAR_LAW
            moved[:, len(self._about.law_spread) : self._common] = 0.0
            rows = [row for row in self._probable(result, _FAR[min(index, 1)]) if moved[row].max() > _LINEAR]
            for row in rows:
                simulated_at[row] = result.means[row]
                simulated = self._simulated(self.hypotheses[row], result.means[row])
                if simulated is not None:
                    moves = result.means[row] / self._scale
                    moves[len(self._about.law_spread) : self._common] = 0.0  # these are not simulated
                    y[row] = moves @ self._rows - self._project.of(simulated)
            if not rows:
                break
            best = result.means[np.argmax(result.log_evidence + self.log_prior)] / self._scale
            result = self._weigh(y, ((_OF_MOVE * best[:, None] * self._rows) ** 2).sum(axis=0))
        return result

    def _weigh(self, y: Array, of_move: Array) -> Posterior:
        noise = self._project.noise + of_move
        standard = weigh(self._rows, self._members, y, noise, self._project.error)
        # The factor of the non-local prior: the mean of |s_a / size_a|^2 over its number of amplitudes.
        factors = np.stack([standard.squares[:, block].mean(axis=1) for block in self.blocks], axis=1)
        factors = np.log(np.where(self._holds, factors, 1.0)).sum(axis=1)
        law = np.arange(len(self._scale)) < self._common
        most = np.where(law, np.inf, _MOST_SIZES)
        means = np.clip(standard.means, -most, most) * self._scale
        return replace(standard, log_evidence=standard.log_evidence + factors, means=means)

    def _probable(self, result: Posterior, far: float) -> list[int]:
        """Return the rows of the best hypotheses of one and of two causes, and of that without freed inputs."""
        score = result.log_evidence + self.log_prior
        order = np.argsort(-score)
        order = order[score[order] > score.max() - far]
        sizes = np.array([len(self.hypotheses[row]) for row in order])
        starts = [0] if any(column.start for column in self._columns) else []
        return [*starts, *order[sizes == 1][:_SIMULATED].tolist(), *order[sizes == 2][:_SIMULATED_PAIRS].tolist()]

    def _simulated(self, hypothesis: tuple[int, ...], amplitudes: Array) -> list[Array] | None:
        law = self._common
        given: dict[PossibleCause, list[tuple[Column, float]]] = {}
        for i, cause in enumerate(self._causes):
            columns = [self._columns[index - law] for index in self.blocks[i]]
            if i in hypothesis:
                given[cause] = list(zip(columns, amplitudes[self.blocks[i]].tolist(), strict=True))
            elif any(column.start for column in columns):
                given[cause] = [(column, 0.0) for column in columns]
        return self._about.simulated(amplitudes[: len(self._about.law_spread)], given)

    def remaining_mm(self, amplitudes: Array) -> tuple[Array, ...]:
        """Return the root mean square residual (K,) in mm of each experiment with these amplitudes, linearly."""
        law, common, errors = len(self._about.law_spread), self._common, []
        for i, (residual, slopes, used) in enumerate(
            zip(self._stated, self._about.slopes, self._about.used, strict=True)
        ):
            remaining = residual + np.tensordot(amplitudes[:law], slopes, axes=1)
            for column, amplitude in zip(self._columns, amplitudes[common:-1], strict=True):
                if amplitude and (change := column.changes[i]) is not None:
                    remaining = remaining + amplitude * change
            errors.append(np.sqrt((remaining**2).sum(axis=(1, 2)) / np.maximum(used.sum(axis=(1, 2)), 1.0)))
        return tuple(errors)

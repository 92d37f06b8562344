"""Compare the hypotheses about the causes of the residuals of a fit, with simulations of the probable hypotheses.

The model and the computation are described in `inference.doubts.causes`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.doubts.collinear_causes import classes
from eimi_fitting.inference.doubts.edge_coefficients import projection
from eimi_fitting.inference.doubts.marginal_likelihood import Posterior, weigh
from eimi_fitting.inference.doubts.possible_causes import PossibleCause
from eimi_fitting.inference.doubts.signatures import About, Column
from eimi_fitting.inference.evidence.quantity import NORMAL_95
from eimi_fitting.inference.interval.noise import Effect

Array = NDArray[np.float64]

_SIMULATED, _SIMULATED_PAIRS = 8, 4  # hypotheses of one and of two causes that are simulated in each pass
_PASSES, _PASSES_FAR = 8, 3  # largest number of passes, and those in which improbable causes are simulated
# Difference of the logarithm of the probability from the most probable hypothesis, in the first and in later passes. A
# hypothesis with a larger difference is not simulated.
_FAR = (200.0, 30.0)
# Moves up to which signatures are linear: in prior sizes, and in shares of the range of the law's coordinates.
_LINEAR, _LINEAR_LAW = 0.005, 2e-4
# Error of a change of the residuals, as a share of the change. The corrections by finer meshes and by the solid are
# computed at the optimum only, and are not exact for changed amplitudes.
# With 0.002, virtual solids with one cause got a second one of negligible size.
_OF_MOVE = 0.01
# Length that the remaining error of the meshes at the clamp adds; 0.007 mm on a virtual solid of 26 x 3 elements.
_CORNERS_MM = 0.01
_POOR = 4.0  # above this ratio of misfit to noise, a single cause is fitted with renewed slopes
_GAUSS_NEWTON = 5  # largest number of these steps
_STEP, _LAW_STEP = 0.05, 3e-3  # of their finite differences, in prior standard deviations
_NEGLIGIBLE = 0.3  # prior sizes below which a cause is improbable
_MOST_SIZES = 5.0  # largest amplitude, in prior sizes


class Weighing:
    """The hypotheses about the causes of the residuals, each with a linear Gaussian model.

    A hypothesis is a set of causes (possible errors of the bench) that are present: none, one or two.
    """

    def __init__(
        self, about: About, effects: Sequence[Effect], columns_by_cause: Mapping[PossibleCause, Sequence[Column]]
    ) -> None:
        self._about, self._causes = about, tuple(columns_by_cause)
        self._columns = [column for columns in columns_by_cause.values() for column in columns]
        # The columns of every hypothesis: the law, then the remaining errors of the corrections. The error of the
        # meshes is largest in the corners at the clamp, where it acts as a softer or stiffer clamp.
        corners = [c for cause, cs in columns_by_cause.items() if cause.name == "clamp_softness" for c in cs]
        law = self._common = len(about.law_spread) + len(effects) + len(corners)
        blocks: list[list[int]] = []
        for columns in columns_by_cause.values():
            first = blocks[-1][-1] + 1 if blocks else law
            blocks.append(list(range(first, first + len(columns))))
        self.blocks = blocks
        self._project = projection(about.problem.experiments, about.residuals, about.used)
        shares = (effect.remaining_share for effect in effects)
        of_corners = [_CORNERS_MM] * len(corners)
        self._scale = np.array(
            [*about.law_spread, *shares, *of_corners, *(column.size for column in self._columns), 1.0]
        )
        changes = [
            *(effect.correction.changes for effect in effects),
            *(column.changes for column in (*corners, *self._columns)),
        ]
        changes_of_effects = [
            effect.remaining_share / NORMAL_95 * self._project.of(effect.correction.changes) for effect in effects
        ]
        slopes = [self._project.of(about.slopes), *(self._project.of(change)[None] for change in changes)]
        self._remaining = np.array(changes_of_effects).reshape(len(effects), slopes[0].shape[-1])
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
        self._in_the_fit = {i for i, columns in enumerate(columns_by_cause.values()) if any(c.start for c in columns)}
        self._holds = np.array([[i in hypothesis for i in causes] for hypothesis in self.hypotheses])
        self.log_prior = -np.log(max(len(self._causes) - 1, 1)) * np.array([len(h) for h in self.hypotheses], float)
        # What the residuals were if the freed and measured inputs had their stated values.
        self._stated = [np.array(residual) for residual in about.residuals]
        for column in self._columns:
            for residual, change in zip(self._stated, column.changes, strict=True):
                if change is not None:
                    residual -= column.start * change

    def shown(self, cause: int) -> int:
        """Return how many amplitudes of one cause, from the first, enter its reported value (`Cause.value`).

        A cause is a possible error of the bench, and ``cause`` is its index. An amplitude is the size of one part of a
        cause, such as a shift in x.
        """
        shown, columns = self._causes[cause].shown, [self._columns[row - self._common] for row in self.blocks[cause]]
        return len(columns) if shown is None else sum(column.part < shown for column in columns) or len(columns)

    def classes(self, posterior: Posterior) -> list[tuple[int, ...]]:
        """Group the causes that the residuals do not distinguish, and return the indices of the causes in each group.

        A cause is a possible error of the bench. Such a group is called a class (`inference.doubts.collinear_causes`).

        The first cause of each class is the most probable one.
        """
        alone = slice(1 + len(self._causes))  # no cause, and each cause alone
        best = int(np.argmax(posterior.log_evidence + self.log_prior))
        variance = self._variance + posterior.error_squared[best] * self._project.error
        remaining = self._y[alone] - posterior.means[alone] / self._scale @ self._rows
        counts = [len(block) for block in self.blocks]
        sizes = np.abs(posterior.means[alone][1:] / self._scale)
        negligible = np.array([sizes[i, self._shown_rows(i)].max() < _NEGLIGIBLE for i in range(len(self._causes))])
        return classes(remaining / np.sqrt(variance), counts, posterior.log_evidence[alone][1:], negligible)

    def _shown_rows(self, cause: int) -> list[int]:
        return self.blocks[cause][: self.shown(cause)]

    def posterior(self) -> Posterior:
        """Return evidence and amplitudes of all hypotheses, after simulations of the probable hypotheses.

        A hypothesis is a set of causes (possible errors of the bench), and an amplitude is the size of a cause. The
        evidence of a hypothesis is the probability density of the residuals under the hypothesis.
        """
        y = np.tile(-self._project.of(self._stated), (len(self.hypotheses), 1))
        result = self._weigh(y, self._model_error(np.zeros((1, y.shape[1]))))
        simulated_at = np.zeros_like(result.means)  # where the linear model is exact
        known = np.zeros(len(self.hypotheses), bool)  # whether a hypothesis was simulated
        settled: set[int] = set()
        for index in range(_PASSES):
            moved = np.abs(result.means - simulated_at) / self._scale
            moved[:, : len(self._about.law_spread)] *= _LINEAR / _LINEAR_LAW
            moved[:, len(self._about.law_spread) : self._common] = 0.0
            rows = [
                row for row in self._probable(result, _FAR[int(index >= _PASSES_FAR)]) if moved[row].max() > _LINEAR
            ]
            for row in rows:
                simulated_at[row] = result.means[row]
                if index == 1 and len(self.hypotheses[row]) == 1 and self._misfit(y[row], result.means[row]) > _POOR:
                    simulated_at[row] = self._minimised(row, result.means[row])
                    settled.add(row)
                simulated = self._simulated(self.hypotheses[row], simulated_at[row])
                if simulated is not None:
                    known[row] = True
                    moves = simulated_at[row] / self._scale
                    moves[len(self._about.law_spread) : self._common] = 0.0  # these are not simulated
                    y[row] = moves @ self._rows - self._project.of(simulated)
            if not rows:
                break
            for row, part in self._starts(result, known):
                y[row], simulated_at[row] = y[part], simulated_at[part]
            best = result.means[np.argmax(result.log_evidence + self.log_prior)] / self._scale
            result = self._weigh(y, self._model_error(best[:, None] * self._rows))
        self._y = y
        return result

    def _starts(self, result: Posterior, known: NDArray[np.bool_]) -> list[tuple[int, int]]:
        """Return the hypotheses that were not simulated, each with a simulated hypothesis whose residuals it can use.

        A hypothesis is a set of causes (possible errors of the bench). Its residuals are linear functions of the
        amplitudes (sizes) of the causes. The linear functions have no error only at amplitudes that were simulated. Of
        two hypotheses that differ by one cause, the simulated one could therefore seem to agree better with the data. A
        hypothesis that was not simulated thus uses the simulation of a hypothesis with some of its causes (a part). If
        there are several parts, the most probable one is used.

        A part must contain every cause of the hypothesis that the fit has taken into account, because the shape at rest
        would differ without such a cause.

        Parameters
        ----------
        result : Posterior
            The evidence (probability density of the residuals) of the H hypotheses.
        known : ndarray of bool, shape (H,)
            Whether each hypothesis was simulated.

        Returns
        -------
        list of tuple of int
            For each hypothesis with such a part, the index of the hypothesis and the index of the part.
        """
        score = result.log_evidence + self.log_prior
        pairs = []
        for row in np.flatnonzero(~known):
            of_fit = self._in_the_fit.intersection(self.hypotheses[row])
            parts = [
                part
                for part in np.flatnonzero(known)
                if set(self.hypotheses[part]) < set(self.hypotheses[row])
                and self._in_the_fit.intersection(self.hypotheses[part]) == of_fit
            ]
            if parts:
                pairs.append((int(row), int(max(parts, key=lambda part: score[part]))))
        return pairs

    def _model_error(self, moves: Array) -> Array:
        """Return the variance of N coefficients in mm^2, shape (N,), due to errors of the simulation.

        The coefficients describe the residuals by polynomials along each edge (`inference.doubts.edge_coefficients`).
        Two errors are counted. One is the error that remains after the corrections by better beam models. The other is
        1 per cent of the simulated effects of the law and of each cause; ``moves``, shape (C, N) in mm, has these C
        effects on the coefficients.
        """
        of_moves = _OF_MOVE**2 * ((moves**2).sum(axis=0) + self._project.smooth(moves))
        return np.asarray(of_moves + self._project.smooth(self._remaining))

    def _misfit(self, y: Array, amplitudes: Array) -> float:
        """Return how badly a hypothesis explains the residuals: the mean square of the rest, in units of the noise.

        About 1 means that only noise is left. ``y`` has the coefficients in mm that describe minus the residuals by
        polynomials along each edge (`inference.doubts.edge_coefficients`). ``amplitudes`` has the changes of the law
        and the sizes of the errors of the bench; in the linear model they explain a part of ``y``.
        """
        return float(np.mean((y - (amplitudes / self._scale) @ self._rows) ** 2 / self._project.noise))

    def _minimised(self, row: int, amplitudes: Array) -> Array:
        """Return the most probable amplitudes of the causes of one hypothesis, by Gauss-Newton with simulations.

        ``row`` is the index of the hypothesis, a set of causes (possible errors of the bench). An amplitude is the size
        of a cause, and Gauss-Newton starts from ``amplitudes``.
        """
        best, least = amplitudes.copy(), np.inf
        best[len(self._about.law_spread) : self._common] = 0.0
        active = [i for i in set(self._members[row].tolist()) if i < len(self._scale) - 1 and best[i]]
        steps = np.where(np.arange(len(self._scale)) < self._common, _LAW_STEP, _STEP) * self._scale
        trial = best.copy()
        for _ in range(_GAUSS_NEWTON):
            here = self._simulated(self.hypotheses[row], trial)
            if here is None:
                break
            residual, slopes = self._project.of(here), []
            value = float((residual**2 / self._project.noise).sum() + ((trial / self._scale) ** 2).sum())
            if value >= least:
                break
            best, least = trial.copy(), value
            for i in active:
                ahead = trial.copy()
                ahead[i] += steps[i]
                there = self._simulated(self.hypotheses[row], ahead)
                if there is None:
                    return best
                slopes.append((self._project.of(there) - residual) / steps[i])
            weighted = np.array(slopes) / self._project.noise
            normal = weighted @ np.array(slopes).T + np.diag(self._scale[active] ** -2)
            score = weighted @ residual + trial[active] * self._scale[active] ** -2
            trial[active] -= np.linalg.solve(normal, score)
        return best

    def _weigh(self, y: Array, of_move: Array) -> Posterior:
        self._variance = self._project.noise + of_move
        standard = weigh(self._rows, self._members, y, self._variance, self._project.error)
        # The factor of the moment prior, whose normal mean of |s_a / size_a|^4 is 3 for one amplitude.
        shown = [self._shown_rows(cause) for cause in range(len(self._causes))]
        squares = np.stack([standard.squares[:, rows].max(axis=1) for rows in shown], axis=1)
        factors = 2 * np.log(np.where(self._holds, squares / (squares + _NEGLIGIBLE**2), 1.0)).sum(axis=1)
        law = np.arange(len(self._scale)) < self._common
        most = np.where(law, np.inf, _MOST_SIZES)
        means = np.clip(standard.means, -most, most) * self._scale
        return replace(standard, log_evidence=standard.log_evidence + factors, means=means)

    def _probable(self, result: Posterior, far: float) -> list[int]:
        """Return the indices of the probable hypotheses (sets of possible errors of the bench), which are simulated.

        A hypothesis is probable if the logarithm of its probability is at most ``far`` below the largest one.
        `posterior` repeats the simulations in several passes. In the first passes, hypotheses of a single error are
        also returned if they are improbable, because a large error may look improbable before it is simulated.
        """
        score = result.log_evidence + self.log_prior
        order = np.argsort(-score)
        near = score[order] > score.max() - far
        sizes = np.array([len(self.hypotheses[row]) for row in order])
        starts = [0] if any(column.start for column in self._columns) else []
        # A single cause of large amplitude may look improbable before it is simulated.
        singles = order[(sizes == 1) & (near | (far == _FAR[0]))][:_SIMULATED]
        return [*starts, *singles.tolist(), *order[(sizes == 2) & near][:_SIMULATED_PAIRS].tolist()]

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

    def remaining(self, row: int, amplitudes: Array) -> tuple[Array, ...] | None:
        """Return the residuals in mm that a simulation of one hypothesis leaves: one array for each experiment.

        An array has the shape (K, G, m) for G groups (edges, or x and y) of m points in K states. ``row`` is the index
        of the hypothesis, a set of causes. ``amplitudes`` has the changes of the law and the sizes of the causes
        (errors of the bench). The result is None if the beam model finds no equilibrium.
        """
        residuals = self._simulated(self.hypotheses[row], amplitudes)
        return None if residuals is None else tuple(residuals)

    def remaining_mm(self, amplitudes: Array) -> tuple[Array, ...]:
        """Return the root mean square residual in mm of K states, shape (K,), one array for each experiment.

        The residuals are computed with the linear model for ``amplitudes``, the changes of the law and the sizes of the
        causes (errors of the bench). The points near the ends of an edge are included, unlike in the comparison of
        causes.
        """
        law, common, errors = len(self._about.law_spread), self._common, []
        for i, (residual, slopes, used) in enumerate(
            zip(self._stated, self._about.slopes, self._about.in_error, strict=True)
        ):
            remaining = residual + np.tensordot(amplitudes[:law], slopes, axes=1)
            for column, amplitude in zip(self._columns, amplitudes[common:-1], strict=True):
                if amplitude and (change := column.changes[i]) is not None:
                    remaining = remaining + amplitude * change
            square = (remaining**2 * (used > 0)).sum(axis=(1, 2))
            errors.append(np.sqrt(square / np.maximum(used.sum(axis=(1, 2)), 1.0)))
        return tuple(errors)

"""Compare all combinations of at most two systematic errors that may explain the residuals of a fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.doubts.coefficients import Coefficients
from eimi_fitting.inference.doubts.collinear_causes import classes
from eimi_fitting.inference.doubts.edge_coefficients import projection
from eimi_fitting.inference.doubts.marginal_likelihood import Posterior, weigh
from eimi_fitting.inference.doubts.possible_causes import PossibleCause
from eimi_fitting.inference.doubts.signatures import Column, LinearisedFit
from eimi_fitting.inference.interval.noise import Effect

Array = NDArray[np.float64]

_SIMULATED, _SIMULATED_PAIRS = 8, 4  # hypotheses of one and of two causes that are simulated in each pass
_PASSES, _PASSES_FAR = 8, 3  # largest number of passes, and those in which improbable causes are simulated
# Difference of the logarithm of the probability from the most probable hypothesis, in the first and in later passes. A
# hypothesis with a larger difference is not simulated.
_FAR = (200.0, 30.0)
# A hypothesis is simulated again if the size of an error moves by more than the first number, or if an unknown of the
# law moves by more than the second number. Both numbers are in prior standard deviations. For smaller moves, the
# residuals are taken as linear.
_LINEAR, _LINEAR_LAW = 0.005, 2e-4
# Error of a change of the residuals, as a share of the change. The corrections by finer meshes and by the solid are
# computed at the optimum only, and are not exact for changed amplitudes.
# With the value 0.002, a second cause of negligible size was found for virtual solids that have only one cause.
_OF_MOVE = 0.01
# A single cause is fitted by Gauss-Newton with simulations if the mean square of its linearised residuals exceeds this
# many times the noise variance.
_POOR = 4.0
_GAUSS_NEWTON = 8  # largest number of Gauss-Newton steps
_SMALL_DECREASE = 0.01  # the steps end if the sum of squares, in units of the noise variance, decreases by less
_STEP, _LAW_STEP = 0.05, 3e-3  # steps of the finite differences, in prior standard deviations
NEGLIGIBLE = 0.3  # size in prior standard deviations below which a cause is improbable
_MOST_SIZES = 5.0  # largest amplitude, in prior standard deviations


@dataclass(frozen=True)
class Exact:
    """The probabilities of systematic errors, computed as if some inputs, such as the width, had no error."""

    # Indices of n systematic errors.
    causes: list[int]
    # (1 + n,): probability of none of them, and of each.
    probability: Array
    # Evidence and sizes of the errors in these 1 + n cases.
    posterior: Posterior
    # Groups of errors that the residuals do not distinguish.
    classes: list[tuple[int, ...]]


class Weighing:
    """The comparison of all combinations of at most two systematic errors that may explain the residuals of a fit."""

    def __init__(
        self,
        fit: LinearisedFit,
        effects: Sequence[Effect],
        stated: Mapping[PossibleCause, Sequence[Column]],
        columns_by_cause: Mapping[PossibleCause, Sequence[Column]],
    ) -> None:
        self._about, self._causes, self._inputs = fit, tuple(columns_by_cause), tuple(stated)
        self._project = projection(fit.problem.experiments, fit.residuals, fit.used)
        coefficients = Coefficients.of(fit, self._project, effects, stated, columns_by_cause)
        self._coefficients, self._columns = coefficients, coefficients.columns
        self._rows, self._scale, self.blocks = coefficients.rows, coefficients.scale, coefficients.of_causes
        self._law, self._simulated_common = coefficients.law, coefficients.simulated
        self._common = law = coefficients.common
        causes = range(len(self._causes))
        every = [(), *((i,) for i in causes), *combinations(causes, 2)]
        exact = [row for row in range(law) if not self._law <= row < self._simulated_common]
        # The inputs are exact or uncertain with equal prior probability.
        # One array for the hypotheses whose inputs are exact, and one for those whose inputs are uncertain.
        self._members = [
            self._members_of([[*some, *self._rows_of(one)] for one in every])
            for some in ([exact, list(range(law))] if stated else [exact])
        ]
        self.hypotheses = every * len(self._members)
        self.is_uncertain = np.repeat([False, True][: len(self._members)], len(every))
        self._measured = {i for i, columns in enumerate(columns_by_cause.values()) if any(c.start for c in columns)}
        # Each of the M causes is present with the prior probability 1 / M.
        self.log_prior = -self._log_odds * np.array([len(h) for h in self.hypotheses], float)
        # The residuals that the fit would have if the freed and measured inputs had their stated values.
        self._stated = [np.array(residual) for residual in fit.residuals]
        for column in self._columns:
            for residual, change in zip(self._stated, column.changes, strict=True):
                if change is not None:
                    residual -= column.start * change

    @property
    def _log_odds(self) -> float:
        # Logarithm of the prior odds against one systematic error.
        return float(np.log(max(len(self._causes) - 1, 1)))

    def _rows_of(self, hypothesis: tuple[int, ...]) -> list[int]:
        return [index for i in hypothesis for index in self.blocks[i]]

    def _members_of(self, rows: Sequence[Sequence[int]]) -> NDArray[np.intp]:
        # The lists of indices become the rows of one array. Short lists are filled up with the last index.
        # The last index belongs to no unknown number: its effect on the residuals is zero.
        members = np.full((len(rows), max(map(len, rows))), len(self._rows) - 1)
        for row, indices in enumerate(rows):
            members[row, : len(indices)] = indices
        return members

    def shown(self, cause: int) -> int:
        """Return how many components of a systematic error the report gives, such as 2 for x and y."""
        shown, columns = self._causes[cause].shown, [self._coefficients.column(row) for row in self.blocks[cause]]
        return len(columns) if shown is None else sum(column.part < shown for column in columns) or len(columns)

    def alone(self, index: int) -> slice:
        """Return the slice of `hypotheses` with at most one error and the same inputs, exact or not, as at `index`."""
        # `hypotheses` contains all sets with exact inputs and, if inputs are uncertain, then all sets with uncertain
        # inputs.
        first = self.is_uncertain[index] * (len(self.hypotheses) // len(self._members))
        return slice(first, first + 1 + len(self._causes))

    def classes(self, posterior: Posterior) -> list[tuple[int, ...]]:
        """Group the systematic errors (given by their numbers) that the residuals cannot distinguish."""
        best = int(np.argmax(posterior.log_evidence + self.log_prior))
        alone = self.alone(best)
        causes = range(len(self._causes))
        return self._alike(self._y[alone], posterior.take(alone), causes, posterior.error_squared[best])

    def _alike(
        self, y: Array, posterior: Posterior, causes: Sequence[int], error_squared: float
    ) -> list[tuple[int, ...]]:
        variance = self._variance + error_squared * self._project.error
        remaining = y - posterior.means / self._scale @ self._rows
        counts = [len(self.blocks[cause]) for cause in causes]
        sizes = np.abs(posterior.means[1:] / self._scale)
        negligible = np.array(
            [one[self._shown_rows(cause)].max() < NEGLIGIBLE for one, cause in zip(sizes, causes, strict=True)]
        )
        groups = classes(remaining / np.sqrt(variance), counts, posterior.log_evidence[1:], negligible)
        return [tuple(causes[i] for i in members) for members in groups]

    def _shown_rows(self, cause: int) -> list[int]:
        return self.blocks[cause][: self.shown(cause)]

    def scale(self, rows: Sequence[int]) -> Array:
        """Return the prior standard deviations of some unknowns."""
        return self._scale[rows]

    def rows_of_inputs(self, cause: int) -> list[int]:
        """Return the indices of the uncertain inputs that can cause the systematic error with the index `cause`."""
        stated_as = self._causes[cause].stated_as
        return [
            row
            for one, rows in zip(self._inputs, self._coefficients.of_inputs, strict=True)
            if one.source in stated_as
            for row in rows
        ]

    def squares_of(self, base: int, posterior: Posterior, rows: Sequence[int]) -> float:
        """Return chi-square of the change of the residuals by the estimated errors of the inputs `rows`."""
        # The errors are estimated under `hypotheses[base]`.
        change = posterior.means[base, rows] / self._scale[rows] @ self._rows[rows]
        # The variance of noise and unexplained errors.
        variance = self._variance + posterior.error_squared[base] * self._project.error
        return float((change**2 / variance).sum())

    def as_cause(self, rows: Sequence[int], amounts: Array, cause: int) -> Array:
        """Fit the size of the systematic error `cause` to the effect of errors `amounts` of the inputs `rows`."""
        of_cause, root = self._shown_rows(cause), np.sqrt(self._variance)
        change = amounts / self._scale[rows] @ self._rows[rows] / root
        return np.linalg.lstsq((self._rows[of_cause] / root).T, change, rcond=None)[0] * self._scale[of_cause]

    def stated_size(self, cause: int) -> float:
        """Return the standard uncertainty of a systematic error, from those of the inputs that can cause it."""
        parts = [self.as_cause([row], self._scale[[row]], cause) for row in self.rows_of_inputs(cause)]
        return float(np.linalg.norm(parts)) if parts else 0.0

    def moved_by_unit(self) -> Array:
        """Return the change of the first unknown of the fit by a correction for one unit of each unknown."""
        law = self._rows[: self._law]
        weighted = law / self._variance
        moved = np.linalg.solve(weighted @ law.T + np.eye(self._law), weighted @ self._rows.T)[0]
        return np.asarray(-moved * self._scale[0] / self._scale)

    @property
    def has_several_inputs(self) -> bool:
        """Whether several possible systematic errors are errors of inputs with a stated uncertainty."""
        return len(self._inputs) > 1

    def moved_in_fit(self, rows: Sequence[int]) -> Array:
        """Return the change of the first unknown by a correction for one unit of some unknowns, as in a new fit."""
        about, moved = self._about, []
        for row in rows:
            score = np.zeros(self._law)
            changes = self._coefficients.column(row).changes
            for weights, slopes, change in zip(about.weights, about.slopes, changes, strict=True):
                if change is not None:
                    score += np.einsum("k,ikgn,kgn->i", weights, slopes, change)
            moved.append(-np.linalg.solve(about.hessian, score)[0])
        return np.array(moved)

    def starts(self, cause: int) -> Array:
        """Return the measured components of a systematic error, which the fit already contains; else zeros."""
        return np.array([self._coefficients.column(row).start for row in self.blocks[cause]])

    def if_exact(self, base: int, rows: Sequence[int]) -> Exact:
        """Compute the probability of each error that `hypotheses[base]` lacks, if the inputs `rows` have no error."""
        hypothesis = self.hypotheses[base]
        causes = [cause for cause in range(len(self._causes)) if cause not in hypothesis]
        hypotheses = [hypothesis, *((*hypothesis, cause) for cause in causes)]
        others = [row for row in range(self._common) if row not in rows]
        members = self._members_of([[*others, *self._rows_of(one)] for one in hypotheses])
        y = np.tile(self._y[base], (len(hypotheses), 1))
        posterior = self._evidence(y, members, hypotheses)
        score = posterior.log_evidence - self._log_odds * (np.arange(len(hypotheses)) > 0)
        groups = self._alike(y, posterior, causes, float(posterior.error_squared[int(np.argmax(score))]))
        probability = np.exp(score - score.max())
        for group in groups:
            alike = [1 + causes.index(cause) for cause in group]
            probability[alike] = probability[alike].mean()
        return Exact(causes, probability / probability.sum(), posterior, groups)

    def evidence_of_sets(self) -> Posterior:
        """Compute the evidence (probability density of the data) of each combination of systematic errors."""
        y = np.tile(-self._project.of(self._stated), (len(self.hypotheses), 1))
        result = self._weigh(y, self._model_error(np.zeros((1, y.shape[1]))))
        simulated_at = np.zeros_like(result.means)  # where the linear model is exact
        known = np.zeros(len(self.hypotheses), bool)  # whether a hypothesis was simulated
        settled: set[int] = set()
        for index in range(_PASSES):
            moved = np.abs(result.means - simulated_at) / self._scale
            moved[:, : self._law] *= _LINEAR / _LINEAR_LAW
            moved[:, self._simulated_common : self._common] = 0.0
            rows = [
                row for row in self._probable(result, _FAR[int(index >= _PASSES_FAR)]) if moved[row].max() > _LINEAR
            ]
            for row in rows:
                simulated_at[row] = result.means[row]
                if index == 1 and len(self.hypotheses[row]) == 1 and self._misfit(y[row], result.means[row]) > _POOR:
                    simulated_at[row] = self._minimised(row, result.means[row])
                    settled.add(row)
                # The difference of a simulation from the linear model is added to the data of this hypothesis.
                simulated = self._simulated(self.hypotheses[row], simulated_at[row])
                if simulated is not None:
                    known[row] = True
                    moves = simulated_at[row] / self._scale
                    moves[self._simulated_common : self._common] = 0.0  # these are not simulated
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
        # For each hypothesis that was not simulated, find a simulated one with some of its causes. The pairs are
        # indices.
        score = result.log_evidence + self.log_prior
        # Without a correction, a hypothesis that was not simulated seems to agree worse with the data than others. It
        # takes the correction of the most probable simulated hypothesis with a part of its causes. Both must have the
        # same measured causes, because these change the shape at rest.
        pairs = []
        for row in np.flatnonzero(~known):
            of_fit = self._measured.intersection(self.hypotheses[row])
            parts = [
                part
                for part in np.flatnonzero(known)
                if self.is_uncertain[part] == self.is_uncertain[row]
                and set(self.hypotheses[part]) < set(self.hypotheses[row])
                and self._measured.intersection(self.hypotheses[part]) == of_fit
            ]
            if parts:
                pairs.append((int(row), int(max(parts, key=lambda part: score[part]))))
        return pairs

    def _model_error(self, changes: Array) -> Array:
        # The variance (mm^2) of each of N coefficients. `changes` (c, N) are simulated changes of the coefficients.
        # The error after the corrections by better models, and an error of 1 per cent in each simulated change.
        of_moves = _OF_MOVE**2 * ((changes**2).sum(axis=0) + self._project.smooth(changes))
        return np.asarray(of_moves + self._project.smooth(self._coefficients.remaining))

    def _misfit(self, y: Array, amplitudes: Array) -> float:
        # The mean square of the linearised residuals, in units of the noise variance.
        return float(np.mean((y - (amplitudes / self._scale) @ self._rows) ** 2 / self._project.noise))

    def _minimised(self, row: int, amplitudes: Array) -> Array:
        # Least squares with simulations, for the unknowns of one hypothesis.
        trial = amplitudes.copy()
        trial[self._simulated_common : self._common] = 0.0
        best, least = trial.copy(), np.inf
        active = np.flatnonzero(trial[:-1]).tolist()
        scale = self._scale[active]
        slopes: Array | None = None
        step: Array = np.zeros(len(active))
        before: Array = np.zeros(0)
        for _ in range(_GAUSS_NEWTON):
            simulated = self._simulated(self.hypotheses[row], trial)
            if simulated is None:
                break
            residual = self._project.of(simulated)
            value = float((residual**2 / self._project.noise).sum() + ((trial / self._scale) ** 2).sum())
            if value >= least:
                break
            decrease, best, least = least - value, trial.copy(), value
            if decrease < _SMALL_DECREASE:
                break
            if slopes is None:
                slopes = self._slopes(row, trial, residual, active)
                if slopes is None:
                    break
            else:
                # Broyden 1965, Mathematics of Computation 19:577
                slopes = slopes + np.outer(step, residual - before - step @ slopes) / (step @ step)
            weighted = slopes / self._project.noise
            normal, score = weighted @ slopes.T + np.eye(len(active)), weighted @ residual + trial[active] / scale
            step, before = -np.asarray(np.linalg.solve(normal, score), float), residual
            trial[active] += step * scale
        return best

    def _slopes(self, row: int, amplitudes: Array, residual: Array, active: Sequence[int]) -> Array | None:
        # The derivatives of the residuals by the unknowns `active`.
        slopes = []
        for i in active:
            if self._law <= i < self._common:  # the linear model alone has these amplitudes
                slopes.append(self._rows[i])
                continue
            step, ahead = _LAW_STEP if i < self._common else _STEP, amplitudes.copy()
            ahead[i] += step * self._scale[i]
            simulated = self._simulated(self.hypotheses[row], ahead)
            if simulated is None:
                return None
            slopes.append((self._project.of(simulated) - residual) / step)
        return np.array(slopes)

    def _weigh(self, y: Array, of_move: Array) -> Posterior:
        self._variance = self._project.noise + of_move
        count = len(y) // len(self._members)
        parts = [
            self._evidence(y[i * count : (i + 1) * count], members, self.hypotheses[:count])
            for i, members in enumerate(self._members)
        ]
        return Posterior.of_all(parts)

    def _evidence(self, y: Array, members: NDArray[np.intp], hypotheses: Sequence[tuple[int, ...]]) -> Posterior:
        standard = weigh(self._rows, members, y, self._variance, self._project.error)
        # A cause of negligible size shall not explain small errors of the beam model. The factor has the effect of a
        # prior that vanishes at zero (a moment prior: Johnson and Rossell 2010, J. R. Stat. Soc. B 72:143).
        causes = range(len(self._causes))
        shown = [self._shown_rows(cause) for cause in causes]
        squares = np.stack([standard.squares[:, rows].max(axis=1) for rows in shown], axis=1)
        holds = np.array([[cause in hypothesis for cause in causes] for hypothesis in hypotheses])
        factors = 2 * np.log(np.where(holds, squares / (squares + NEGLIGIBLE**2), 1.0)).sum(axis=1)
        # The means are converted from prior standard deviations to the units of the unknowns.
        unit = self._about.unit[self._about.kept]  # the law stays inside its range, as in the simulations
        least, most = -_MOST_SIZES * self._scale, _MOST_SIZES * self._scale
        least[: self._law], most[: self._law] = -unit, 1 - unit
        means = np.clip(standard.means * self._scale, least, most)
        return replace(standard, log_evidence=standard.log_evidence + factors, means=means)

    def _probable(self, result: Posterior, far: float) -> list[int]:
        # The hypotheses that are probable enough to be simulated, as indices.
        score, rows = result.log_evidence + self.log_prior, []
        sizes = np.array([len(hypothesis) for hypothesis in self.hypotheses])
        for is_uncertain in np.unique(self.is_uncertain):
            order = np.argsort(-np.where(self.is_uncertain == is_uncertain, score, -np.inf))
            order = order[: (self.is_uncertain == is_uncertain).sum()]
            near = score[order] > score.max() - far
            if is_uncertain or any(column.start for column in self._columns):
                rows.append(int(np.flatnonzero(self.is_uncertain == is_uncertain)[0]))
            # A single cause of large amplitude may look improbable before it is simulated.
            singles = order[(sizes[order] == 1) & (near | (far == _FAR[0]))][:_SIMULATED]
            rows += [*singles.tolist(), *order[(sizes[order] == 2) & near][:_SIMULATED_PAIRS].tolist()]
        return rows

    def _simulated(self, hypothesis: tuple[int, ...], amplitudes: Array) -> list[Array] | None:
        given: dict[PossibleCause, list[tuple[Column, float]]] = {}
        for one, rows in zip(self._inputs, self._coefficients.of_inputs, strict=True):
            given[one] = [(self._coefficients.column(row), float(amplitudes[row])) for row in rows]
        for i, cause in enumerate(self._causes):
            columns = [self._coefficients.column(row) for row in self.blocks[i]]
            if i in hypothesis:
                given[cause] = list(zip(columns, amplitudes[self.blocks[i]].tolist(), strict=True))
            elif any(column.start for column in columns):
                given[cause] = [(column, 0.0) for column in columns]
        return self._about.simulated(amplitudes[: self._law], given)

    def remaining(self, row: int, amplitudes: Array) -> tuple[Array, ...] | None:
        """Simulate the residuals (mm) that remain after a correction for a combination of systematic errors."""
        # row: index of the combination. amplitudes: sizes of its errors.
        residuals = self._simulated(self.hypotheses[row], amplitudes)
        return None if residuals is None else tuple(residuals)

    def remaining_mm(self, amplitudes: Array) -> tuple[Array, ...]:
        """Return the root mean square residual (mm) of each load case after a correction for systematic errors."""
        # The residuals are linear in the amplitudes here; nothing is simulated.
        errors, rows = [], [*range(self._law, self._simulated_common), *range(self._common, len(self._scale) - 1)]
        for i, (residual, slopes, used) in enumerate(
            zip(self._stated, self._about.slopes, self._about.in_error, strict=True)
        ):
            remaining = residual + np.tensordot(amplitudes[: self._law], slopes, axes=1)
            for column, amplitude in zip(self._columns, amplitudes[rows], strict=True):
                if amplitude and (change := column.changes[i]) is not None:
                    remaining = remaining + amplitude * change
            square = (remaining**2 * (used > 0)).sum(axis=(1, 2))
            errors.append(np.sqrt(square / np.maximum(used.sum(axis=(1, 2)), 1.0)))
        return tuple(errors)

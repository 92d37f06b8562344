"""Collect all unknowns that may explain the residuals of a fit, such as the sizes of systematic errors."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.doubts.edge_coefficients import Projection
from eimi_fitting.inference.doubts.possible_causes import PossibleCause
from eimi_fitting.inference.doubts.signatures import Column, LinearisedFit
from eimi_fitting.inference.evidence.quantity import NORMAL_95
from eimi_fitting.inference.interval.noise import Effect

Array = NDArray[np.float64]

# Length that the remaining error of the meshes at the clamp adds; 0.007 mm on a virtual solid of 26 x 3 elements.
_CORNERS_MM = 0.01


@dataclass(frozen=True)
class Coefficients:
    """All unknowns that may explain the residuals of a fit, with their effects and prior standard deviations."""

    # There are C unknowns, in this order: changes of the law, errors of inputs, errors of the beam model, and sizes of
    # systematic errors ("causes").

    # (C + 1, N): change of the N polynomial coefficients of the residuals in mm, by one prior standard deviation of
    # each unknown. The last row is zero and belongs to no unknown.
    rows: Array
    # (C + 1,): prior standard deviation of each unknown, then 1.
    scale: Array
    # Number of unknowns of the law, then with the errors of inputs, then with the errors of the beam model.
    law: int
    simulated: int
    common: int
    # Indices of the unknowns of each input, and of each systematic error.
    of_inputs: list[list[int]]
    of_causes: list[list[int]]
    # Effects of the errors of inputs, then of the systematic errors.
    columns: list[Column]
    # (E, N): change of the N coefficients in mm by one standard error of each of E accurate beam models.
    remaining: Array

    @staticmethod
    def of(
        fit: LinearisedFit,
        project: Projection,
        effects: Sequence[Effect],
        stated: Mapping[PossibleCause, Sequence[Column]],
        columns_by_cause: Mapping[PossibleCause, Sequence[Column]],
    ) -> Coefficients:
        """Collect all unknowns that may explain the residuals of a fit."""
        # The error of the meshes is largest in the corners at the clamp, where it acts as a softer or stiffer clamp.
        corners = [c for cause, columns in columns_by_cause.items() if cause.name == "clamp_softness" for c in columns]
        inputs, of_causes = ([c for cs in some.values() for c in cs] for some in (stated, columns_by_cause))
        law = len(fit.law_spread)
        common = law + len(inputs) + len(effects) + len(corners)
        scale = [
            *fit.law_spread,
            *(column.size for column in inputs),
            *(effect.remaining_share for effect in effects),
            *([_CORNERS_MM] * len(corners)),
            *(column.size for column in of_causes),
            1.0,
        ]
        changes = [
            *(column.changes for column in inputs),
            *(effect.correction.changes for effect in effects),
            *(column.changes for column in (*corners, *of_causes)),
        ]
        slopes = [project.of(fit.slopes), *(project.of(change)[None] for change in changes)]
        # The last row is zero, for lists of indices that are filled up to one length.
        size = slopes[0].shape[-1]
        remaining = [effect.remaining_share / NORMAL_95 * project.of(effect.correction.changes) for effect in effects]
        return Coefficients(
            np.array(scale)[:, None] * np.concatenate([*slopes, np.zeros((1, size))]),
            np.array(scale),
            law,
            law + len(inputs),
            common,
            _blocks(stated.values(), law),
            _blocks(columns_by_cause.values(), common),
            [*inputs, *of_causes],
            np.array(remaining).reshape(len(effects), size),
        )

    def column(self, row: int) -> Column:
        """Return the change of the residuals by the input error or the systematic error with the index `row`."""
        return self.columns[row - self.law if row < self.common else row - self.law - self.common + self.simulated]


def _blocks(columns: Iterable[Sequence[Column]], first: int) -> list[list[int]]:
    # The columns are numbered from `first`.
    blocks = []
    for some in columns:
        blocks.append(list(range(first, first + len(some))))
        first += len(some)
    return blocks

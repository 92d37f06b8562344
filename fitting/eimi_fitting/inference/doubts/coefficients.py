"""Collect the unknown numbers that may explain the residuals of a fit, and the effect of each on the residuals.

The unknown numbers are called coefficients. They are the sizes of possible errors of the test bench (causes), changes
of the law, and errors of inputs within their uncertainties. Their effects on the residuals are described by polynomials
along each edge.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.doubts.edge_coefficients import Projection
from eimi_fitting.inference.doubts.possible_causes import PossibleCause
from eimi_fitting.inference.doubts.signatures import About, Column
from eimi_fitting.inference.evidence.quantity import NORMAL_95
from eimi_fitting.inference.interval.noise import Effect

Array = NDArray[np.float64]

# Length that the remaining error of the meshes at the clamp adds; 0.007 mm on a virtual solid of 26 x 3 elements.
_CORNERS_MM = 0.01


@dataclass(frozen=True)
class Coefficients:
    """The unknown numbers that may explain the residuals of a fit, and how each of them changes the residuals.

    There are four kinds of unknown numbers, in this order: changes of the law; errors of inputs within their
    uncertainties; sizes of the errors that better beam models, such as a finer mesh, do not correct; sizes of possible
    errors of the test bench (causes). The residuals are described by N coefficients of polynomials along the edges
    (`Projection`).

    Parameters
    ----------
    rows : ndarray, shape (C + 1, N)
        Change in mm of the N polynomial coefficients by one prior standard deviation of each of the C unknown numbers.
        The last row is zero, for lists of indices that are filled up to the same length.
    scale : ndarray, shape (C + 1,)
        Prior standard deviation of each unknown number; 1 for the last row.
    law, simulated, common : int
        How many unknown numbers belong to the first kind (``law``), to the first two kinds (``simulated``), and to the
        first three kinds (``common``).
    of_inputs, of_causes : list of list of int
        For each uncertain input (``of_inputs``) and each cause (``of_causes``), the indices of its unknown numbers.
    columns : list of Column
        Descriptions of the second and of the fourth kind.
    remaining : ndarray, shape (E, N)
        Changes in mm of the N polynomial coefficients by one standard deviation of the errors that remain after each of
        E corrections by better beam models. They give the root mean square of a further error, whose shape along an
        edge is unknown.
    """

    rows: Array
    scale: Array
    law: int
    simulated: int
    common: int
    of_inputs: list[list[int]]
    of_causes: list[list[int]]
    columns: list[Column]
    remaining: Array

    @staticmethod
    def of(
        about: About,
        project: Projection,
        effects: Sequence[Effect],
        stated: Mapping[PossibleCause, Sequence[Column]],
        columns_by_cause: Mapping[PossibleCause, Sequence[Column]],
    ) -> Coefficients:
        """Collect the unknown numbers that may explain the residuals of a fit, with their effects and prior spreads.

        Parameters
        ----------
        about : About
            The optimum of the fit, with the derivatives of the residuals.
        project : Projection
            The map from residuals to coefficients of polynomials along each edge.
        effects : sequence of Effect
            The corrections of the fit by better beam models, such as a finer mesh.
        stated, columns_by_cause : mapping of PossibleCause to sequence of Column
            The components of the error of each uncertain input (``stated``), such as x and y, and those of each
            possible error of the test bench.
        """
        # The error of the meshes is largest in the corners at the clamp, where it acts as a softer or stiffer clamp.
        corners = [c for cause, columns in columns_by_cause.items() if cause.name == "clamp_softness" for c in columns]
        inputs, of_causes = ([c for cs in some.values() for c in cs] for some in (stated, columns_by_cause))
        law = len(about.law_spread)
        common = law + len(inputs) + len(effects) + len(corners)
        scale = [
            *about.law_spread,
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
        slopes = [project.of(about.slopes), *(project.of(change)[None] for change in changes)]
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
        """Return the description of one unknown number: an error of an input, or an error of the test bench.

        ``row`` is the index of the number among all unknown numbers.
        """
        return self.columns[row - self.law if row < self.common else row - self.law - self.common + self.simulated]


def _blocks(columns: Iterable[Sequence[Column]], first: int) -> list[list[int]]:
    """Return consecutive indices, from ``first``, for the elements of several sequences: one list for each sequence."""
    blocks = []
    for some in columns:
        blocks.append(list(range(first, first + len(some))))
        first += len(some)
    return blocks

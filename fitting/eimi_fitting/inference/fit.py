"""The result of a fit: the part for a result file, and the residuals at the optimum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.doubts.causes import Cause
from eimi_fitting.inference.doubts.checks import Doubt
from eimi_fitting.inference.evidence.parameter_priors import Prior
from eimi_fitting.inference.evidence.tensile_curves import TensileEvidence
from eimi_fitting.inference.interval.estimate import Estimate
from eimi_fitting.inference.searching.polish import Polish
from eimi_fitting.inference.searching.search import Discards, Generation, Run
from eimi_fitting.laws.law import Law

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class IdentifiedLaw(Estimate):
    """An identified law for a result file: an `Estimate` with its errors, its doubts and its search.

    Parameters
    ----------
    mean_error_mm, mean_deviation_mm : float
        Mean over the states of the error, and of its standard deviation along the edges.
    max_stretch : float
        Largest stretch on the meshes of the experiments.
    priors : tuple of Prior
        Priors on the law's parameters.
    doubts : tuple of Doubt
        Doubts about the result.
    causes : tuple of Cause
        Possible causes of the residuals, the most probable first; empty in result files of earlier releases.
    evaluations, discarded, stop, runs, history
        History of the search, see `SearchResult`.
    generations : int
        Number of generations of the search.
    polish : Polish
        Improvement by the first polish.
    seed : int
        Seed of search and draws.
    wall_s : float
        Duration in seconds.
    """

    mean_error_mm: float
    mean_deviation_mm: float
    max_stretch: float
    priors: tuple[Prior, ...] = ()
    doubts: tuple[Doubt, ...]
    causes: tuple[Cause, ...] = ()
    evaluations: int
    generations: int
    discarded: Discards
    polish: Polish
    stop: str
    wall_s: float
    seed: int
    runs: tuple[Run, ...]
    history: tuple[Generation, ...]


@dataclass(frozen=True, kw_only=True)
class Fit(IdentifiedLaw):
    """An identified law with the residuals of the evidence.

    Parameters
    ----------
    law : Law
        The law.
    error_mm, deviation_mm : ndarray, shape (K,)
        Error and deviation of each state.
    residuals_mm : tuple of ndarray, shape (K, G, m)
        Residuals of each experiment, see `Misfit`; NaN for points that were not measured.
    curves : tuple of TensileEvidence
        The tensile curves with their noise.
    curve_rmse_Pa : tuple of float
        Root mean square residuals of the tensile curves in this fit.
    prior_distances : tuple of float
        Distances of the priors from the other evidence, see `Linearisation.prior_distances`.
    stable_to : float or None
        Largest stretch up to which the law is stable; None if it is stable up to ``stability_checked_to``.
    stability_checked_to : float
        Largest stretch that was checked.

    Examples
    --------
    `identify` returns a ``fit``. Its most important values are

    - ``fit.initial_shear_modulus.value`` and its ``interval_95``, in Pa,
    - ``fit.parameters["mu"]`` and the other parameters,
    - ``fit.identifiability.statement``, a summary of what the data determine.

    >>> from eimi_fitting import Fit
    >>> from dataclasses import fields
    >>> {"mean_error_mm", "initial_shear_modulus", "residuals_mm"} <= {field.name for field in fields(Fit)}
    True
    """

    law: Law
    error_mm: Array
    deviation_mm: Array
    residuals_mm: tuple[Array, ...]
    curves: tuple[TensileEvidence, ...]
    curve_rmse_Pa: tuple[float, ...]
    prior_distances: tuple[float, ...]
    stable_to: float | None
    stability_checked_to: float

    @property
    def values(self) -> Array:
        """The parameters in the order and the units of the law, (n,)."""
        return np.array([quantity.value for quantity in self.parameters.values()])

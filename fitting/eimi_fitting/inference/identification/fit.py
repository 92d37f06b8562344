"""The result of a fit of a hyperelastic law: `IdentifiedLaw` for a result file, and `Fit` with the residuals."""

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
    """An identified hyperelastic law with intervals, errors and warnings, as stored in a result file.

    It also has the fields of `Estimate`: the identified parameters with their intervals.

    Parameters
    ----------
    mean_error_mm : float
        Root mean square distance of measured from simulated points in mm, as the mean of all load cases.
    mean_deviation_mm : float
        Standard deviation of these distances in mm, as the mean of all load cases.
    max_stretch : float
        Largest stretch of the beam in planar models.
    priors : tuple of Prior
        Priors on the parameters of the law.
    doubts : tuple of Doubt
        Reasons to distrust the result.
    causes : tuple of Cause
        Possible causes of the residuals, such as a wrong width, the most probable first.
    evaluations, discarded, stop, runs, history
        Record of the search.
    generations : int
        Number of generations of the search.
    polish : Polish
        The first run of Gauss-Newton after the search.
    seed : int
        Seed of the random numbers.
    wall_s : float
        Duration of the fit in seconds.
    """

    mean_error_mm: float
    mean_deviation_mm: float
    max_stretch: float
    priors: tuple[Prior, ...] = ()
    doubts: tuple[Doubt, ...]
    # Result files of earlier releases have no causes.
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
    """An identified hyperelastic law, with the residuals at the optimum.

    It also has the fields of `IdentifiedLaw` and `Estimate`. There are K load cases.

    Parameters
    ----------
    law : Law
        The hyperelastic law.
    error_mm : ndarray, shape (K,)
        Root mean square distance of measured from simulated points in each load case, in mm.
    deviation_mm : ndarray, shape (K,)
        Standard deviation of these distances in each load case, in mm.
    residuals_mm : tuple of ndarray, shape (K, 2, m)
        Residuals of each experiment in mm, at m points of the two edges or in x and y of m tracked points. They are NaN
        for points that were not measured.
    curves : tuple of TensileEvidence
        The tensile curves with their noise.
    curve_rmse_Pa : tuple of float
        Root mean square residual of each tensile curve, in Pa.
    prior_distances : tuple of float
        Distance of each prior from the value that all other data give, in standard deviations.
    stable_to : float or None
        Largest stretch up to which the law is stable; None if the law is stable up to ``stability_checked_to``.
    stability_checked_to : float
        Largest stretch for which stability was checked.

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
        """The values of the parameters, in the order and the units of the law."""
        return np.array([quantity.value for quantity in self.parameters.values()])

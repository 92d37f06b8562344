"""How far the edges move when a parameter changes: one extra batch of candidates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.inference.evidence.measurements import edge_curves, points_on
from eimi_fitting.laws.law import Law

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Sensitivity:
    """P candidates with n parameters in K states.

    edges: (P, K, 2, m, 2) mm, left and right; slope: (P, n, K, 2, m, 2) mm per unit of the parameter; converged: (P,)
    the candidate and all its neighbours; the rows of the others mean nothing.
    """

    edges: Array
    slope: Array
    converged: NDArray[np.bool_]


def edge_sensitivity(
    model: BeamModel, law: Law, parameters: Array, loads: Loads, relative_step: float = 1e-4, per_segment: int = 2
) -> Sensitivity:
    """Edges of candidates (P, n) and their derivatives with respect to the parameters, by central differences.

    The step is ``relative_step`` of the parameter, or of the initial shear modulus (one, for an exponent) where the
    parameter is zero.
    """
    parameters = np.atleast_2d(np.asarray(parameters, float))
    p, n = parameters.shape
    modulus = np.abs(law.initial_shear_modulus(parameters))[:, None]
    size = np.where(np.array([unit == "1" for unit in law.units]), 1.0, modulus)
    step = relative_step * np.where(parameters != 0, np.abs(parameters), size)
    offsets = step[:, None, :] * np.concatenate([np.zeros((1, n)), np.eye(n), -np.eye(n)])
    shapes = model.solve(law, (parameters[:, None, :] + offsets).reshape(-1, n), loads, tolerance_mm=1e-8)
    edges = points_on(edge_curves(model, shapes), per_segment)
    edges = edges.reshape(p, 2 * n + 1, *edges.shape[1:])
    slope = (edges[:, 1 : n + 1] - edges[:, n + 1 :]) / (2 * step)[..., None, None, None, None]
    return Sensitivity(edges[:, 0], slope, np.asarray(shapes.converged.reshape(p, -1).all(axis=1)))

"""How far the edges move when a parameter changes: one extra batch of candidates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.actuation import Loads
from eimi_fitting.forward import BeamModel
from eimi_fitting.materials import Law
from eimi_fitting.observation import edge_curves, points_on

Array = NDArray[np.float64]


def edge_sensitivity(
    model: BeamModel, law: Law, parameters: Array, loads: Loads, relative_step: float = 1e-4, per_segment: int = 2
) -> tuple[Array, Array]:
    """Edges of one candidate (n,) and their derivatives with respect to its parameters, by central differences.

    Returns edges (K, 2, m, 2) in mm, left and right, and d(edges)/d(parameters) (n, K, 2, m, 2) in mm per unit of the
    parameter. The step is ``relative_step`` of the parameter, or of the initial shear modulus (one, for an exponent)
    where the parameter is zero. Raises ArithmeticError where a candidate finds no equilibrium.
    """
    parameters = np.asarray(parameters, float)
    n = len(parameters)
    size = np.array([1.0 if unit == "1" else float(law.initial_shear_modulus(parameters)) for unit in law.units])
    step = relative_step * np.where(parameters != 0, np.abs(parameters), size)
    batch = np.concatenate([parameters[None], parameters + np.diag(step), parameters - np.diag(step)])
    shapes = model.solve(law, batch, loads, tolerance_mm=1e-8)
    if not shapes.converged.all():
        raise ArithmeticError(f"{law.name}: no equilibrium at {parameters.tolist()} or beside it")
    edges = points_on(edge_curves(model, shapes), per_segment)
    return edges[0], (edges[1 : n + 1] - edges[n + 1 :]) / (2 * step)[:, None, None, None, None]

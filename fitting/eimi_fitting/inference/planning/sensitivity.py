"""Compute the derivatives of simulated edges by the parameters of a hyperelastic law."""

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
    """Simulated edges of the beam, and their derivatives by the parameters of a law."""

    # There are P sets of n parameters, K load cases, and m points on each of two edges.

    # (P, K, 2, m, 2): positions (x, y) in mm.
    edges: Array
    # (P, n, K, 2, m, 2): derivatives in mm per unit of the parameter.
    slope: Array
    # (P,): whether the edges and derivatives of a set are valid.
    converged: NDArray[np.bool_]


def edge_sensitivity(
    model: BeamModel, law: Law, parameters: Array, loads: Loads, relative_step: float = 1e-4, per_segment: int = 2
) -> Sensitivity:
    """Return the simulated edges of the beam, and their derivatives by the parameters of a law.

    Parameters
    ----------
    model : BeamModel
        The beam model.
    law : Law
        The hyperelastic law.
    parameters : ndarray, shape (P, n)
        P sets of n parameters in the order and units of the law.
    loads : Loads
        The loads.
    relative_step : float
        Step of the central difference as a share of the parameter, if the parameter is not zero.
    per_segment : int
        Number of points on each element along an edge.

    Returns
    -------
    Sensitivity
        Edges in mm, and their derivatives by the parameters in mm per unit of each parameter.

    Examples
    --------
    A horizontal strip bends downward under its weight, toward positive y. A stiffer strip bends less: the derivative of
    the y of the tip by the modulus is negative.

    >>> from eimi_fitting import LAWS, BeamModel, Loads, Specimen, edge_sensitivity
    >>> strip = Specimen(
    ...     length_mm=30.0, width_mm=3.0, depth_mm=10.0, density_kg_m3=1070.0, section="plane-stress"
    ... )
    >>> loads = Loads.along([0.0], gravity_angle_deg=90.0)
    >>> sensitivity = edge_sensitivity(BeamModel(strip), LAWS["neo-hookean"], np.array([46e3]), loads)
    >>> bool(sensitivity.slope[0, 0, 0, 0, -1, 1] < 0)
    True
    """
    parameters = np.atleast_2d(np.asarray(parameters, float))
    p, n = parameters.shape
    modulus = np.abs(law.initial_shear_modulus(parameters))[:, None]
    # For a zero parameter, the step is a share of the modulus, or of 1 for a parameter without unit.
    size = np.where(np.array([unit == "1" for unit in law.units]), 1.0, modulus)
    step = relative_step * np.where(parameters != 0, np.abs(parameters), size)
    offsets = step[:, None, :] * np.concatenate([np.zeros((1, n)), np.eye(n), -np.eye(n)])
    shapes = model.solve(law, (parameters[:, None, :] + offsets).reshape(-1, n), loads, tolerance_mm=1e-8)
    edges = points_on(edge_curves(model, shapes), per_segment)
    edges = edges.reshape(p, 2 * n + 1, *edges.shape[1:])
    slope = (edges[:, 1 : n + 1] - edges[:, n + 1 :]) / (2 * step)[..., None, None, None, None]
    return Sensitivity(edges[:, 0], slope, np.asarray(shapes.converged.reshape(p, -1).all(axis=1)))

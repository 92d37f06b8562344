"""A quick replacement for the equilibrium of a beam: a closed form that depends on every input of a simulation.

The shapes have no physical accuracy, but each input changes them in its own way, and smoothly.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from eimi_fitting.beam.beside import SolidBeside, SolidOptions, SolidShapes
from eimi_fitting.beam.depth_effect import DepthEffect
from eimi_fitting.beam.equilibrium import Configuration, Status
from eimi_fitting.beam.kinds_of_load import UniformField
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel, Shapes
from eimi_fitting.laws.law import Law

Array = np.ndarray
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)


def _curvatures(model: BeamModel, law: Law, parameters: Array, loads: Loads, factor: Array, bulk: Array | None) -> Any:
    # Return the mean curvature and its slope along the beam, (P, K) in 1/mm and 1/mm².
    specimen, magnet = model.specimen, model.specimen.magnet
    length, share = specimen.flexible_length_mm, np.linspace(0, 1, 9)
    width = model.grid.strip.width_mm(specimen.length_mm * share)
    depth = float(model.grid.strip.depth_mm(specimen.length_mm * share).mean())
    inertia = depth / 12 / float(np.mean((1.5 - share) / width**3))
    mu = law.initial_shear_modulus(parameters) * 1e-6
    young = (4.0 if model.plane == "plane-strain" else 3.0) * mu
    if bulk is not None:
        young = 4 * mu * (3e-6 * bulk + mu) / (3e-6 * bulk + 4 * mu)
    stiffness = (young * inertia)[:, None]
    others = sum((one.numbers for one in loads.others if isinstance(one, UniformField)), start=np.zeros(2))
    field = factor[:, None, None] * (loads.field_T + others)
    if magnet:
        turn = model.grid.turn_rad
        moment = magnet.moment_A_m2 * np.exp(1j * (turn + np.radians(magnet.magnetisation_angle_deg)))
        mass = magnet.density_kg_m3 * magnet.length_mm * magnet.width_mm * magnet.depth_mm
    else:
        moment = complex(*specimen.magnetisation_A_per_m) * 1e-9 * length * specimen.width_mm * depth
        mass = 0.0
    torque = 1e3 * (moment.real * field[..., 1] - moment.imag * field[..., 0])
    pull = 0.0 * torque
    if loads.coil:
        (along, across), size = loads.coil.gradient_per_m, np.linalg.norm(field, axis=-1)
        torque = torque * (1 + 0.02 * along - 0.03 * across)
        pull = size * abs(moment) * (across + 0.3 * along + 0.1 * loads.coil.curvature_per_m2)
    silicone = specimen.density_kg_m3 * length * specimen.width_mm * depth
    force = loads.tip_force_N[:, 1] + 1e-9 * (mass + 0.4 * silicone) * loads.gravity[:, 1] + pull
    stretched = loads.tip_force_N[:, 0] + 1e-9 * mass * loads.gravity[:, 0]
    kind = 1 - 0.012 * model.along**-1.19 - 0.001 * model.across**-1.19
    level = kind * (torque + 0.5 * length * force) / stiffness / (1 + 0.02 * length**2 * stretched / stiffness)
    slope = kind * force / stiffness
    ratios = 1e-6 * parameters[:, 1:] / mu[:, None] if parameters.shape[1] > 1 else np.zeros((len(parameters), 1))
    bend = (level * length) ** 2
    stiffer = 1 + 0.1 * bend + sum(0.2 / (i + 1) * ratios[:, i, None] * bend ** (i + 1) for i in range(ratios.shape[1]))
    return level / np.maximum(stiffer, 0.2), slope / np.maximum(stiffer, 0.2), ratios[:, :1]


def quick_shapes(
    self: BeamModel,
    law: Law,
    parameters: Array,
    loads: Loads,
    *,
    tolerance_mm: float = 1e-6,
    start: Configuration | None = None,
    bulk_modulus_Pa: Array | None = None,
    field_factor: Array | None = None,
    keep: bool = False,
    near: Configuration | None = None,
) -> Shapes:
    # Return shapes like `BeamModel.solve`, without a simulation; a bend above 2.5 rad is no equilibrium.
    parameters = np.atleast_2d(np.asarray(parameters, float))
    p, k = len(parameters), len(loads)
    factor = np.ones(p) if field_factor is None else field_factor
    level, slope, ratio = _curvatures(self, law, parameters, loads, factor, bulk_modulus_Pa)
    straight, flexible = self.grid.straight_mm, self.specimen.flexible_length_mm
    across = self.grid.strip.width_mm(straight[:, 0]) / self.specimen.width_mm
    along = straight[:, 0, None] * 0.5 * (1 + _NODES)

    def turned(s: Array) -> Array:
        s = np.minimum(s, flexible)
        return level[..., None, None] * s + 0.5 * slope[..., None, None] * s * (flexible - s)

    angle = turned(along)
    weights = 0.5 * straight[:, 0, None] * _WEIGHTS
    x = straight[:, 0] - (2 * np.sin(0.5 * angle) ** 2 * weights).sum(axis=-1)
    y = (np.sin(angle) * weights).sum(axis=-1)
    end = turned(straight[:, 0, None])[..., 0]
    thinner = 1 - 0.02 * (1 + ratio[..., None]) * np.abs(level[..., None]) * flexible
    offset = straight[:, 1] * across * thinner
    place = np.stack([x - offset * np.sin(end), y + offset * np.cos(end)], axis=-1)
    # The tolerance and the shapes from which the solution starts have a small effect, too.
    inexact = 1 + 0.01 * tolerance_mm + (0.0 if near is None else 1e-6 * np.abs(near.displacement).mean())
    displacement = inexact * (place - np.stack([straight[:, 0], straight[:, 1] * across], axis=-1))
    face = int(np.argmin(np.hypot(straight[:, 0] - flexible, straight[:, 1])))
    rigid = np.concatenate([displacement[:, :, face], end[:, :, face, None]], axis=-1)
    bend = np.abs(level) * flexible
    status = np.where(np.isfinite(bend) & (bend < 2.5), Status.CONVERGED, Status.DIVERGED)
    stretch = 1 + 0.5 * self.specimen.width_mm * np.abs(level + 0.5 * slope * flexible)
    status = np.where((status == 0) & (ratio * stretch < -0.6), Status.UNSTABLE, status).astype(np.int8)
    empty = np.zeros((0, k, 3)), np.zeros((3, 0, k, 1))
    every = Configuration(displacement[0], rigid[0], *empty) if keep else None
    last = Configuration(displacement[:, -1], rigid[:, -1], np.zeros((0, p, 3)), np.zeros((3, 0, p, 1)))
    return Shapes(displacement, rigid, status, np.full((p, k), 3), np.where(status == 0, stretch, 1.0), last, every)


def quick_solid(self: SolidBeside, law: Law, parameters: Array, loads: Loads, **options: Any) -> SolidShapes:
    # Return shapes like `SolidBeside.solve`: those of the quick planar beam, bent less by some per cent.
    chosen = options.pop("options", None) or SolidOptions()
    flat = quick_shapes(self.planar, law, parameters, loads, **options)
    inexact = 1e-6 * len(chosen.similar) + 2e-6 * (chosen.planar_shapes is not None) + 1e-3 * chosen.accuracy_mm
    inexact += 3e-6 * (chosen.earlier is not None)
    share = 1 - 0.04 * np.minimum(self.specimen.width_mm / self.specimen.depth_mm, 1.0) + inexact
    space = self._in_space(flat)[:, :, self._column]
    z = self.mesh.nodes[:, 2]
    narrower = np.stack([0 * z, -0.01 * self.mesh.nodes[:, 1] * (z / self.specimen.depth_mm) ** 2, 0 * z], axis=-1)
    displacement, rigid = share * space + narrower, share * flat.rigid
    empty = np.zeros((0, 1, 4)), np.zeros((6, 0, 1, 1))
    changes = [
        Configuration(one[None], turn[None], *empty)
        for one, turn in zip((displacement - space)[0], (rigid - flat.rigid)[0], strict=True)
    ]
    effect = DepthEffect(tuple(flat.rigid[0, :, 2].tolist()), tuple(changes), by_turn=True)
    return SolidShapes(**(vars(flat) | {"displacement": displacement, "rigid": rigid}), effect=effect)

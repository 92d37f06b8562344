"""The virtual specimen: its shape in equilibrium, computed as a three-dimensional solid in a magnetic field."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eimi_fitting.beam.beside import SolidBeside, SolidOptions
from eimi_fitting.beam.coil_field import CoilShape
from eimi_fitting.beam.depth_effect import DepthEffect
from eimi_fitting.beam.kinds_of_load import UniformField
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.outline import outline, points_on
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.beam.strip import Strip
from eimi_fitting.beam.view import View
from eimi_fitting.laws import LAWS
from eimi_lab.config.materials import TrueMaterial
from eimi_lab.virtual.moving_beam import MovingBeam
from eimi_lab.virtual.rod import stiffness_of_solid

Array = NDArray[np.float64]

SAME_FIELD_MT = 5e-5  # a smaller change of the field moves the tip by less than a thousandth of a pixel
_FIELDS = 17  # number of fields from zero to the strongest one; the solid is solved in some of these fields
# Largest numbers of elements for the stiffness of the rod that models the moving beam, in the order of `Virtual.mesh`.
# A finer mesh changes the frequency of the beam by less than the error of the rod model.
_MESH_OF_STIFFNESS = (
    16,
    2,
    1,
)
LOSS_FACTOR = 0.1
"""Assumed loss factor of a swinging beam whose material has no Prony series."""
# The solution for positive fields is also used for negative fields up to this fraction of the strongest field.
_BACKWARD = 0.05


@dataclass(frozen=True)
class VirtualLoads:
    """The loads on the virtual beam: its weight, the field of the coil and the background field.

    In the beam frame, x points from the clamp along the straight beam, and angles are counted from +x toward +y.

    Parameters
    ----------
    gravity_angle_deg, field_angle_deg
        Directions of gravity and of the coil's field in the beam frame, degrees. `gravity_angle_deg` is
        None without gravity.
    background_T
        Components x and y of the field without a current, in the beam frame, T.
    coil
        The field of the coil as a function of position; None for a uniform field.
    """

    gravity_angle_deg: float | None
    field_angle_deg: float
    background_T: tuple[float, float] = (0.0, 0.0)
    coil: CoilShape | None = None

    def at(self, field_mT: ArrayLike) -> Loads:
        """Return the loads on the beam for K values of the coil's field at the magnet, mT, shape (K,)."""
        loads = replace(Loads.along(field_mT, self.field_angle_deg, self.gravity_angle_deg), coil=self.coil)
        if not any(self.background_T):
            return loads
        return loads.plus(UniformField(np.tile(np.array(self.background_T), (len(loads), 1))))


class VirtualBeam:
    """A virtual specimen of a known material, which computes its shapes in equilibrium and its motion.

    Parameters
    ----------
    specimen
        The specimen, which is always modelled as a three-dimensional solid.
    material
        The true material of the specimen.
    mesh
        Number of elements along and across the beam, and number of elements in each part of the depth in addition to
        the usual number.
    loads
        The loads as a function of the field of the coil.
    strongest_mT
        Largest magnitude of the coil's field, mT.
    view
        The perspective of the camera; None for a picture without perspective.
    """

    def __init__(
        self,
        specimen: Specimen,
        material: TrueMaterial,
        mesh: tuple[int, int, int],
        loads: VirtualLoads,
        strongest_mT: float,
        view: View | None = None,
    ) -> None:
        self._specimen, self._material, self._mesh, self._loads = specimen, material, mesh, loads
        self._strongest_mT, self._view = strongest_mT, view
        self._field_mT: float | None = None

    def moves(self, field_mT: float) -> bool:
        """Return whether the beam moves visibly from the field of the last call of `outlines_mm` to this field (mT)."""
        return self._field_mT is None or abs(field_mT - self._field_mT) > SAME_FIELD_MT

    @property
    def relaxes(self) -> bool:
        """True if the stress of the material relaxes (if the material has a Prony series)."""
        return bool(self._material.prony_h)

    def moving(self) -> MovingBeam:
        """Return a model of the beam's motion, with the true viscoelastic law of its material.

        Raises ArithmeticError if the solid has no equilibrium under a small load.
        """
        material = self._material
        values, mesh = tuple(material.values), np.minimum(self._mesh, _MESH_OF_STIFFNESS).tolist()
        stiffness = stiffness_of_solid(self._specimen, material.model, values, (mesh[0], mesh[1], mesh[2]))

        def at(field_mT: float) -> tuple[Array, Array]:
            loads = replace(self._loads, coil=None).at([field_mT])
            background = self._loads.background_T
            return loads.field_T[0] + background, loads.gravity[0]

        series = material.series
        modulus = float(LAWS[material.model].initial_shear_modulus(np.array(values)))
        loss = 0.0 if series else LOSS_FACTOR
        return MovingBeam(self._specimen, stiffness, modulus, series, at, loss)

    def _solved(self, sign: float) -> tuple[SolidBeside, DepthEffect | None, float]:
        material, strongest_mT = self._material, sign * self._strongest_mT
        return _solved(self._specimen, material.model, tuple(material.values), self._mesh, self._loads, strongest_mT)

    def outlines_mm(self, field_mT: float) -> tuple[Array, Array | None]:
        """Return the outlines of the beam and of its magnet at rest in a field (mT), as the camera sees them.

        Returns
        -------
        beam : ndarray, shape (n, 2)
            The n points of the outline of the beam, mm, from the left end of the clamp line around the tip to the right
            end. x runs along the straight beam from the clamp, y across.
        magnet : ndarray, shape (4, 2), or None
            The corners of the magnet, mm; None without a magnet.

        Raises
        ------
        ArithmeticError
            If no equilibrium is found in this field.
        """
        sign = -1.0 if field_mT < -_BACKWARD * self._strongest_mT else 1.0
        material = self._material
        model, effect, reach_mT = self._solved(sign)
        options = SolidOptions(effect=effect if abs(field_mT) <= abs(reach_mT) else None)
        loads = self._loads.at(field_mT)
        shape = model.solve(LAWS[material.model], np.array([material.values]), loads, options=options)
        if not shape.converged[0]:
            raise ArithmeticError(f"no equilibrium of the virtual beam was found at {field_mT:g} mT")
        self._field_mT = field_mT
        left, right = points_on(outline(model, shape, self._view)[0, 0], 4)
        magnet = self._specimen.magnet
        if magnet is None:
            return np.concatenate([left, right[::-1]]), None
        strip = Strip(self._specimen)
        near, half = self._specimen.flexible_length_mm, 0.5 * min(magnet.width_mm, strip.straight.width_mm)
        far = near + magnet.length_mm
        straight = np.array([[near, -half], [far, -half], [far, half], [near, half]])
        corners = np.column_stack([strip.at_rest(straight), np.zeros(4)])
        return np.concatenate([left, right[::-1]]), model.positions(shape, corners)[0, 0, :, :2]


def forget_solids() -> None:
    """Free the memory of the solid models of all virtual beams."""
    _solved.cache_clear()
    _model.cache_clear()


@lru_cache(maxsize=2)
def _model(specimen: Specimen, mesh: tuple[int, int, int]) -> SolidBeside:
    return SolidBeside(specimen, *mesh)


@lru_cache(maxsize=16)
def _solved(
    specimen: Specimen,
    law: str,
    values: tuple[float, ...],
    mesh: tuple[int, int, int],
    virtual_loads: VirtualLoads,
    strongest_mT: float,
) -> tuple[SolidBeside, DepthEffect | None, float]:
    """Return the solid model, the difference between solid and planar shapes, and the field (mT) up to which it holds.

    This field is `strongest_mT`, or less if no equilibrium is found there. Without any equilibrium, the difference is
    None.
    """
    # A solid takes long to solve. It is solved in a few fields; between them, the difference between solid and planar
    # beam is interpolated, with an error below a micrometre (`eimi_fitting.beam.beside`).
    beside, reach_mT = _model(specimen, mesh), strongest_mT
    for _ in range(3):
        loads = virtual_loads.at(np.linspace(0, reach_mT, _FIELDS))
        effect = beside.solve(LAWS[law], np.array([values]), loads).effect
        if effect is not None and effect.by_turn:
            return beside, effect, reach_mT
        reach_mT *= 0.5
    return beside, None, 0.0

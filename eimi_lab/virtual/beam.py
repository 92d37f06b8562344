"""The virtual specimen: its shape in a field, on a mesh finer than any that the fit uses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.actuation import Loads
from eimi_fitting.forward import BeamModel, Shapes
from eimi_fitting.materials import LAWS
from eimi_fitting.observation import edge_curves, points_on
from eimi_fitting.specimen import Specimen
from eimi_lab.config.materials import TrueMaterial

Array = NDArray[np.float64]

_SAME_FIELD_MT = 5e-5  # moves the tip by less than a thousandth of a pixel


class VirtualBeam:
    """A specimen of a known material that takes its equilibrium shape at once; friction-free and without creep."""

    def __init__(
        self,
        specimen: Specimen,
        material: TrueMaterial,
        mesh: tuple[int, int],
        gravity_angle_deg: float,
        field_angle_deg: float,
    ) -> None:
        self._model = BeamModel(specimen, *mesh)
        self._law = LAWS[material.model]
        self._parameters = np.array([material.values])
        self._gravity_angle_deg, self._field_angle_deg = gravity_angle_deg, field_angle_deg
        self._field_mT: float | None = None
        self._shape: Shapes | None = None

    def moves(self, field_mT: float) -> bool:
        """Whether this field bends the beam visibly further than the one of the last outline."""
        return self._field_mT is None or abs(field_mT - self._field_mT) > _SAME_FIELD_MT

    def outlines_mm(self, field_mT: float) -> tuple[Array, Array | None]:
        """Outline of the whole beam (n, 2), clamp-left over the tip to clamp-right, and of the magnet (4, 2)."""
        loads = Loads.along(field_mT, self._field_angle_deg, self._gravity_angle_deg)
        start = self._shape.last if self._shape else None
        shape = self._model.solve(self._law, self._parameters, loads, start=start)
        if not shape.converged[0]:
            raise ArithmeticError(f"the virtual beam finds no equilibrium at {field_mT:g} mT")
        self._shape, self._field_mT = shape, field_mT
        left, right = points_on(edge_curves(self._model, shape)[0, 0], 8)
        spec = self._model.specimen
        if spec.magnet is None:
            return np.concatenate([left, right[::-1]]), None
        near, half = spec.flexible_length_mm, 0.5 * spec.magnet.width_mm
        far = near + spec.magnet.length_mm
        corners = np.array([[near, -half], [far, -half], [far, half], [near, half]])
        return np.concatenate([left, right[::-1]]), self._model.carried(shape, corners)[0, 0]

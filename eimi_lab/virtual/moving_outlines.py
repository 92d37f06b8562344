"""The outlines of the moving virtual beam: those of the solid in equilibrium plus the displacement of a rod model."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy
from numpy.typing import NDArray

from eimi_fitting.beam.specimen import Specimen
from eimi_lab.virtual.moving_beam import MovingBeam

Array = NDArray[np.float64]
Outlines = tuple[Array, Array | None]

_GRID = 17  # number of fields in which the shape is solved


class MovingOutlines:
    """The outlines of the moving beam and of its magnet, computed with a rod model of the beam.

    Parameters
    ----------
    outlines_mm : callable
        Takes a field of the coil (mT). Returns the outlines (mm) of the beam and of the magnet (None without a magnet)
        in equilibrium.
    moving : MovingBeam
        The rod model, which computes the motion.
    specimen : Specimen
        The true specimen.
    strongest_mT : float
        Largest field of the coil, mT.

    Raises
    ------
    ArithmeticError
        If no equilibrium is found in one of the fields.
    """

    def __init__(
        self, outlines_mm: Callable[[float], Outlines], moving: MovingBeam, specimen: Specimen, strongest_mT: float
    ) -> None:
        self._rod = moving.rod
        fields = np.linspace(-strongest_mT, strongest_mT, _GRID)
        solved = [outlines_mm(float(field)) for field in fields]
        self._beam = scipy.interpolate.CubicSpline(fields, np.stack([beam for beam, _ in solved]))
        magnets = [magnet for _, magnet in solved if magnet is not None]
        self._magnet = scipy.interpolate.CubicSpline(fields, np.stack(magnets)) if len(magnets) == len(fields) else None
        rest: list[Array] = []
        for field in fields:
            rest.append(moving.at_rest(float(field), rest[-1] if rest else None))
        self._at_rest = scipy.interpolate.CubicSpline(fields, np.stack(rest))
        turned = np.stack(rest) @ self._rod.end
        order = np.argsort(turned)
        self._fields, self._turned = fields[order], turned[order]
        flexible = specimen.flexible_length_mm
        left, right = np.split(self._beam(0.0), 2)
        right = right[::-1]
        middle = 0.5 * (left + right)
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(middle, axis=0).T))])
        along *= specimen.length_mm / along[-1] / flexible
        half = 0.5 * np.hypot(*(right - left).T)
        self._along, self._across = np.concatenate([along, along[::-1]]), np.concatenate([-half, half[::-1]])
        if specimen.magnet:
            far = 1 + specimen.magnet.length_mm / flexible
            half_magnet = 0.5 * min(specimen.magnet.width_mm, 2 * float(half.max()))
            self._along = np.append(self._along, [1.0, far, far, 1.0])
            self._across = np.append(self._across, half_magnet * np.array([-1.0, -1.0, 1.0, 1.0]))

    def at(self, coordinates: Array) -> Outlines:
        """Return the outlines of the beam and of the magnet for given coordinates of the rod.

        Parameters
        ----------
        coordinates : ndarray, shape (n,)
            Bending, hinge angle, stretching and shear of the rod (`Rod`).

        Returns
        -------
        beam : ndarray, shape (m, 2)
            The m points of the beam's outline, mm (x along the straight beam from the clamp, y across).
        magnet : ndarray, shape (4, 2), or None
            The corners of the magnet, mm; None without a magnet.
        """
        # Take the solid in the field in which the tip of the rod at rest has the same angle as the tip of the moving
        # rod. Move its outlines by the difference between the moving rod and the rod at rest in this field.
        field = float(np.interp(self._rod.end @ coordinates, self._turned, self._fields))
        shift = self._rod.places_mm(coordinates, self._along, self._across)
        shift = shift - self._rod.places_mm(self._at_rest(field), self._along, self._across)
        beam = self._beam(field)
        magnet = None if self._magnet is None else self._magnet(field) + shift[len(beam) :]
        return beam + shift[: len(beam)], magnet

"""The loads on one specimen in a sequence of load states: the sum of several kinds of load."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eimi_fitting.beam.kinds_of_load import CoilField, Gravity, Pressure, TipForce, UniformField
from eimi_fitting.beam.specimen import STANDARD_GRAVITY

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from eimi_fitting.beam.actuation import Actuation, LoadedMesh
    from eimi_fitting.beam.coil_field import CoilShape
    from eimi_fitting.beam.equilibrium import SolidLoads

Array = NDArray[np.float64]


def _direction(angle_deg: ArrayLike) -> Array:
    """Return the unit vector (x, y) at one or several angles in degrees."""
    return np.array([np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))])


@dataclass(frozen=True)
class Loads:
    """The loads on one specimen in a sequence of load states, in the beam frame.

    Parameters
    ----------
    field_T : ndarray, shape (K, 2)
        Magnetic flux density in T, in K load states. Every vector has the components x and y.
    gravity : ndarray, shape (K, 2)
        Acceleration of gravity in m/s².
    tip_force_N : ndarray, shape (K, 2)
        Force in N at the point ``Specimen.tip_load_mm``, which is the middle of the tip by default. This is the total
        force over the depth of the specimen, for a planar model too.
    pressure_Pa : array_like, shape (K,) or ()
        Pressure on the specimen's pressure face in Pa, positive if it pushes on the body; one value for all states or
        one for each state.
    others : tuple of Actuation
        Further kinds of load.
    coil : CoilShape or None
        The ratio of the field at any point to ``field_T``, the field at the position of the magnet at rest. None: the
        field is uniform.

    Examples
    --------
    A beam that hangs down, in two states: without a field, and with a field of 7 mT across the beam:

    >>> loads = Loads.along([0.0, 7.0])
    >>> loads.field_T.round(6).tolist()
    [[0.0, 0.0], [0.0, 0.007]]
    """

    field_T: Array
    gravity: Array
    tip_force_N: Array
    pressure_Pa: ArrayLike = 0.0
    others: tuple[Actuation, ...] = ()
    coil: CoilShape | None = None

    @staticmethod
    def along(
        field_mT: ArrayLike,
        field_angle_deg: float = 90.0,
        gravity_angle_deg: float | None = 0.0,
        tip_force_N: ArrayLike = 0.0,
        pressure_Pa: ArrayLike = 0.0,
        tip_force_angle_deg: ArrayLike | None = None,
    ) -> Loads:
        """Return loads from their magnitudes and angles.

        All angles are in the beam frame, from +x toward +y.

        Parameters
        ----------
        field_mT : array_like, shape (K,) or ()
            Magnitude of the field in mT, in K load states.
        field_angle_deg : float
            Direction of the field.
        gravity_angle_deg : float or None
            Direction of gravity; None if gravity does not bend the beam.
        tip_force_N : array_like, shape (K,) or ()
            Force at the tip in N.
        pressure_Pa : array_like, shape (K,) or ()
            Pressure on the side of the beam that ``Specimen.pressure_face`` describes, in Pa.
        tip_force_angle_deg : array_like, shape (K,) or (), or None
            Direction of the tip force; None: the direction of gravity.

        Raises
        ------
        ValueError
            A tip force has no direction: neither its angle nor the angle of gravity is given.
        """
        magnitude, force, angle, _ = np.broadcast_arrays(
            np.atleast_1d(np.asarray(field_mT, float)),
            np.asarray(tip_force_N, float),
            0.0 if tip_force_angle_deg is None else np.asarray(tip_force_angle_deg, float),
            np.asarray(pressure_Pa, float),
        )
        down = np.zeros(2) if gravity_angle_deg is None else _direction(gravity_angle_deg)
        if tip_force_angle_deg is None:
            if gravity_angle_deg is None and np.any(force != 0):
                raise ValueError(
                    "the tip force has no direction: give tip_force_angle_deg, or gravity_angle_deg for a force along "
                    "gravity"
                )
            along = down
        else:
            along = _direction(angle).T
        return Loads(
            1e-3 * magnitude[:, None] * _direction(field_angle_deg),
            np.tile(STANDARD_GRAVITY * down, (len(magnitude), 1)),
            force[:, None] * along,
            pressure_Pa,
        )

    def plus(self, *actuations: Actuation) -> Loads:
        """Return these loads together with other kinds of load.

        Raises
        ------
        ValueError
            The loads do not have the same number of states.
        """
        for actuation in actuations:
            if len(actuation.numbers) != len(self):
                raise ValueError(
                    f"{type(actuation).__name__} has {len(actuation.numbers)} states, but the other loads have "
                    f"{len(self)}: give one row of numbers for each state"
                )
        return replace(self, others=(*self.others, *actuations))

    @cached_property
    def actuations(self) -> tuple[Actuation, ...]:
        """All kinds of load: field, gravity, tip force and pressure, then ``others``."""
        pressure = np.broadcast_to(np.asarray(self.pressure_Pa, float), len(self))
        return (
            UniformField(self.field_T) if self.coil is None else CoilField(self.field_T, self.coil),
            Gravity(self.gravity),
            TipForce(self.tip_force_N),
            Pressure(pressure[:, None]),
            *self.others,
        )

    def __len__(self) -> int:
        return len(self.field_T)

    def take(self, states: NDArray[np.intp]) -> Loads:
        """Return the loads in some of the load states only."""
        pressure = np.asarray(self.pressure_Pa, float)
        return Loads(
            self.field_T[states],
            self.gravity[states],
            self.tip_force_N[states],
            pressure[states] if pressure.ndim else pressure,
            tuple(actuation.take(states) for actuation in self.others),
            self.coil,
        )

    @staticmethod
    def joined(parts: Sequence[Loads]) -> Loads:
        """Join the load states of several loads into one sequence."""
        # The field varies in space as in the first part. Parts may have fewer ``others`` than the longest.
        most = max((part.others for part in parts), key=len)
        return replace(
            parts[0],
            field_T=np.concatenate([part.field_T for part in parts]),
            gravity=np.concatenate([part.gravity for part in parts]),
            tip_force_N=np.concatenate([part.tip_force_N for part in parts]),
            pressure_Pa=np.concatenate([np.broadcast_to(np.asarray(part.pressure_Pa), len(part)) for part in parts]),
            others=tuple(_joined(kind, place, parts) for place, kind in enumerate(most)),
        )

    def state(self, k: int) -> Array:
        """Return all components of the loads in one state as a vector."""
        return np.concatenate([actuation.numbers[k] for actuation in self.actuations])

    def at_rest(self) -> Array:
        """Return the components of all loads in an unloaded state: a vector of zeros."""
        return np.zeros(sum(actuation.numbers.shape[1] for actuation in self.actuations))

    def on(self, mesh: LoadedMesh) -> Callable[[Array, Array], SolidLoads]:
        """Return a function that computes the loads on a mesh in one load state."""
        # Its arguments are the components of the loads (m,), and a factor on magnetic loads for each of B laws (B,).
        return partial(mesh.loads, self.actuations)


def _joined(kind: Any, place: int, parts: Sequence[Loads]) -> Actuation:
    """Join the states of one kind of load, such as a pressure, from several sets of loads."""
    # It is zero in the sets without this kind.
    # ``place``: the index of this kind in ``others`` of each part.
    nothing = np.zeros(kind.numbers.shape[1])
    numbers = [
        part.others[place].numbers if place < len(part.others) else np.tile(nothing, (len(part), 1)) for part in parts
    ]
    joined: Actuation = replace(kind, numbers=np.concatenate(numbers))
    return joined

"""List the systematic errors of the loads, and the softening of the beam, which acts like a larger load."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.loads import Loads
from eimi_fitting.inference.doubts.possible_causes import BOTH_POLARITIES, Assumed, Change, PossibleCause, of_source
from eimi_fitting.inference.evidence.sources import with_gradient

Array = NDArray[np.float64]

_GRADIENT_AT_M = 0.01  # distance at which a curved field has the gradient that is given as its size


def _by_loads(loads_of: Callable[[Loads, Array], Loads]) -> Change:
    def change(assumed: Assumed, amplitudes: Array) -> Assumed:
        loads = loads_of(assumed.experiment.loads, amplitudes)
        return replace(assumed, experiment=replace(assumed.experiment, loads=loads))

    return change


def _softened(loads: Loads, stiffness: Array) -> Loads:
    # Larger loads have the same effect as a softer beam.
    over = 1 / stiffness[:, None]
    return replace(
        loads, field_T=over * loads.field_T, gravity=over * loads.gravity, tip_force_N=over * loads.tip_force_N
    )


def _crept(loads: Loads, amplitudes: Array) -> Loads:
    # As if the beam steadily lost the share amplitudes[0] of its stiffness during the run.
    return _softened(loads, 1 - amplitudes[0] * np.linspace(0, 1, len(loads)))


def strengths(loads: Loads) -> Array:
    """Return, for each load state, field / largest field + tip force / largest tip force."""
    sizes = [np.linalg.norm(load, axis=1) for load in (loads.field_T, loads.tip_force_N)]
    return np.asarray(sum(size / size.max() for size in sizes if size.max() > 0) + np.zeros(len(loads)))


def directions_of_change(loads: Loads) -> Array:
    """Return 1 for each load that was reached by an increase, and -1 for each that was reached by a decrease."""
    steps = np.sign(np.round(np.diff(strengths(loads), prepend=-1e-3), 6))
    for k in range(1, len(steps)):
        steps[k] = steps[k] or steps[k - 1]
    return np.asarray(steps)


def _lagging(loads: Loads, amplitudes: Array) -> Loads:
    # As if the beam were softer, by the share amplitudes[0], after each decrease of the load.
    return _softened(loads, 1 - amplitudes[0] * (directions_of_change(loads) < 0))


def _graded(loads: Loads, amplitudes: Array) -> Loads:
    # The amplitudes are relative changes per metre: along the beam, across it, and along the axis of the coil at a
    # distance of 10 mm from the magnet.
    # The third gradient is zero at the magnet of the straight beam and increases linearly along the axis of the coil.
    return with_gradient(loads, amplitudes[:2], float(amplitudes[2]) / (2 * _GRADIENT_AT_M))


CAUSES_IN_LOADS: tuple[PossibleCause, ...] = (
    of_source(
        "moment",
        "moment",
        (0.05,),
        "the field of the magnet at a known distance, or a bending test with weights in place of the field",
        ("remanence", "coil", "magnet-length", "magnet-width", "magnet-depth"),
    ),
    of_source("field_direction", "field", (2.0,), "the direction of the field with a gaussmeter (field_angle_deg)"),
    PossibleCause(
        "field_gradient",
        "uneven field of the coil",
        "1/m",
        (2.0, 2.0, 2.0),
        _by_loads(_graded),
        "the field at several places with a gaussmeter",
        "field-gradient",
    ),
    of_source(
        "background_field",
        "background-field",
        (0.05, 0.05),
        f"{BOTH_POLARITIES}, or a gaussmeter at zero current",
        ("offset",),
    ),
    PossibleCause(
        "creep",
        "softening during the run",
        "1",
        (0.1,),
        _by_loads(_crept),
        "one current repeated at the beginning and at the end of the run",
    ),
    PossibleCause(
        "hysteresis",
        "softening after a decrease of the load",
        "1",
        (0.05,),
        _by_loads(_lagging),
        "the same currents with increasing and with decreasing steps",
    ),
)

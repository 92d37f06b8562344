"""Set-points and steps of the current in the file, on the clock of the run.

    set_points         every set-point that was sent: `time`, `current`, `uncertainty`
    ring_down_steps    one row for each recorded ring-down: the step to zero, and what the camera did

A set-point takes effect between the moment at which it is sent and the moment at which the supply answers; `time` is
the middle of these two moments, and `uncertainty` is the standard deviation of a uniform distribution between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields

import h5py
import numpy as np

from eimi_lab.config.protocol import Protocol
from eimi_lab.dataset.layout import append, columns, group

SET_POINTS, RING_DOWN_STEPS = "set_points", "ring_down_steps"

_SET_POINT_COLUMNS = {"time": ("f8", "s"), "current": ("f8", "A"), "uncertainty": ("f8", "s")}
_STEP_COLUMNS: dict[str, tuple[str, str | None]] = {
    "ring_down": ("i8", None),
    "from_current": ("f8", "A"),
    "to_current": ("f8", "A"),
    "time": ("f8", "s"),
    "uncertainty": ("f8", "s"),
    "frames": ("i8", None),
    "lost": ("i8", None),
    "rate": ("f8", "Hz"),
}


@dataclass(frozen=True)
class SetPoint:
    """A set-point: its time on the clock of the run (s), the current (A), and the uncertainty of the time (s)."""

    time_s: float
    current_A: float
    uncertainty_s: float


@dataclass(frozen=True)
class RingDownStep:
    """A recorded ring-down.

    Parameters
    ----------
    ring_down : int
        Number of the ring-down, from 0.
    from_A, to_A : float
        Current before and after the step.
    time_s, uncertainty_s : float
        Time of the step on the clock of the run, and its standard uncertainty.
    frames, lost : int
        Number of frames that were stored, and of frames that the camera counted but that did not arrive.
    rate_Hz : float
        Frames per second, from the times of the frames.
    """

    ring_down: int
    from_A: float
    to_A: float
    time_s: float
    uncertainty_s: float
    frames: int
    lost: int
    rate_Hz: float


def records_steps(protocol: Protocol | None) -> bool:
    """Return whether a run with this protocol stores its set-points."""
    return protocol is not None and (protocol.creep or protocol.ring_down is not None)


def make_steps(entry: h5py.Group, protocol: Protocol | None) -> None:
    """Create the empty tables of set-points and ring-downs, if the protocol needs them."""
    if records_steps(protocol):
        columns(group(entry, SET_POINTS, "NXcollection"), dict(_SET_POINT_COLUMNS))
    if protocol is not None and protocol.ring_down is not None:
        columns(group(entry, RING_DOWN_STEPS, "NXcollection"), _STEP_COLUMNS)


def append_set_points(store: dict[str, h5py.Dataset], set_points: Sequence[SetPoint]) -> None:
    """Append set-points to the columns of the table of set-points."""
    if store and set_points:
        for name, values in zip(_SET_POINT_COLUMNS, zip(*map(astuple, set_points), strict=True), strict=True):
            append(store[name], values)
            store[name].flush()


def append_step(store: dict[str, h5py.Dataset], step: RingDownStep) -> None:
    """Append a ring-down to the columns of the table of ring-downs."""
    for name, value in zip(_STEP_COLUMNS, astuple(step), strict=True):
        append(store[name], [value])
        store[name].flush()


def read_set_points(entry: h5py.Group) -> tuple[SetPoint, ...]:
    """Return the set-points of a run in their order; empty if the run did not store them."""
    return tuple(SetPoint(*map(float, row)) for row in _rows(entry, SET_POINTS, list(_SET_POINT_COLUMNS)))


def read_steps(entry: h5py.Group) -> tuple[RingDownStep, ...]:
    """Return the recorded ring-downs in their order."""
    kinds = {"int": int, "float": float}
    of_field = [kinds[str(field.type)] for field in fields(RingDownStep)]
    rows = _rows(entry, RING_DOWN_STEPS, list(_STEP_COLUMNS))
    return tuple(RingDownStep(*(kind(value) for kind, value in zip(of_field, row, strict=True))) for row in rows)


def _rows(entry: h5py.Group, name: str, names: list[str]) -> np.ndarray:
    if name not in entry:
        return np.zeros((0, len(names)))
    store = entry[name]
    count = min(len(store[column]) for column in names)
    return np.column_stack([store[column][:count] for column in names])

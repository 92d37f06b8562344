"""Store and read set-points of the current, and the steps of the current after which the beam vibrates freely.

The current changes between the sending of a set-point and the answer of the supply. The stored time is the middle of
this interval, with the standard deviation of a uniform distribution over the interval.
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
    """A set-point that was sent to the supply: the current, and the time at which the current changed.

    Parameters
    ----------
    time_s : float
        Time of the change on the clock of the run, s.
    current_A : float
        The new set-point, A.
    uncertainty_s : float
        Standard uncertainty of the time, s.
    """

    time_s: float
    current_A: float
    uncertainty_s: float


@dataclass(frozen=True)
class RingDownStep:
    """The step of the current with which a free oscillation (ring-down) began, and the number of recorded frames.

    Parameters
    ----------
    ring_down : int
        Number of the free oscillation, from 0.
    from_A, to_A : float
        Current before and after the step, A.
    time_s, uncertainty_s : float
        Time of the step on the clock of the run, and its standard uncertainty, s.
    frames : int
        Number of stored frames.
    lost : int
        Number of lost frames (gaps in the camera's frame numbers).
    rate_Hz : float
        Frames per second.
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
    """Return whether a run stores its set-points: only if its protocol asks for creep or free oscillations."""
    return protocol is not None and (protocol.creep or protocol.ring_down is not None)


def make_steps(entry: h5py.Group, protocol: Protocol | None) -> None:
    """Create empty tables of set-points and of free oscillations in a new dataset, if the protocol needs them."""
    if records_steps(protocol):
        columns(group(entry, SET_POINTS, "NXcollection"), dict(_SET_POINT_COLUMNS))
    if protocol is not None and protocol.ring_down is not None:
        columns(group(entry, RING_DOWN_STEPS, "NXcollection"), _STEP_COLUMNS)


def append_set_points(store: dict[str, h5py.Dataset], set_points: Sequence[SetPoint]) -> None:
    """Append rows to the columns of the table of set-points, ``store``; do nothing if ``store`` is empty."""
    if store and set_points:
        for name, values in zip(_SET_POINT_COLUMNS, zip(*map(astuple, set_points), strict=True), strict=True):
            append(store[name], values)
            store[name].flush()


def append_step(store: dict[str, h5py.Dataset], step: RingDownStep) -> None:
    """Append one row to the table of free oscillations, whose columns by name are in ``store``."""
    for name, value in zip(_STEP_COLUMNS, astuple(step), strict=True):
        append(store[name], [value])
        store[name].flush()


def read_set_points(entry: h5py.Group) -> tuple[SetPoint, ...]:
    """Return the set-points of a run in the order of time; empty if the run did not store set-points."""
    return tuple(SetPoint(*map(float, row)) for row in _rows(entry, SET_POINTS, list(_SET_POINT_COLUMNS)))


def read_steps(entry: h5py.Group) -> tuple[RingDownStep, ...]:
    """Return the steps of the coil current with which the recorded free oscillations began; empty if none."""
    kinds = {"int": int, "float": float}
    of_field = [kinds[str(field.type)] for field in fields(RingDownStep)]
    rows = _rows(entry, RING_DOWN_STEPS, list(_STEP_COLUMNS))
    return tuple(RingDownStep(*(kind(value) for kind, value in zip(of_field, row, strict=True))) for row in rows)


def count_steps(entry: h5py.Group) -> int | None:
    """Return the number of recorded free oscillations; None if the dataset has no table for them."""
    return len(read_steps(entry)) if RING_DOWN_STEPS in entry else None


def _rows(entry: h5py.Group, name: str, names: list[str]) -> np.ndarray:
    if name not in entry:
        return np.zeros((0, len(names)))
    store = entry[name]
    count = min(len(store[column]) for column in names)
    return np.column_stack([store[column][:count] for column in names])

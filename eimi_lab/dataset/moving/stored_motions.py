"""Store motions of the beam in a dataset, and read stored motions.

Each motion has an HDF5 group in `ring_down_points` or `creep_points`, with arrays such as `points` (n, p, 2) for p
points in n frames and `history` (h, 2) for the times and currents of the h set-points before the motion.
"""

from __future__ import annotations

from collections.abc import Sequence

import h5py
import numpy as np

from eimi_fitting.time.measured import Kind, Motion
from eimi_lab.dataset.layout import get_text, group, put_text
from eimi_lab.dataset.moving.beam_modes import modal_amplitudes_mm, tip_angles_deg
from eimi_lab.dataset.moving.recording_checks import flag_names

GROUPS: dict[Kind, str] = {"ring_down": "ring_down_points", "creep": "creep_points"}

# The group of a motion of p points in n frames contains points (n, p, 2), time and sigma (n, p), rest (p, 2), history
# (h, 2: times and currents of the h set-points before the motion), flags (names of failed checks) and, for viewers,
# tip_angle (n,) and modal_amplitudes (n, m). Single numbers are attributes.
_NUMBERS = ("from_A", "to_A", "step_uncertainty_s", "lost_frames", "tip_force_N", "hanging_N")
_ARRAYS = {"points": "mm", "time": "s", "sigma": "mm", "rest": "mm"}


def write_motions(entry: h5py.Group, kind: Kind, motions: Sequence[Motion], length_mm: float) -> None:
    """Store the free oscillations, or the creep, of a dataset, and remove the stored motions of this kind.

    Parameters
    ----------
    entry : h5py.Group
        The HDF5 group that contains the whole dataset.
    kind : {"ring_down", "creep"}
        Kind of all motions.
    motions : sequence of Motion
        The motions in the order in which they were recorded. Without motions, nothing is stored.
    length_mm : float
        Length of the beam, mm.
    """
    if GROUPS[kind] in entry:
        del entry[GROUPS[kind]]
    if not motions:
        return
    store = group(entry, GROUPS[kind], "NXcollection")
    for number, motion in enumerate(motions):
        _write(group(store, str(number), "NXdata"), motion, length_mm)


def drop_motions(entry: h5py.Group) -> None:
    """Remove the stored free oscillations and the creep from a dataset, if there are any."""
    for name in GROUPS.values():
        if name in entry:
            del entry[name]


def _write(store: h5py.Group, motion: Motion, length_mm: float) -> None:
    store.attrs["signal"] = "points"
    store.attrs["axes"] = [".", ".", "."]
    values = (motion.points_mm, motion.time_s, motion.sigma_mm, motion.rest_mm)
    for (name, unit), array in zip(_ARRAYS.items(), values, strict=True):
        store.create_dataset(name, data=array, compression="gzip", compression_opts=1, fletcher32=True)
        store[name].attrs["units"] = unit
    store["history"] = np.array(motion.history, dtype=float).reshape(-1, 2)
    store["tip_angle"] = tip_angles_deg(motion)
    store["tip_angle"].attrs["units"] = "degrees"
    store["modal_amplitudes"] = modal_amplitudes_mm(motion, length_mm)
    store["modal_amplitudes"].attrs["units"] = "mm"
    for name in _NUMBERS:
        store.attrs[name] = getattr(motion, name)
    store.attrs["exposure_s"] = np.nan if motion.exposure_s is None else motion.exposure_s
    put_text(store, "label", motion.label)
    put_text(store, "flags", " ".join(flag_names(motion)))


def read_motions(entry: h5py.Group, kind: Kind) -> tuple[Motion, ...]:
    """Return the stored motions of the beam of one kind, in the order of recording.

    `entry` is the HDF5 group of the whole dataset. `kind` is "ring_down" (free oscillation) or "creep".
    """
    store = entry.get(GROUPS[kind], {})
    return tuple(_read(store[str(number)], kind) for number in range(len(store)))


def _read(store: h5py.Group, kind: Kind) -> Motion:
    points, time, sigma, rest = (np.asarray(store[name][()], dtype=float) for name in _ARRAYS)
    exposure_s = float(store.attrs["exposure_s"])
    numbers = {name: float(store.attrs[name]) for name in _NUMBERS if name != "lost_frames"}
    return Motion(
        kind=kind,
        points_mm=points,
        rest_mm=rest,
        time_s=time,
        sigma_mm=sigma,
        exposure_s=None if np.isnan(exposure_s) else exposure_s,
        history=tuple((float(time_s), float(current_A)) for time_s, current_A in store["history"][()]),
        lost_frames=int(store.attrs["lost_frames"]),
        label=get_text(store, "label"),
        **numbers,
    )

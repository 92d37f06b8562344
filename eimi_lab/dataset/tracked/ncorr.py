"""Ncorr's saved analysis, a MATLAB file: displacements on a grid of pixels of the reference picture.

Source of the format: `callback_topmenu_savedata` and the description of `data_dic` in ncorr.m of
github.com/justinblaber/ncorr_2D_matlab. Ncorr saves as version 7.3, which is HDF5; one that was saved again as
version 7 is read as well. data_dic_save.displacements(i).plot_u_ref_formatted is the displacement of picture i, seen
from the reference picture, in units; dispinfo.pixtounits is a pixel's size in them and dispinfo.spacing the number of
pixels passed over. Outside the region of interest it is 0.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from eimi_lab.dataset.tracked.numbers_table import refused
from eimi_lab.dataset.tracked.tracks import Tracks
from eimi_lab.process.errors import InputError

Array = NDArray[np.float64]
_SAVED = "data_dic_save"


def read_ncorr(path: Path) -> Tracks:
    """The displacements of every picture; the reference picture is frame 0, the first current one 1.

    Raises InputError.
    """
    try:
        moved, spacing, pixel = _of_hdf5(path) if h5py.is_hdf5(path) else _of_matlab_7(path)
    except (KeyError, IndexError, ValueError, TypeError, AttributeError, MatReadError, OSError) as error:
        raise refused(path, "Ncorr", f"it should hold {_SAVED} with displacements and dispinfo ({error})") from error
    if not moved or any(u.size == 0 or u.ndim != 2 for u, _ in moved):
        raise InputError(f"{path}: holds no formatted displacements; run Ncorr's step 'Format Displacements' and save")
    if len({part.shape for pair in moved for part in pair}) > 1 or not pixel > 0:
        raise refused(path, "Ncorr", "the displacements of all pictures should be on one grid, and pixtounits above 0")
    u, v = (np.stack([pair[k] for pair in moved]) / pixel for k in (0, 1))
    seen = (u != 0.0) | (v != 0.0)
    row, column = np.nonzero(seen.any(axis=0))
    if not len(row):
        raise InputError(f"{path}: has no place that moved at all")
    rest: Array = (spacing + 1.0) * np.column_stack([column, row]).astype(np.float64)
    there = rest + np.stack([u[:, row, column], v[:, row, column]], axis=-1)
    there[~seen[:, row, column]] = np.nan
    return Tracks(
        names=tuple(f"{x:.0f},{y:.0f}" for x, y in rest),
        frames=np.arange(len(moved) + 1),
        places=np.concatenate([rest[None], there]),
        rest=rest,
        unit="px",
        image_axes=True,
    )


def _of_hdf5(path: Path) -> tuple[list[tuple[Array, Array]], float, float]:
    """Displacements (rows, columns) u and v of each picture, the spacing, and a pixel's size."""
    with h5py.File(path, "r") as file:
        saved = file[_SAVED]
        info, displacements = saved["dispinfo"], saved["displacements"]

        def each(name: str) -> list[Array]:
            """A structure of one has the array itself in it, one of several references to them; all are transposed."""
            field = displacements[name]
            items = [file[reference] for reference in np.ravel(field[()])] if field.dtype == h5py.ref_dtype else [field]
            return [_array(item).T for item in items]

        pairs = list(zip(each("plot_u_ref_formatted"), each("plot_v_ref_formatted"), strict=True))
        return pairs, float(np.ravel(info["spacing"][()])[0]), float(np.ravel(info["pixtounits"][()])[0])


def _array(item: h5py.Dataset) -> Array:
    empty = "MATLAB_empty" in item.attrs and bool(item.attrs["MATLAB_empty"])
    return np.zeros((0, 0)) if empty else np.asarray(item[()], dtype=np.float64)


def _of_matlab_7(path: Path) -> tuple[list[tuple[Array, Array]], float, float]:
    saved: Any = loadmat(path, squeeze_me=True, struct_as_record=False)[_SAVED]
    pairs = [
        (np.asarray(one.plot_u_ref_formatted, dtype=np.float64), np.asarray(one.plot_v_ref_formatted, dtype=np.float64))
        for one in np.atleast_1d(saved.displacements)
    ]
    return pairs, float(saved.dispinfo.spacing), float(saved.dispinfo.pixtounits)

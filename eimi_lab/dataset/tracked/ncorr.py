"""Read the analysis that the image correlation program Ncorr saves as a MATLAB file: displacements on a grid of pixels.

Displacements are in the user's unit, and 0 outside the region of interest. Source: `callback_topmenu_savedata`, and the
description of `data_dic`, in ncorr.m of github.com/justinblaber/ncorr_2D_matlab.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy
from numpy.typing import NDArray

from eimi_lab.dataset.tracked.numbers_table import refused
from eimi_lab.dataset.tracked.tracks import Tracks
from eimi_lab.process.errors import InputError

Array = NDArray[np.float64]
# The file is a MATLAB file of version 7.3 (HDF5), or of version 7 if it was saved again.
# data_dic_save.displacements(i).plot_u_ref_formatted is the displacement of picture i relative to the reference
# picture. dispinfo.pixtounits is the size of a pixel in the unit of the file. dispinfo.spacing is the number of pixels
# between neighbouring points of the grid.
_SAVED = "data_dic_save"


def read_ncorr(path: Path) -> Tracks:
    """Return the positions of the grid points in an Ncorr file in each frame, px. Frame 0 is the reference picture.

    Raises InputError if the file is not an analysis of Ncorr, or if it contains no displacements.
    """
    try:
        displacements, spacing, pixel = _of_hdf5(path) if h5py.is_hdf5(path) else _of_matlab_7(path)
    except (
        KeyError,
        IndexError,
        ValueError,
        TypeError,
        AttributeError,
        scipy.io.matlab.MatReadError,
        OSError,
    ) as error:
        raise refused(path, "Ncorr", f"it should hold {_SAVED} with displacements and dispinfo ({error})") from error
    if not displacements or any(u.size == 0 or u.ndim != 2 for u, _ in displacements):
        raise InputError(f"{path}: holds no formatted displacements; run Ncorr's step 'Format Displacements' and save")
    if len({part.shape for pair in displacements for part in pair}) > 1 or not pixel > 0:
        raise refused(path, "Ncorr", "the displacements of all pictures should be on one grid, and pixtounits above 0")
    u, v = (np.stack([pair[k] for pair in displacements]) / pixel for k in (0, 1))
    in_region = (u != 0.0) | (v != 0.0)
    row, column = np.nonzero(in_region.any(axis=0))
    if not len(row):
        raise InputError(f"{path}: contains no displacement other than 0; check the analysis in Ncorr")
    rest: Array = (spacing + 1.0) * np.column_stack([column, row]).astype(np.float64)
    places = rest + np.stack([u[:, row, column], v[:, row, column]], axis=-1)
    places[~in_region[:, row, column]] = np.nan
    return Tracks(
        names=tuple(f"{x:.0f},{y:.0f}" for x, y in rest),
        frames=np.arange(len(displacements) + 1),
        places=np.concatenate([rest[None], places]),
        rest=rest,
        unit="px",
        image_axes=True,
    )


def _of_hdf5(path: Path) -> tuple[list[tuple[Array, Array]], float, float]:
    """Return the displacements (x, y) of each picture, the number of pixels between grid points, and the pixel size.

    Displacements have the shape (rows, columns). Displacements and pixel size are in the unit of the file.
    """
    with h5py.File(path, "r") as file:
        saved = file[_SAVED]
        info, displacements = saved["dispinfo"], saved["displacements"]

        def each(name: str) -> list[Array]:
            field = displacements[name]
            items = [file[reference] for reference in np.ravel(field[()])] if field.dtype == h5py.ref_dtype else [field]
            return [_array(item).T for item in items]

        pairs = list(zip(each("plot_u_ref_formatted"), each("plot_v_ref_formatted"), strict=True))
        return pairs, float(np.ravel(info["spacing"][()])[0]), float(np.ravel(info["pixtounits"][()])[0])


def _array(item: h5py.Dataset) -> Array:
    empty = "MATLAB_empty" in item.attrs and bool(item.attrs["MATLAB_empty"])
    return np.zeros((0, 0)) if empty else np.asarray(item[()], dtype=np.float64)


def _of_matlab_7(path: Path) -> tuple[list[tuple[Array, Array]], float, float]:
    saved: Any = scipy.io.loadmat(path, squeeze_me=True, struct_as_record=False)[_SAVED]
    pairs = [
        (np.asarray(one.plot_u_ref_formatted, dtype=np.float64), np.asarray(one.plot_v_ref_formatted, dtype=np.float64))
        for one in np.atleast_1d(saved.displacements)
    ]
    return pairs, float(saved.dispinfo.spacing), float(saved.dispinfo.pixtounits)

"""Apply the magnetic field of a calibration to loads: the shape of the coil's field, and the background field."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.coil_field import CoilShape
from eimi_fitting.beam.kinds_of_load import UniformField
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.specimen import Specimen
from eimi_lab.config.calibration import Calibration
from eimi_lab.process.errors import InputError
from eimi_lab.vision.beam_frame import BeamFrame


def in_stated_field(loads: Loads, calibration: Calibration, specimen: Specimen) -> Loads:
    """Add to loads what a calibration says about the field: its variation in space, and the background field.

    The coil's field varies in space if the calibration describes the coil or contains a map of the field. The
    background field is the field without a current.

    Parameters
    ----------
    loads
        The loads, with the coil's field at the magnet, T.
    calibration
        The calibration.
    specimen
        The specimen.

    Raises
    ------
    InputError
        If a loop of the coil passes through the beam, or if the map of the measured field in the calibration does not
        cover the magnet.
    """
    background_T = stated_background_T(calibration)
    loads = replace(loads, coil=stated_coil(calibration, specimen))
    if not background_T.any():
        return loads
    return loads.plus(UniformField(np.tile(background_T, (len(loads), 1))))


def stated_coil(calibration: Calibration, specimen: Specimen) -> CoilShape | None:
    """Return the shape of the coil's field that a calibration gives, or None if the field is uniform.

    Raises
    ------
    InputError
        If a loop of the coil passes through the beam, or if the map of the measured field does not cover the magnet.
    """
    if calibration.field is None or not calibration.field.is_uneven:
        return None
    try:
        return calibration.field.shape(specimen, BeamFrame(calibration).field_deg)
    except ValueError as error:
        raise InputError(f"calibration.field: {error}") from error


def stated_background_T(calibration: Calibration) -> NDArray[np.float64]:
    """Return the background field of a calibration, that is, the field without a current: x and y in T, shape (2,).

    x is along the straight beam, and y across it. The field is 0 if the calibration gives none.
    """
    return 1e-3 * BeamFrame(calibration).components(calibration.background_field_mT or (0.0, 0.0))

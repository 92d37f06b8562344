"""Add the background field, and the spatial variation of the field of the coil, to load states."""

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
    """Add the spatial variation of the coil's field and the background field to loads.

    Parameters
    ----------
    loads
        Loads with the coil's field at the magnet, T.
    calibration
        The calibration, which describes both fields.
    specimen
        The specimen.

    Raises
    ------
    InputError
        If a loop of the coil passes through the beam, or if the map of the measured field does not cover the magnet.
    """
    background_T = stated_background_T(calibration)
    loads = replace(loads, coil=stated_coil(calibration, specimen))
    if not background_T.any():
        return loads
    return loads.plus(UniformField(np.tile(background_T, (len(loads), 1))))


def stated_coil(calibration: Calibration, specimen: Specimen) -> CoilShape | None:
    """Return the spatial variation of the coil's field, or None if the field is uniform.

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
    """Return the background field (without a current) along and across the undeformed beam, T, shape (2,)."""
    return 1e-3 * BeamFrame(calibration).components(calibration.background_field_mT or (0.0, 0.0))

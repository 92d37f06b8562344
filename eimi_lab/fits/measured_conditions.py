"""The loads and uncertainties of a dataset whose magnetic field was measured."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from eimi_fitting.beam.kinds_of_load import UniformField
from eimi_fitting.beam.loads import Loads
from eimi_fitting.inference.evidence.sources import StatedSource
from eimi_lab.dataset.reading import Dataset
from eimi_lab.dataset.state import State
from eimi_lab.vision.field_at_beam import stated_background_T

REPLACED = frozenset({"coil", "offset"})
"""The sources of uncertainty that a measured field replaces."""


def with_measured_offset(loads: Loads, dataset: Dataset) -> Loads:
    """Return loads with the measured field at zero current as the background field along the axis of the coil."""
    line = dataset.field_line
    if line is None or dataset.calibration is None:
        return loads
    angle = np.radians(dataset.field_angle_deg)
    axis = np.array([np.cos(angle), np.sin(angle)])
    more_T = 1e-3 * line.offset_mT - float(stated_background_T(dataset.calibration) @ axis)
    return loads.plus(UniformField(np.tile(more_T * axis, (len(loads), 1))))


def stated_by_measurement(dataset: Dataset, states: Sequence[State]) -> tuple[StatedSource, ...]:
    """Return the standard uncertainties of a measured field: one of the scale factor, and one of the offset.

    The result is empty if the field was not measured.
    """
    if (line := dataset.field_line) is not None:
        share = line.mT_per_A_sigma / abs(line.mT_per_A)
        return (StatedSource("coil", share, line.probe), StatedSource("offset", line.offset_mT_sigma, line.probe))
    stated = [(abs(s.field_mT), s.field_sigma_mT) for s in states if s.field_sigma_mT is not None]
    if not stated:
        return ()
    (_, weakest_sigma), (strongest_mT, strongest_sigma) = min(stated), max(stated)
    of = f"measured fields of {dataset.path.name}"
    sources = (StatedSource("offset", weakest_sigma, of),)
    return (StatedSource("coil", strongest_sigma / strongest_mT, of), *sources) if strongest_mT else sources

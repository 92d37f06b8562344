"""The loads and uncertainties of a dataset whose field was measured.

A measured field replaces the coil constant in the calibration. The slope of the measured line of field against current
(`dataset.measured_field`) is used as the coil constant, and the offset of the line as a background field. Both have the
uncertainties of the line.
"""

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
    """Return loads whose background field along the axis of the coil is the measured field without a current.

    This field is the offset of the line that was fitted to the readings of the gaussmeter. It replaces the background
    field that the calibration gives along the axis. Without a measured field the loads are unchanged.
    """
    line = dataset.field_line
    if line is None or dataset.calibration is None:
        return loads
    angle = np.radians(dataset.field_angle_deg)
    axis = np.array([np.cos(angle), np.sin(angle)])
    more_T = 1e-3 * line.offset_mT - float(stated_background_T(dataset.calibration) @ axis)
    return loads.plus(UniformField(np.tile(more_T * axis, (len(loads), 1))))


def stated_by_measurement(dataset: Dataset, states: Sequence[State]) -> tuple[StatedSource, ...]:
    """Return the standard uncertainties of a measured field: one of its scale factor, and one of its offset.

    A fit assumes that the errors of the scale factor and of the offset are the same in all states. If the field was
    read from a gaussmeter, a line of field against current was fitted, and the uncertainties of its slope and of its
    offset are returned. Imported data may instead give one uncertainty for each state. Then the scale factor has the
    relative uncertainty of the strongest field, and the offset has the uncertainty of the weakest field. The result is
    empty if the field was not measured.
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

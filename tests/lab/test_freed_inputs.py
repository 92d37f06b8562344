"""If a fit has estimated a quantity of the specimen, the validation of the fit uses the estimated value."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eimi_fitting import LAWS, BeamModel, Experiment, Loads, Magnet, PointObservation, Specimen, identify
from eimi_fitting.inference.evidence.sources import StatedSource
from eimi_lab.dataset.state import State
from eimi_lab.fits.evidence import Evidence
from eimi_lab.fits.prediction import validate
from eimi_lab.fits.records import FitRecord
from eimi_lab.fits.states_used import StatesUsed

NOISE_MM = 2e-3


def test_a_validation_uses_the_direction_of_magnetisation_that_the_fit_has_estimated() -> None:
    magnet = Magnet(4.0, 3.0, 2.0, 1.2, 7500.0)
    beam = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-stress", magnet)
    tilted = BeamModel(replace(beam, magnet=replace(magnet, magnetisation_angle_deg=3.0)), 26, 2)
    fields_mT = (0.0, 6.0, -6.0)
    loads = Loads.along(fields_mT)
    rest = np.column_stack([np.linspace(3, 25, 8), np.zeros(8)])
    moved = tilted.positions(tilted.solve(LAWS["neo-hookean"], np.array([[46e3]]), loads), rest)[0]
    moved += np.random.default_rng(1).normal(0, NOISE_MM, moved.shape)
    observed = PointObservation(np.tile(rest, (3, 1, 1)), moved, np.full((3, 8), NOISE_MM))
    stated = (StatedSource("magnetisation-angle", 3.0, "specimen 1"),)
    experiment = Experiment(BeamModel(beam), loads, observed, stated=stated)
    states = tuple(State(index, 0.0, None, field_mT, 0.0, ()) for index, field_mT in enumerate(fields_mT))
    evidence = Evidence(Path("points.h5"), "0" * 64, experiment, states, StatesUsed(3, (), ()))
    fit = FitRecord.of(identify("neo-hookean", [experiment]), [evidence])
    assert fit.freed[0].deviation.value == pytest.approx(3.0, abs=0.1)
    validation = validate(evidence, fit, Path("fits.json"), 0)
    assert validation.mean_error_mm == pytest.approx(fit.mean_error_mm, rel=0.2)
    assert validation.mean_error_interval_mm is not None
    assert validation.mean_error_interval_mm[1] is not None
    assert validation.mean_error_interval_mm[1] < 5 * fit.mean_error_mm

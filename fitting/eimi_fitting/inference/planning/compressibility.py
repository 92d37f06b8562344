"""Estimate the error of a modulus if an incompressible law is fitted to a compressible material."""

from __future__ import annotations

import numpy as np

from eimi_fitting.beam.beside import SolidBeside
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.outline import outline, points_on
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.inference.evidence.experiment import TOLERANCE_MM
from eimi_fitting.inference.evidence.measurements import signed_distance
from eimi_fitting.inference.planning.section_bias import ACROSS, ALONG, MODULUS_PA, bending_loads
from eimi_fitting.laws import LAWS

_STEP = 0.02  # of the logarithm of the modulus, for the difference quotient


def bulk_ratio(poisson_ratio: float) -> float:
    """Return the ratio of bulk modulus to shear modulus for a Poisson's ratio."""
    return 2 * (1 + poisson_ratio) / (3 * (1 - 2 * poisson_ratio))


def compressibility_bias(specimen: Specimen, poisson_ratio: float) -> float:
    """Return the relative error of a shear modulus if an incompressible law is fitted to a compressible material."""
    # The bending of a slender beam depends on Young's modulus alone: 2 mu (1 + nu) of the material is 3 mu of the fit.
    if specimen.section == "plane-stress":
        return 2 * (1 + poisson_ratio) / 3 - 1
    law, planar = LAWS["neo-hookean"], BeamModel(specimen, ALONG, ACROSS, specimen.planar_section)
    model = SolidBeside(specimen, ALONG, ACROSS) if specimen.section == "solid" else planar
    loads = bending_loads(planar)
    moduli = MODULUS_PA * np.exp([0.0, _STEP])
    true = model.solve(
        law,
        moduli[:1, None],
        loads,
        tolerance_mm=TOLERANCE_MM,
        bulk_modulus_Pa=np.array([bulk_ratio(poisson_ratio) * MODULUS_PA]),
    )
    target = points_on(outline(model, true)[0], 2)
    here, ahead = (
        signed_distance(outline(model, shapes), target[None]).ravel()
        for shapes in (model.solve(law, modulus[None, None], loads, tolerance_mm=TOLERANCE_MM) for modulus in moduli)
    )
    slope = (ahead - here) / _STEP
    return float(np.expm1(-slope @ here / (slope @ slope)))

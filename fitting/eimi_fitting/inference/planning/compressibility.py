"""Estimate the error of a modulus that is identified as incompressible although Poisson's ratio is below one half.

A fit assumes K = 10^4 mu, which is a Poisson's ratio of 0.49995, unless the bulk modulus is searched. A material with
the ratio nu has K = 2 mu (1 + nu) / (3 (1 - 2 nu)). The outline of a solid with this K is fitted by an incompressible
model, as in `inference.planning.section_bias`. In plane stress a slender beam bends by Young's modulus E = 2 mu (1 +
nu) alone, so that the error is 2 (1 + nu) / 3 - 1.
"""

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
    """Return the ratio of bulk modulus to shear modulus for a Poisson's ratio below 0.5."""
    return 2 * (1 + poisson_ratio) / (3 * (1 - 2 * poisson_ratio))


def compressibility_bias(specimen: Specimen, poisson_ratio: float) -> float:
    """Return the relative error of a modulus that is identified as if the material were incompressible.

    Parameters
    ----------
    specimen : Specimen
    poisson_ratio : float
        True Poisson's ratio at small strain, below 0.5.

    Returns
    -------
    float
        Identified modulus divided by the true one, minus one.
    """
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

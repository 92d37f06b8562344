"""Estimate the error of a modulus if an incompressible law is fitted to a compressible material.

A material with the shear modulus mu and Poisson's ratio nu < 1/2 has the bulk modulus K = 2 mu (1 + nu) / (3 (1 - 2
nu)). A fit assumes K = 10^4 mu, which means nu = 0.49995, unless K is an unknown of the fit. To find the error of the
fitted mu, the outline of a beam with the true K is simulated, and an incompressible model is fitted to this outline.

In plane stress no simulation is needed, because the bending of a slender beam depends on Young's modulus E alone. The
material has E = 2 mu (1 + nu), and an incompressible law with the modulus mu_fit has E = 3 mu_fit. The fit therefore
gives mu_fit = 2 mu (1 + nu) / 3, with the relative error 2 (1 + nu) / 3 - 1.
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
    """Return bulk modulus / shear modulus, 2 (1 + nu) / (3 (1 - 2 nu)), for a Poisson's ratio nu < 0.5."""
    return 2 * (1 + poisson_ratio) / (3 * (1 - 2 * poisson_ratio))


def compressibility_bias(specimen: Specimen, poisson_ratio: float) -> float:
    """Return the relative error of a shear modulus if an incompressible law is fitted to a compressible material.

    Parameters
    ----------
    specimen : Specimen
        The specimen whose bending is simulated.
    poisson_ratio : float
        True Poisson's ratio at small strain, below 0.5.

    Returns
    -------
    float
        Identified modulus divided by the true modulus, minus one.
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

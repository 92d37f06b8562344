"""How wrong a planar section is to be expected to make a modulus: the outline of the solid, fitted under that section.

Noise, light and law are of no account for it, proportions are; one rest and two bent states of a Neo-Hookean solid are
enough to know it to a per cent of the modulus. `benchmarks.hidden_solids` shows it beside whole fits.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.beside import SolidBeside, SolidOptions
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.outline import outline, points_on
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.inference.evidence.experiment import TOLERANCE_MM
from eimi_fitting.inference.evidence.measurements import signed_distance
from eimi_fitting.laws import LAWS

Array = NDArray[np.float64]

_MODULUS_PA = 50e3  # of no account: the load follows it
_LINEAR_TURN_DEG = 60.0  # of the largest load, if the beam stayed as stiff as it is at rest: about 45 in fact
_ALONG, _ACROSS = 13, 1  # elements: within 0.3 % of the modulus of what 20 x 4 say, in a third of a fit's mesh's time
_STEP = 0.02


def expected_bias(specimen: Specimen) -> float:
    """Share by which a modulus identified under the specimen's planar section differs from the solid's.

    Raises ValueError for a specimen that the solid model does not take.
    """
    law = LAWS["neo-hookean"]
    beside = SolidBeside(replace(specimen, section="solid"), _ALONG, _ACROSS)
    planar = BeamModel(specimen, beside.planar.along, beside.planar.across)
    loads = _loads(planar)
    stated, stiffer = (np.array([[_MODULUS_PA * np.exp(step)]]) for step in (0.0, _STEP))
    here = planar.solve(law, stated, loads, tolerance_mm=TOLERANCE_MM, keep=True)
    ahead = planar.solve(law, stiffer, loads, tolerance_mm=TOLERANCE_MM, near=here.every)
    options = SolidOptions(planar_shapes=here if beside.has_mesh_of(planar) else None)
    solid = beside.solve(law, stated, loads, tolerance_mm=TOLERANCE_MM, options=options)
    target = points_on(outline(beside, solid)[0], 2)
    # One step of Gauss-Newton: another would move it by 0.1 % of the modulus where it is a quarter, and by less else.
    off, off_ahead = (signed_distance(outline(planar, own), target[None]).ravel() for own in (here, ahead))
    slope = (off_ahead - off) / _STEP
    return float(np.expm1(-slope @ off / (slope @ slope)))


def _loads(planar: BeamModel) -> Loads:
    """Fields across the beam or, without any magnet, tip forces: half of the largest load, and all of it."""
    specimen, law, modulus = planar.specimen, LAWS["neo-hookean"], np.array([[_MODULUS_PA]])
    magnetic = specimen.magnet is not None or any(specimen.magnetisation_A_per_m)
    stiffness_N = 1e-6 * _MODULUS_PA * specimen.width_mm**3 * specimen.depth_mm / specimen.length_mm**2

    def of(share: Array) -> Loads:
        given = Loads.along(
            share if magnetic else 0 * share, gravity_angle_deg=90.0, tip_force_N=0 * share if magnetic else share
        )
        return replace(given, gravity=0 * given.gravity)

    little = 1e-3 if magnetic else 1e-3 * stiffness_N
    turn = planar.tip_angle_deg(planar.solve(law, modulus, of(np.array([little])), tolerance_mm=1e-9))[0, 0]
    return of(np.array([0.5, 1.0]) * little * _LINEAR_TURN_DEG / abs(turn))

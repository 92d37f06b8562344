"""Small effects on a free vibration that are estimated but not corrected, such as the air."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eimi_fitting.beam.inertia import Inertia
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.specimen import Specimen

_AIR_DENSITY_KG_M3 = 1.2
_AIR_VISCOSITY_M2_S = 1.5e-5
_CONDUCTIVITY_S_M = 6.3e5  # of sintered Nd-Fe-B
_COIL_OHM = 2.0


@dataclass(frozen=True)
class SmallEffect:
    """An effect on a free vibration that is estimated but not corrected, such as the air."""

    # `source`, `words`: key and name of the effect.
    source: str
    words: str
    # Contribution to the standard uncertainty of the dynamic modulus.
    modulus_percent: float
    # Contribution to the standard uncertainty of the loss factor.
    loss: float


def small_effects(
    specimen: Specimen, loads: Loads, frequency_Hz: float, loss: float, gain: float, exposure_s: float | None
) -> tuple[SmallEffect, ...]:
    """Estimate small effects on the modulus and the loss factor, such as that of the air."""
    # ``gain``: derivative of ln(modulus) by ln(frequency). ``exposure_s``: exposure time of a frame, or None.
    omega = 2 * np.pi * frequency_Hz
    width, depth, length = (1e-3 * v for v in (specimen.width_mm, specimen.depth_mm, specimen.length_mm))
    line = specimen.density_kg_m3 * width * depth
    inertia = Inertia(BeamModel(specimen, plane=specimen.planar_section))
    body = inertia.body_mass * 1e3 * specimen.depth_mm
    # The first mode of a uniform cantilever carries a quarter of its mass at the tip.
    effective = 0.25 * line * length + body
    # The air acts as on an oscillating plate that has the depth of the beam (Blevins 2016, Formulas for Dynamics, table
    # 6.2; viscous part: Hosaka, Itao and Kuroda 1995, Sensors and Actuators A 49:87).
    air = 0.25 * np.pi * _AIR_DENSITY_KG_M3 * depth**2 * length * 0.25
    added = air / effective
    viscous = 0.25 * length * np.pi * _AIR_DENSITY_KG_M3 * depth * np.sqrt(2 * _AIR_VISCOSITY_M2_S * omega)
    viscous /= omega * effective
    eddy = back = 0.0
    field = float(np.linalg.norm(loads.field_T[0]))
    magnet = specimen.magnet
    if magnet is not None:
        arm = length - 0.5e-3 * magnet.length_mm
        turn = 1.4 / arm  # rad for 1 m at the tip of a cantilever in its first mode
        volume = 1e-9 * magnet.length_mm * magnet.width_mm * magnet.depth_mm
        size = 1e-3 * min(magnet.length_mm, magnet.width_mm, magnet.depth_mm)
        eddy = _CONDUCTIVITY_S_M * (field * turn) ** 2 * size**2 / 20 * volume / (omega * effective)
        if field:
            # The flux of the turning dipole through the coil is the moment times the field per ampere, which is assumed
            # to be at most 10 mT/A.
            flux = 0.01 * magnet.moment_A_m2 * turn
            back = flux**2 / _COIL_OHM / (omega * effective)
    blur = 0.0 if exposure_s is None else (omega * exposure_s) ** 2 / 24
    return (
        SmallEffect("air-mass", "added mass of the air", 100 * gain * 0.5 * added, 0.0),
        SmallEffect("air-viscosity", "viscous loss in the air", 100 * gain * 0.5 * viscous, viscous),
        SmallEffect("eddy-currents", "eddy currents in the magnet", 0.0, float(eddy)),
        SmallEffect("back-emf", "back-EMF of the coil", 0.0, float(back)),
        SmallEffect("exposure", f"motion during the exposure (amplitudes lower by {100 * blur:.2g} %)", 0.0, 0.0),
        SmallEffect("clamp-loss", "loss in the clamp, which is much stiffer than the silicone", 0.0, 0.0),
    )

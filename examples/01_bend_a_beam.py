"""Bend a beam by a small force F at its tip, and compare its deflection with beam theory, F L^3 / (3 E I).

L is the length of the beam, E Young's modulus and I the second moment of area.
"""

import numpy as np

from eimi_fitting import LAWS, BeamModel, Loads, Specimen


def main() -> float:
    """Return the simulated deflection of the tip divided by the deflection from beam theory."""
    length_mm, width_mm, depth_mm, modulus_Pa, force_N = 60.0, 3.0, 5.0, 46e3, 2e-6
    specimen = Specimen(length_mm, width_mm, depth_mm, 0.0, "plane-stress")
    model = BeamModel(specimen).refined()
    loads = Loads.along(0.0, gravity_angle_deg=90.0, tip_force_N=force_N)
    shapes = model.solve(LAWS["neo-hookean"], np.array([[modulus_Pa]]), loads)
    tip = model.positions(shapes, np.array([[length_mm, 0.0]]))[0, 0, 0]
    second_moment_mm4 = depth_mm * width_mm**3 / 12
    expected_mm = force_N * length_mm**3 / (3 * 3e-6 * modulus_Pa * second_moment_mm4)  # E = 3 mu, in N/mm²
    print(f"tip at {tip[1]:.4f} mm, {tip[1] / expected_mm:.4f} times the deflection of beam theory")
    return float(tip[1] / expected_mm)


if __name__ == "__main__":
    main()

"""Test whether one bending test determines both C10 and C01 of a Mooney-Rivlin law.

A change of C10 moves the edges, and so does a change of C01. If the two movements are proportional to each other, the
pictures determine only a weighted sum of C10 and C01.
"""

import numpy as np

from eimi_fitting import LAWS, BeamModel, Loads, Magnet, Specimen, edge_sensitivity


def main() -> float:
    """Return the cosine of the angle between the displacements of the edges due to C10 and due to C01.

    It is 1 if both displacements are proportional; the edges then cannot distinguish C10 from C01.
    """
    model = BeamModel(Specimen(30.0, 3.0, 5.0, 1070.0, "plane-strain", Magnet(4.0, 3.0, 2.0, 1.2, 7500.0)))
    loads = Loads.along(np.linspace(0.0, 7.05, 6))
    sensitivity = edge_sensitivity(model, LAWS["mooney-rivlin"], np.array([15e3, 8e3]), loads)
    c10, c01 = (slope.ravel() for slope in sensitivity.slope[0])
    cosine = float(c10 @ c01 / np.linalg.norm(c10) / np.linalg.norm(c01))
    print(f"in {model.specimen.section}, an increase of C10 by 1 kPa moves an edge by {1e6 * np.abs(c10).max():.0f} µm")
    print(f"cosine between the movements due to C10 and due to C01: {cosine:.9f}")
    return cosine


if __name__ == "__main__":
    main()

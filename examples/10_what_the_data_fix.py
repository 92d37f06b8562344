"""Test whether one bending test determines both C10 and C01: compare the changes of the edges due to each."""

import numpy as np

from eimi_fitting import LAWS, BeamModel, Loads, Magnet, Specimen, edge_sensitivity


def main() -> float:
    """Return the cosine of the angle between the two changes: 1 if the data determine only a sum of both."""
    model = BeamModel(Specimen(30.0, 3.0, 5.0, 1070.0, "plane-strain", Magnet(4.0, 3.0, 2.0, 1.2, 7500.0)))
    loads = Loads.along(np.linspace(0.0, 7.05, 6))
    sensitivity = edge_sensitivity(model, LAWS["mooney-rivlin"], np.array([15e3, 8e3]), loads)
    c10, c01 = (slope.ravel() for slope in sensitivity.slope[0])
    cosine = float(c10 @ c01 / np.linalg.norm(c10) / np.linalg.norm(c01))
    print(f"1 kPa more of C10 moves an edge by up to {1e6 * np.abs(c10).max():.0f} µm, in {model.specimen.section}")
    print(f"cosine between C10 and C01: {cosine:.9f}")
    return cosine


if __name__ == "__main__":
    main()

"""Fit a law to positions tracked in a CSV file; here the points are simulated, with 20 µm of noise."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from eimi_fitting.beam.beside import SolidBeside
from eimi_fitting.beam.loads import Loads
from eimi_fitting.laws import LAWS
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset.tracked.points_csv import import_points
from eimi_lab.notebook import fit_evidence, load_evidence


def main() -> float:
    """Identified initial shear modulus in Pa; the points are those of 46 kPa."""
    specimen, field_mT = load_specimen("type1"), np.array([0.0, 2.0, 4.0, 6.0])
    model = SolidBeside(specimen.mechanics(), along=24, across=3)
    shapes = model.solve(LAWS["neo-hookean"], np.array([[46e3]]), Loads.along(field_mT))
    rest = np.column_stack([np.linspace(5.0, 25.0, 9), np.zeros(9), np.zeros(9)])
    places = model.positions(shapes, rest)[0, ..., :2] + np.random.default_rng(1).normal(0, 0.02, (4, 9, 2))
    points = ["state,point,x0_mm,y0_mm,x_mm,y_mm,sigma_mm"]
    for k, i in np.ndindex(4, 9):
        points.append(f"{k},p{i},{rest[i, 0]},{rest[i, 1]},{places[k, i, 0]:.4f},{places[k, i, 1]:.4f},0.02")
    states = ["state,field_mT", *(f"{k},{field}" for k, field in enumerate(field_mT))]
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "points.csv").write_text("\n".join(points) + "\n")
        (folder / "states.csv").write_text("\n".join(states) + "\n")
        import_points(folder / "points.csv", folder / "states.csv", specimen, 0.0, folder / "run.h5")
        fit = fit_evidence([load_evidence(folder / "run.h5")], "neo-hookean")
    print(fit.summary())
    return float(fit.initial_shear_modulus.value)


if __name__ == "__main__":
    main()

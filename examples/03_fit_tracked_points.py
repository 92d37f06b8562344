"""Fit a law to tracked points from a CSV file. Here the points are simulated, with 20 µm of noise."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import eimi_lab as eimi
from eimi_fitting import BeamModel, Loads, Magnet, Specimen


def main() -> float:
    """Return the identified initial shear modulus, Pa. The points are simulated with a shear modulus of 46 kPa."""
    model = BeamModel(Specimen(30.0, 3.0, 5.0, 1070.0, "plane-stress", Magnet(4.0, 3.0, 2.0, 1.2, 7500.0))).refined()
    field_mT = np.array([0.0, 2.0, 4.0, 6.0])
    shapes = model.solve(eimi.LAWS["neo-hookean"], np.array([[46e3]]), Loads.along(field_mT))
    rest = np.column_stack([np.linspace(5.0, 25.0, 9), np.zeros(9)])
    places = model.positions(shapes, rest)[0] + np.random.default_rng(1).normal(0, 0.02, (4, 9, 2))
    points = ["state,point,x0_mm,y0_mm,x_mm,y_mm,sigma_mm"]
    for k, i in np.ndindex(4, 9):
        points.append(f"{k},p{i},{rest[i, 0]},{rest[i, 1]},{places[k, i, 0]:.4f},{places[k, i, 1]:.4f},0.02")
    states = ["state,field_mT", *(f"{k},{field}" for k, field in enumerate(field_mT))]
    with TemporaryDirectory() as name:
        tables = Path(name) / "points.csv", Path(name) / "states.csv"
        for path, rows in zip(tables, (points, states), strict=True):
            path.write_text("\n".join(rows) + "\n")
        with eimi.import_points(*tables, "type1", Path(name) / "run.h5", gravity_angle=0.0) as run:
            fit = eimi.fit(run, "neo-hookean", section="plane-stress")
    print(fit.summary())
    return float(fit.initial_shear_modulus.value)


if __name__ == "__main__":
    main()

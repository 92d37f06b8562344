"""The tip's place at 15 mT against the mesh: the mesh-dependency study of the method's paper, for this model.

cd fitting && python -m benchmarks.mesh [FIGURE.png]
"""

from __future__ import annotations

import sys

import numpy as np

from eimi_fitting.actuation import Loads
from eimi_fitting.forward import BeamModel
from eimi_fitting.materials import LAWS
from eimi_fitting.specimen import Magnet, Specimen

SPECIMEN = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-strain", Magnet(4.0, 3.0, 1.0, 1.2, 7500.0))
MESHES = ((4, 1), (6, 1), (8, 1), (10, 1), (13, 1), (16, 1), (13, 2), (20, 2), (26, 3), (39, 4), (52, 6))
FINEST = (80, 10)


def tip(mesh: tuple[int, int]) -> np.ndarray:
    """Tip (2,) in mm at 15 mT."""
    model = BeamModel(SPECIMEN, *mesh)
    shapes = model.solve(LAWS["neo-hookean"], np.array([[46e3]]), Loads.along(np.linspace(0, 15, 6)))
    return model.positions(shapes, np.array([[30.0, 0.0]]))[0, -1, 0]


def main() -> None:
    """Print the table, draw the figure where a name is given."""
    reference = tip(FINEST)
    deflection = np.linalg.norm(reference - [30.0, 0.0])
    print(f"{FINEST[0]} x {FINEST[1]} elements: tip at ({reference[0]:.4f}, {reference[1]:.4f}) mm")
    errors = []
    for mesh in MESHES:
        errors.append(float(np.linalg.norm(tip(mesh) - reference)))
        print(f"{mesh[0]:3d} x {mesh[1]}: off by {1e3 * errors[-1]:7.2f} µm, {100 * errors[-1] / deflection:.4f} %")
    if len(sys.argv) > 1:
        from matplotlib.figure import Figure

        figure = Figure(figsize=(6, 3.6), layout="constrained")
        axes = figure.add_subplot()
        for across in sorted({a for _, a in MESHES}):
            chosen = [(n * a, e) for (n, a), e in zip(MESHES, errors, strict=True) if a == across]
            axes.loglog(*zip(*chosen, strict=True), "o-", label=f"{across} across")
        axes.set_xlabel("elements")
        axes.set_ylabel("tip off by, mm")
        axes.legend(frameon=False)
        axes.grid(alpha=0.25, which="both")
        figure.savefig(sys.argv[1], dpi=110)


if __name__ == "__main__":
    main()

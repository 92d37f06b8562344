"""Measure how the tip of a simulated beam at 15 mT depends on the mesh.

python -m benchmarks.mesh_convergence [FIGURE.png]

The error is the distance from the tip on the finest mesh. With a file name, the errors are also drawn.
"""

from __future__ import annotations

import sys

import numpy as np

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.specimen import Magnet, Specimen
from eimi_fitting.laws import LAWS

SPECIMEN = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-strain", Magnet(4.0, 3.0, 1.0, 1.2, 7500.0))
MESHES = (
    (4, 1),
    (6, 1),
    (8, 1),
    (10, 1),
    (13, 1),
    (20, 1),
    (13, 2),
    (20, 2),
    (39, 2),
    (26, 3),
    (39, 3),
    (39, 4),
    (52, 6),
)
FINEST = (80, 10)


def tip(mesh: tuple[int, int]) -> np.ndarray:
    """Return the tip (x, y) at 15 mT in mm; `mesh` contains the numbers of elements along and across the beam."""
    model = BeamModel(SPECIMEN, *mesh)
    shapes = model.solve(LAWS["neo-hookean"], np.array([[46e3]]), Loads.along(np.linspace(0, 15, 6)))
    return model.positions(shapes, np.array([[30.0, 0.0]]))[0, -1, 0]


def main() -> None:
    reference = tip(FINEST)
    deflection = np.linalg.norm(reference - [30.0, 0.0])
    print(f"{FINEST[0]} x {FINEST[1]} elements (reference): tip at ({reference[0]:.4f}, {reference[1]:.4f}) mm")
    errors = []
    for mesh in MESHES:
        errors.append(float(np.linalg.norm(tip(mesh) - reference)))
        percent = 100 * errors[-1] / deflection
        print(f"{mesh[0]:3d} x {mesh[1]}: error {1e3 * errors[-1]:7.2f} µm, {percent:.4f} % of the deflection")
    if len(sys.argv) > 1:
        draw(100 * np.array(errors) / deflection, sys.argv[1])


def draw(percent: np.ndarray, path: str) -> None:
    """Draw the errors of the tip (%) on n meshes, shape (n,), against the number of elements."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, NullFormatter

    figure = Figure(figsize=(7, 3.6), layout="constrained")
    axes = figure.add_subplot()
    for across in sorted({a for _, a in MESHES}):
        chosen = [(n * a, e) for (n, a), e in zip(MESHES, percent, strict=True) if a == across]
        axes.loglog(*zip(*chosen, strict=True), "o-", label=f"{across} across")
    for (n, a), e in zip(MESHES, percent, strict=True):
        axes.annotate(f"{n} × {a}", (n * a, e), (9, -3) if a == 2 else (5, 5), textcoords="offset points", fontsize=8)
    axes.set_xlabel("elements")
    axes.set_ylabel("tip off by, % of the deflection")
    axes.set_xlim(right=500)
    axes.yaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_major_formatter("{x:g}")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.set_minor_formatter(NullFormatter())
    axes.legend(frameon=False, fontsize=8)
    axes.grid(alpha=0.25)
    figure.savefig(path, dpi=100)


if __name__ == "__main__":
    main()

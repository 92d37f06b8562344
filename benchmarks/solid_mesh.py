"""Measure the error of the modulus that the mesh of the solid model causes, without and with a correction.

python -m benchmarks.solid_mesh [--short] [NAME...]

The correction is computed with the planar model: the tip's rotation on a fine planar mesh, minus the rotation on a
planar mesh that is as coarse as the solid mesh. NAME selects specimens; --short computes one specimen on one mesh.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from benchmarks.hidden_solids import HIDDEN, SPECIMENS
from eimi_fitting.beam.beside import SolidBeside
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.laws import LAWS

LAW = LAWS["neo-hookean"]
PARAMETERS = np.array([HIDDEN["neo-hookean"]])
LOADS = Loads.along(np.linspace(0.0, 7.05, 5))
FINEST = (36, 4, 1)
MESHES = ((20, 2, 0), (20, 3, 0), (26, 2, 0), (26, 3, 0), (26, 3, 1))


def planar(specimen: Specimen, along: int, across: int, factor: float = 1.0) -> np.ndarray:
    """Return the rotation of the tip (degrees) in K fields, shape (K,), by the planar model in plane stress.

    The mesh has `along` x `across` elements. `factor` multiplies the modulus.
    """
    model = BeamModel(replace(specimen, section="plane-stress"), along, across)
    return model.tip_angle_deg(model.solve(LAW, factor * PARAMETERS, LOADS))[0]


def solid(specimen: Specimen, mesh: tuple[int, int, int]) -> np.ndarray:
    # Return the rotation of the tip (degrees) in K fields, shape (K,), by the solid model on a mesh.
    model = SolidBeside(specimen, *mesh)
    return model.tip_angle_deg(model.solve(LAW, PARAMETERS, LOADS, tolerance_mm=1e-4))[0]


def main() -> None:
    short = "--short" in sys.argv
    names = [a for a in sys.argv[1:] if not a.startswith("-")] or list(SPECIMENS)
    for name in names[:1] if short else names:
        specimen = SPECIMENS[name]
        finer = planar(specimen, 52, 6)
        a_percent = (planar(specimen, 26, 3, 1.01) - planar(specimen, 26, 3))[-1]
        reference = solid(specimen, (26, 3, 0) if short else FINEST)
        for mesh in MESHES[:1] if short else MESHES:
            turn_deg = solid(specimen, mesh)
            summed = turn_deg + finer - planar(specimen, *mesh[:2])
            alone, both = ((turn - reference)[-1] / a_percent for turn in (turn_deg, summed))
            print(f"{name:8s} {mesh}  the solid alone {alone:+.3f} %, with the plane's mesh {both:+.3f} %", flush=True)


if __name__ == "__main__":
    main()

"""Compare the tip displacement of a cantilever, bent and tapered at rest, in FElupe and in `eimi_fitting`.

python -m benchmarks.felupe_strip

The cantilever is 30 mm long, 3 mm wide (1 mm narrower at the tip) and 5 mm deep, cast with a bend of 3 mm, and loaded
by a tip force of 2 mN (plane strain, Neo-Hookean, 46 kPa). FElupe (github.com/adtzlr/felupe) is another finite element
program.
"""

from __future__ import annotations

import felupe
import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.rest_modes import with_modes
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.beam.strip import Strip
from eimi_fitting.laws import LAWS

Array = NDArray[np.float64]

MODULUS_PA, FORCE_N, BULK_RATIO, STEPS = 46e3, 2e-3, 5000.0, 16
SPECIMEN = with_modes(Specimen(30.0, 3.0, 5.0, 0.0, "plane-strain"), (3.0, 0.5), (-0.5,))


def ours(along: int, across: int) -> Array:
    """Return the tip displacement (x, y) in mm by `eimi_fitting` with `along` x `across` quadratic elements."""
    model = BeamModel(SPECIMEN, along, across)
    force_N = FORCE_N * np.arange(1, 5) / 4
    loads = Loads.along(np.zeros(4), 90.0, None, tip_force_N=force_N, tip_force_angle_deg=90.0)
    shapes = model.solve(LAWS["neo-hookean"], np.array([[MODULUS_PA]]), loads)
    return model.displacements(shapes, np.array([[SPECIMEN.length_mm, 0.0]]))[0, -1, 0]


def felupes(along: int, across: int) -> Array:
    """Return the tip displacement (x, y) in mm by FElupe with `along` x `across` bilinear elements."""
    half = 0.5 * SPECIMEN.width_mm
    straight = felupe.Rectangle(a=(0, -half), b=(SPECIMEN.length_mm, half), n=(along + 1, across + 1))
    tip = int(np.argmin(np.linalg.norm(straight.points - [SPECIMEN.length_mm, 0], axis=1)))
    mesh = felupe.Mesh(Strip(SPECIMEN).at_rest(straight.points), straight.cells, straight.cell_type)
    field = felupe.FieldContainer([felupe.FieldPlaneStrain(felupe.RegionQuad(mesh), dim=2)])
    modulus_MPa = 1e-6 * MODULUS_PA
    body = felupe.SolidBodyNearlyIncompressible(felupe.NeoHooke(mu=modulus_MPa), field, bulk=BULK_RATIO * modulus_MPa)
    clamp = {"clamp": felupe.Boundary(field[0], mask=np.abs(mesh.points[:, 0]) < 1e-9)}
    load = felupe.PointLoad(field, [tip], values=[0, 0])
    free, fixed = felupe.dof.partition(field, clamp)
    prescribed = felupe.dof.apply(field, clamp, free)
    for part in np.linspace(0, 1, STEPS + 1)[1:]:
        load.update(np.array([[0.0, part * FORCE_N / SPECIMEN.depth_mm]]))
        felupe.newtonraphson(
            items=[body, load], dof0=free, dof1=fixed, ext0=prescribed, verbose=0, tol=1e-8, maxiter=30
        )
    return np.asarray(field[0].values[tip])


def main() -> None:
    for name, model, meshes in (("eimi_fitting", ours, ((13, 1), (26, 3))), ("FElupe", felupes, ((60, 6), (120, 12)))):
        for along, across in meshes:
            x, y = model(along, across)
            print(f"{name:12s} {along:3d} x {across:2d}  {x:8.4f} {y:8.4f}", flush=True)


if __name__ == "__main__":
    main()

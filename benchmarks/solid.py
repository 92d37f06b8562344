"""Compare the solid finite element model with exact solutions, the planar model, and FElupe (another program).

python -m benchmarks.solid [--short]
"""

from __future__ import annotations

import sys

import numpy as np

from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.laws import LAWS
from tests.shared.solid_cases import (
    CANTILEVER,
    against_plane_strain,
    cylinder,
    drop,
    even_stretch,
    felupe_drop,
    torsion,
)

SLENDER = Specimen(60.0, 6.0, 12.0, 1070.0, "plane-stress")


def main() -> None:
    short = "--short" in sys.argv
    for name in LAWS:
        print(f"{name}: depth held, from plane strain at most {against_plane_strain(name):.1e} mm")
    for name in LAWS:
        uniaxial, equibiaxial = even_stretch(name, 1.5, 1.5**-0.5), even_stretch(name, 1.3, 1.3)
        print(f"{name}: distorted patch, uniaxial 1.5 {uniaxial:.1e}, equibiaxial 1.3 {equibiaxial:.1e} of its side")
    before = None
    for n in (2, 4) if short else (2, 4, 8):
        errors = np.array(cylinder(n, 1.5))
        orders = "" if before is None else " orders " + " ".join(f"{v:.2f}" for v in np.log2(before / errors))
        print(
            f"thick cylinder {2 * n} x {n}: radius {errors[0]:.1e}, displacement {errors[1]:.1e}, "
            f"pressure {errors[2]:.1e}{orders}"
        )
        before = errors
    for n in (2,) if short else (2, 4):
        for name in ("neo-hookean", "mooney-rivlin"):
            error, torque = torsion(name, n)
            print(
                f"torsion {n} x {n} x {n}, {name}: inner displacement {error:.1e}, "
                f"torque over mu twist a^4/6 {torque:.5f}"
            )
    for specimen, mu in ((CANTILEVER, 88e3), (SLENDER, 150e3)):
        size = " x ".join(f"{v:g}" for v in (specimen.length_mm, specimen.width_mm, specimen.depth_mm))
        for mesh in ((13, 2, 0), (26, 4, 0), (26, 4, 1)) if not short else ((13, 2, 0),):
            print(f"{size} mm drops {drop(specimen, mu, *mesh):.3f} mm on {mesh}")
        for cells in ((20, 6, 3), (40, 12, 6)) if not short else ((20, 6, 3),):
            print(f"{size} mm drops {felupe_drop(specimen, mu, cells):.3f} mm by FElupe on {cells}")


if __name__ == "__main__":
    main()

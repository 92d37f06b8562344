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
        print(f"{name}: depth fixed, largest difference from plane strain {against_plane_strain(name):.1e} mm")
    for name in LAWS:
        uniaxial, equibiaxial = even_stretch(name, 1.5, 1.5**-0.5), even_stretch(name, 1.3, 1.3)
        print(
            f"{name}: distorted patch, error over side {uniaxial:.1e} at a uniaxial stretch of 1.5, "
            f"{equibiaxial:.1e} at an equibiaxial stretch of 1.3"
        )
    before = None
    for n in (2, 4) if short else (2, 4, 8):
        errors = np.array(cylinder(n, 1.5))
        orders = "" if before is None else ", orders " + " ".join(f"{v:.2f}" for v in np.log2(before / errors))
        print(
            f"thick cylinder {2 * n} x {n}: errors of radius {errors[0]:.1e}, displacement {errors[1]:.1e}, "
            f"pressure {errors[2]:.1e}{orders}"
        )
        before = errors
    for n in (2,) if short else (2, 4):
        for name in ("neo-hookean", "mooney-rivlin"):
            error, torque = torsion(name, n)
            print(
                f"torsion {n} x {n} x {n}, {name}: error of inner displacements {error:.1e}, "
                f"torque over exact torque {torque:.5f}"
            )
    for specimen, mu in ((CANTILEVER, 88e3), (SLENDER, 150e3)):
        size = " x ".join(f"{v:g}" for v in (specimen.length_mm, specimen.width_mm, specimen.depth_mm))
        for mesh in ((13, 2, 0), (26, 4, 0), (26, 4, 1)) if not short else ((13, 2, 0),):
            elements = f"{mesh[0]} x {mesh[1]} elements, {mesh[2]} more in depth"
            print(f"{size} mm: the tip sinks {drop(specimen, mu, *mesh):.3f} mm under the weight, {elements}")
        for cells in ((20, 6, 3), (40, 12, 6)) if not short else ((20, 6, 3),):
            elements = " x ".join(map(str, cells)) + " elements in half of the depth"
            print(f"{size} mm: the tip sinks {felupe_drop(specimen, mu, cells):.3f} mm in FElupe, {elements}")


if __name__ == "__main__":
    main()

"""Fit every law to the curve of a tensile test, the usual test of a material. The curve is computed from a Yeoh law."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import eimi_lab as eimi
from eimi_fitting.laws import engineering_stress

TRUTH = np.array([20e3, 4e3, 200.0])  # C10, C20, C30 in Pa; the initial shear modulus is 2 C10 = 40 kPa


def main() -> float:
    """Return the initial shear modulus (Pa) of the law with the smallest root mean square error."""
    strain = np.linspace(0.02, 1.0, 50)
    stress_kPa = 1e-3 * engineering_stress(eimi.LAWS["yeoh"], TRUTH, strain)
    with TemporaryDirectory() as folder:
        curve = Path(folder) / "curve.csv"
        rows = (f"{e},{s}" for e, s in zip(strain, stress_kPa, strict=True))
        curve.write_text("\n".join(["strain,stress_kPa", *rows]) + "\n")
        fits = eimi.tensile(curve, list(eimi.LAWS), window=100)
    for fit in fits:
        print(fit.summary())
    best = min(fits, key=lambda fit: fit.rmse_Pa)
    print(f"best: {best.model}")
    return float(best.initial_shear_modulus.value)


if __name__ == "__main__":
    main()

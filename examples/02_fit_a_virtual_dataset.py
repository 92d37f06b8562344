"""Bend a simulated beam, fit a law to its pictures, and compare the law with the true material of the simulation."""

from pathlib import Path
from tempfile import TemporaryDirectory

import eimi_lab as eimi


def main() -> float:
    """Return the identified initial shear modulus divided by the true initial shear modulus."""
    with (
        TemporaryDirectory() as folder,
        eimi.acquire("dragon_skin_10_quick", "type1", "virtual", Path(folder) / "run.h5") as run,
    ):
        fit = eimi.fit(run, "neo-hookean")
        truth = run.truth()  # read the true material only after the fit, for the comparison
    assert truth is not None
    (modulus_Pa,) = truth["parameters"].values()  # a Neo-Hookean material has one parameter
    ratio = fit.initial_shear_modulus.value / modulus_Pa
    print(fit.summary())
    print(f"identified modulus: {ratio:.4f} times the true modulus")
    return float(ratio)


if __name__ == "__main__":
    main()

"""Take a quick protocol on the virtual rig, fit a law to what its camera saw, and compare with the hidden truth."""

from pathlib import Path
from tempfile import TemporaryDirectory

import eimi_lab as eimi


def main() -> float:
    """Identified over true initial shear modulus."""
    with (
        TemporaryDirectory() as folder,
        eimi.acquire("dragon_skin_10_quick", "type1", "virtual", Path(folder) / "run.h5") as run,
    ):
        fit = eimi.fit(run, "neo-hookean")
        truth = run.truth()  # for scoring, after the fit
    assert truth is not None
    (modulus_Pa,) = truth["parameters"].values()  # a Neo-Hookean material has one
    ratio = fit.initial_shear_modulus.value / modulus_Pa
    print(fit.summary())
    print(f"{ratio:.4f} of the truth")
    return float(ratio)


if __name__ == "__main__":
    main()

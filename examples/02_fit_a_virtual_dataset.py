"""Take a quick protocol on the virtual rig, fit a law to what its camera saw, and compare with the hidden truth."""

from pathlib import Path
from tempfile import TemporaryDirectory

from eimi_lab.acquisition.event_words import on_terminal
from eimi_lab.acquisition.open_bench import open_bench
from eimi_lab.acquisition.run import acquire
from eimi_lab.config.protocol import load_protocol
from eimi_lab.config.rig import load_rig
from eimi_lab.config.specimen import load_specimen
from eimi_lab.notebook import fit_evidence, load_evidence, open_dataset


def main() -> float:
    """Identified over true initial shear modulus."""
    protocol, specimen, rig = load_protocol("dragon_skin_10_quick"), load_specimen("type1"), load_rig("virtual")
    with TemporaryDirectory() as folder:
        path = Path(folder) / "run.h5"
        with open_bench(rig, specimen, protocol.limits) as bench:
            acquire(protocol, specimen, rig, bench, path, on_terminal(print))
        fit = fit_evidence([load_evidence(path)], "neo-hookean")
        with open_dataset(path) as dataset:  # the truth is for scoring, after the fit
            truth = dataset.truth()
    assert truth is not None
    (modulus_Pa,) = truth["parameters"].values()  # a Neo-Hookean material has one
    ratio = fit.initial_shear_modulus.value / modulus_Pa
    print(fit.summary())
    print(f"{ratio:.4f} of the truth")
    return float(ratio)


if __name__ == "__main__":
    main()

"""Measure the error of the modulus if a simulated solid beam is fitted in plane strain, in plane stress and as a solid.

python -m benchmarks.hidden_solids [--short] [--solid] [NAME...]

The error is compared with the prediction of `eimi_fitting` (`expected_bias`). NAME selects specimens. --short fits only
one specimen, and --solid only the solid model.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from eimi_fitting.beam.beside import SolidBeside
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.outline import outline, points_on
from eimi_fitting.beam.specimen import Magnet, Specimen
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation
from eimi_fitting.inference.identification.whole_fit import identify
from eimi_fitting.inference.planning.section_bias import expected_bias
from eimi_fitting.laws import LAWS
from eimi_lab.config.specimen import load_specimen

HIDDEN = {"neo-hookean": [46390.0], "yeoh": [19530.0, 7410.0, -3117.0]}
# Elements along the beam, across the beam, and additional elements in each part of the depth. A fit has (20, 2, 0).
MESH = (26, 3, 1)
LOADS = Loads.along(np.linspace(0.0, 7.05, 8))


def _with_magnet(depth_mm: float, width_mm: float, magnet_depth_mm: float, remanence_T: float) -> Specimen:
    return Specimen(
        30.0, width_mm, depth_mm, 1070.0, "solid", Magnet(4.0, width_mm, magnet_depth_mm, remanence_T, 7500.0)
    )


SPECIMENS = {
    **{f"type{n}": replace(load_specimen(f"type{n}").mechanics(), section="solid") for n in (1, 2, 3, 4)},
    "slender": _with_magnet(1.0, 2.0, 1.0, 0.5),
    "square": _with_magnet(3.0, 3.0, 1.2, 1.2),
    "deep": _with_magnet(18.0, 3.0, 7.2, 1.2),
}


def noisy_edges(specimen: Specimen, law: str, sigma_mm: float = 0.001) -> EdgeObservation:
    """Simulate a solid beam; return its edges with normal noise of the standard deviation `sigma_mm`."""
    model = SolidBeside(specimen, *MESH)
    shapes = model.solve(LAWS[law], np.array([HIDDEN[law]]), LOADS, tolerance_mm=1e-3)
    curves = points_on(outline(model, shapes)[0], 2)[:, :, 4:-2]
    rng = np.random.default_rng(1)
    sigma = np.full(curves.shape[2], sigma_mm)
    noisy = curves + sigma_mm * rng.normal(size=curves.shape)
    return EdgeObservation.from_edges([(left, sigma, right, sigma) for left, right in noisy])


def fitted(specimen: Specimen, law: str, observed: EdgeObservation, true_Pa: float) -> str:
    """Fit a law to simulated edges; return a text with the errors of the modulus (%) and of the edges (µm)."""
    flat = BeamModel(specimen, plane=specimen.planar_section).refined()
    fit = identify(law, [Experiment(flat, LOADS, observed)])
    modulus = fit.initial_shear_modulus
    value, low, high = (100 * (v / true_Pa - 1) for v in (modulus.value, *modulus.interval_95))
    change = fit.section_change
    change_words = f", the solid changed {change.change_percent:+.2f} %" if change and change.change_percent else ""
    return f"{value:+7.2f} % [{low:+.2f}, {high:+.2f}]  {1e3 * fit.mean_error_mm:6.2f} µm{change_words}"


def main() -> None:
    names = [a for a in sys.argv[1:] if not a.startswith("-")] or list(SPECIMENS)
    for name in names[:1] if "--short" in sys.argv else names:
        specimen = SPECIMENS[name]
        for law, values in HIDDEN.items():
            true_Pa = float(LAWS[law].initial_shear_modulus(np.array(values)))
            observed = noisy_edges(specimen, law)
            for section in ("plane-strain", "plane-stress", "solid")[2 if "--solid" in sys.argv else 0 :]:
                variant = replace(specimen, section=section)
                expected = "" if section == "solid" else f"  (predicted {100 * expected_bias(variant):+.1f} %)"
                print(
                    f"{name:8s} {law:12s} {section:12s} {fitted(variant, law, observed, true_Pa)}{expected}", flush=True
                )


if __name__ == "__main__":
    main()

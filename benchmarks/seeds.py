"""Measure the error of the fitted initial shear modulus for every material law and five seeds of the noise.

    python -m benchmarks.seeds

The edges of a simulated 30 x 3 mm beam in 16 magnetic fields have normal noise of 1 µm.
"""

from __future__ import annotations

import numpy as np

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.specimen import Magnet, Specimen
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation, edge_curves, points_on
from eimi_fitting.inference.identification.whole_fit import identify
from eimi_fitting.laws import LAWS

SPECIMEN = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-strain", Magnet(4.0, 3.0, 2.0, 1.2, 7500.0))
LOADS = Loads.along(np.linspace(0, 7.05, 16))
NOISE_MM = 1e-3
TRUTH = {
    "neo-hookean": [46e3],
    "mooney-rivlin": [15e3, 8e3],
    "yeoh": [23e3, 8.7e3, -3.7e3],
    "ogden": [40e3, 1.3, 2e3, 6.0, -14e3, -2.0],
}


def measured(model: str, seed: int) -> Experiment:
    """Simulate a beam of the law `model` with noisy edges; return all inputs of a fit."""
    fine = BeamModel(SPECIMEN, 80, 10)
    shapes = fine.solve(LAWS[model], np.array([TRUTH[model]]), LOADS)
    sides = points_on(edge_curves(fine, shapes)[0], 3)
    sides = sides[:, :, np.linspace(4, sides.shape[2] - 5, 100).astype(int)]
    noisy = sides + np.random.default_rng(seed).normal(0, NOISE_MM, sides.shape)
    sigma = np.full(sides.shape[2], NOISE_MM)
    return Experiment(
        BeamModel(SPECIMEN).refined(), LOADS, EdgeObservation.from_edges([(l, sigma, r, sigma) for l, r in noisy])
    )


def main() -> None:
    print("law            error, % of the truth, seeds 1 to 5         largest")
    for model, truth in TRUTH.items():
        expected = float(LAWS[model].initial_shear_modulus(np.array(truth)))
        fits = [identify(model, [measured(model, seed)], seed=seed) for seed in range(1, 6)]
        off = [100 * (fit.initial_shear_modulus.value / expected - 1) for fit in fits]
        print(f"{model:14s}" + "".join(f"{value:+8.3f}" for value in off) + f"{max(map(abs, off)):12.3f}", flush=True)


if __name__ == "__main__":
    main()

"""Do 95 % of the 95 % intervals of the initial shear modulus hold the truth?

cd fitting && python -m benchmarks.coverage [REPLICATES] [SEED]

Each replicate is a measurement of its own: edges of a known material, simulated on 80 x 10 elements where the fit has
26 x 3 and at its end 52 x 6, with fresh noise, and the whole identification. The noise is white noise and noise that
hangs together along the edge with an exponential correlation, as blur, light and threshold give it, in equal parts.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.actuation import Loads
from eimi_fitting.experiment import Experiment
from eimi_fitting.forward import BeamModel
from eimi_fitting.identification import identify
from eimi_fitting.materials import LAWS
from eimi_fitting.observation import EdgeObservation, edge_curves, points_on
from eimi_fitting.specimen import Magnet, Specimen

Array = NDArray[np.float64]

SPECIMEN = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-strain", Magnet(4.0, 3.0, 2.0, 1.2, 7500.0))
FIELD_MT = np.linspace(0, 7.05, 4)
CORRELATED_OVER_MM = 1.0


@dataclass(frozen=True)
class Case:
    """A material, and the noise of its edges: standard deviations of each of the two parts."""

    model: str
    parameters: tuple[float, ...]
    noise_mm: float


CASES = (
    Case("neo-hookean", (46e3,), 0.005),
    Case("neo-hookean", (46e3,), 0.05),
    Case("yeoh", (20e3, 7e3, -3e3), 0.005),
    Case("yeoh", (20e3, 7e3, -3e3), 0.05),
)


def true_edges(case: Case) -> Array:
    """(K, 2, m, 2): edges without noise."""
    model = BeamModel(SPECIMEN, 80, 10)
    shapes = model.solve(LAWS[case.model], np.array([case.parameters]), Loads.along(FIELD_MT))
    assert shapes.converged[0]
    return points_on(edge_curves(model, shapes)[0], 3)[:, :, 4:-4]


def measured(edges: Array, noise_mm: float, rng: np.random.Generator) -> Experiment:
    """One measurement: noise across the edge, white and correlated."""
    along = np.gradient(edges, axis=2)
    across = np.stack([-along[..., 1], along[..., 0]], axis=-1) / np.linalg.norm(along, axis=-1, keepdims=True)
    length = np.cumsum(np.linalg.norm(np.diff(edges[0, 0], axis=0, prepend=edges[0, 0, :1]), axis=1))
    covariance = np.exp(-np.abs(length[:, None] - length) / CORRELATED_OVER_MM)
    root = np.linalg.cholesky(covariance + 1e-9 * np.eye(len(length)))
    white, together = rng.normal(size=(2, *edges.shape[:3]))
    noise = noise_mm * (white + together @ root.T)
    points = edges + noise[..., None] * across
    sigma = np.full(edges.shape[2], np.sqrt(2) * noise_mm)
    observed = EdgeObservation.from_edges([(left, sigma, right, sigma) for left, right in points])
    return Experiment(BeamModel(SPECIMEN).refined(), Loads.along(FIELD_MT), observed)


def moduli(case: Case, replicates: int, seed: int) -> Array:
    """(replicates, 3): initial shear modulus and the ends of its interval, over the truth."""
    edges = true_edges(case)
    truth = float(LAWS[case.model].initial_shear_modulus(np.array(case.parameters)))
    found = []
    for replicate in range(replicates):
        rng = np.random.default_rng([seed, CASES.index(case), replicate])
        fit = identify(case.model, [measured(edges, case.noise_mm, rng)], seed=replicate + 1)
        found.append([fit.initial_shear_modulus_Pa, *fit.uncertainty.initial_shear_modulus_Pa])
    return np.array(found) / truth


def main() -> None:
    """Print the coverage of each case and of all."""
    replicates = int(sys.argv[1]) if len(sys.argv) > 1 else 40
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    hits = 0
    print("law          noise µm   mean off %   scatter %   half-width %   intervals that hold the truth")
    for case in CASES:
        value, low, high = moduli(case, replicates, seed).T
        inside = int(((low <= 1) & (high >= 1)).sum())
        hits += inside
        print(
            f"{case.model:12s} {1e3 * case.noise_mm:8.0f}   {100 * (value.mean() - 1):10.3f}   "
            f"{100 * value.std():9.3f}   {50 * np.mean(high - low):12.3f}   {inside} of {replicates}",
            flush=True,
        )
    total = replicates * len(CASES)
    print(f"all: {hits} of {total}, {100 * hits / total:.1f} %")


if __name__ == "__main__":
    main()

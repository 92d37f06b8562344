"""What an imperfect bench does to the modulus: virtual solids with one thing wrong that no file states, fitted.

python -m benchmarks.imperfect_rigs [--seeds N] [--short] [CAUSE...]

Each row is one imperfection, named as the cause is in `fits.json`. The beam is that of the bench example, a hidden
Neo-Hookean solid on a mesh finer than that of a fit, in eight fields up to 7.05 mT. The edges have white noise. The
columns are the error of the modulus with the straight shape that the file states and with the measured rest shape,
each with its 95 % interval from noise and mesh, and whether the interval from all stated uncertainties holds the truth.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.beside import SolidBeside
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.outline import outline, points_on
from eimi_fitting.beam.rest_modes import with_modes
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation
from eimi_fitting.inference.fit import Fit
from eimi_fitting.inference.identification import identify
from eimi_fitting.inference.searching.measured_rest_shape import measured_rest_shape
from eimi_fitting.laws import LAWS
from eimi_lab.config.specimen import load_specimen

Array = NDArray[np.float64]

MODULUS_PA = 46390.0
MESH = (26, 3, 1)  # of the hidden solid
FIELD_MT = np.linspace(0.0, 7.05, 8)
NOISE_MM = 0.002
STATED = load_specimen("bench_example")


@dataclass(frozen=True)
class Imperfection:
    """One thing that is wrong on a bench.

    Attributes
    ----------
    cause : str
        Its name among the causes of `fits.json`; "none" for the perfect rig.
    words : str
        The size of the imperfection.
    specimen : callable
        Returns the true specimen for the stated one.
    """

    cause: str
    words: str
    specimen: Callable[[Specimen], Specimen] = lambda stated: stated


IMPERFECTIONS = (
    Imperfection("none", "perfect rig"),
    Imperfection("rest_shape", "cast with 1 mm of sag at the magnet", lambda stated: with_modes(stated, (1.0,))),
    Imperfection("taper", "2 % wider at the clamp than at the magnet", lambda stated: with_modes(stated, (), (-0.03,))),
)


def outlines(specimen: Specimen) -> Array:
    """Return the outlines (K, 2, m, 2) of the true solid in mm."""
    model = SolidBeside(specimen, *MESH)
    shapes = model.solve(LAWS["neo-hookean"], np.array([[MODULUS_PA]]), Loads.along(FIELD_MT), tolerance_mm=1e-3)
    return points_on(outline(model, shapes)[0], 4)[:, :, 8:-2]


def measured(edges: Array, seed: int) -> Experiment:
    """Return what the bench measures: noisy edges, the stated specimen and its stated uncertainties."""
    noisy = edges + NOISE_MM * np.random.default_rng(seed).normal(size=edges.shape)
    sigma = np.full(edges.shape[2], NOISE_MM)
    observed = EdgeObservation.from_edges([(left, sigma, right, sigma) for left, right in noisy])
    specimen = STATED.mechanics()
    flat = BeamModel(specimen, plane=specimen.planar_section).refined()
    return Experiment(flat, Loads.along(FIELD_MT), observed, stated=STATED.stated_sources())


def in_words(fit: Fit) -> str:
    """Return the error of the modulus and its interval from noise and mesh in per cent, and whether the other holds."""
    modulus = fit.initial_shear_modulus
    low, high = modulus.interval_95
    error, *ends = (
        100 * (value / MODULUS_PA - 1) for value in (modulus.value, *(modulus.interval_95_fit or modulus.interval_95))
    )
    holds = "holds" if low <= MODULUS_PA <= high else "MISSES"
    whole = 50 * (high - low) / MODULUS_PA
    return f"{error:+7.2f} % [{ends[0]:+6.2f}, {ends[1]:+6.2f}]  +-{whole:5.2f} % {holds}"


def main() -> None:
    """Fit every imperfection at every seed, with the stated and with the measured rest shape."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("causes", nargs="*", metavar="CAUSE", help="rows to compute; default: all")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--short", action="store_true", help="one seed")
    asked = parser.parse_args()
    for imperfection in IMPERFECTIONS:
        if asked.causes and imperfection.cause not in asked.causes:
            continue
        edges = outlines(imperfection.specimen(STATED.mechanics()))
        for seed in range(1, 1 + (1 if asked.short else asked.seeds)):
            straight = measured(edges, seed)
            shape = measured_rest_shape(straight)
            shaped = shape.applied(straight) if shape else straight
            for words, experiment in (("straight", straight), ("measured", shaped)):
                fit = identify("neo-hookean", [experiment])
                print(f"{imperfection.cause:12s} seed {seed}  {words}: {in_words(fit)}", flush=True)


if __name__ == "__main__":
    main()

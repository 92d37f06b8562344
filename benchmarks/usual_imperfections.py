"""Count the 95 % intervals of the modulus that contain the truth if each input has its usual error.

python -m benchmarks.usual_imperfections [--experiments 2000] [--full 24] [--seed 1] [--workers 2]

Each experiment is a simulated beam with random errors of its inputs and noise on its edges. Every experiment gets a
quick fit, which interpolates between simulated beams. Some experiments, ``--full`` in number, also get a full fit, as
by `eimi fit`. The interval of a quick fit is as wide as the intervals of the full fits on average. The last lines
compare both fits.
"""

# Each experiment is a virtual measurement, as in `benchmarks.coverage`: a Neo-Hookean beam, whose modulus the fit does
# not know, is simulated on 26 x 3 elements. A source is an input with an uncertainty. The true values of all sources
# are drawn at random with their usual standard uncertainties: 3 degrees for the direction of magnetisation, 0.1 mm for
# the shape at rest, 0.02 mm for the taper, and the usual values (`Source.usual`) for the background field, the gradient
# of the coil's field, scale, clamp, angles and dimensions. The edges get noise; no pictures are rendered.
#
# There are two kinds of fits, because full fits of all experiments would take too long.
#
# - A full fit is made of some experiments, ``--full`` in all, which contain every beam and every level of noise. It has
#   the same local optimisation, corrections, budget (the contribution of each source to the uncertainty) and random
#   draws as `eimi fit`.
# - A quick fit is made of every experiment. It minimises the same objective. The beam is not simulated in each fit:
#   each nominal specimen is simulated once with 21 moduli, and the error of each state is interpolated by cubic
#   splines. The interval has the mean width (in logarithms) of the full fits with the same beam and noise.
#
# The last lines compare full and quick fits of the same experiments.

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from benchmarks.coverage import HEADER, line
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel, Shapes
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.inference.evidence.unknowns import Setup
from eimi_fitting.laws import LAWS
from tests.shared.virtual_measurements import (
    ACROSS,
    ALONG,
    COORDINATES,
    FIELD_MT,
    Case,
    Outcome,
    deviations_drawn,
    measured,
    outcome,
    row,
)

Array = NDArray[np.float64]
Ends = Mapping[tuple[str, float], tuple[float, float]]

LOG_MODULI = np.linspace(-0.8, 0.8, 21)  # ln(modulus / true modulus) of the beams that are solved
FINE = np.linspace(LOG_MODULI[0], LOG_MODULI[-1], 3201)


@cache
def nominal(specimen: Specimen) -> tuple[BeamModel, Shapes]:
    """Return the nominal beam model of a specimen, and its bent shapes for 21 moduli."""
    model = BeamModel(specimen, ALONG, ACROSS, specimen.planar_section)
    moduli = COORDINATES["neo-hookean"][0] * np.exp(LOG_MODULI)
    return model, model.solve(LAWS["neo-hookean"], moduli[:, None], Loads.along(FIELD_MT), tolerance_mm=1e-3)


def logarithm(case: Case) -> float:
    """Fit one experiment by interpolation between simulated beams; return ln(fitted modulus / true modulus)."""
    rng = np.random.default_rng([case.seed, case.number])
    observed = measured(case, deviations_drawn(rng, case.stated), rng).observed
    model, shapes = nominal(case.specimen)
    misfit = observed.misfit(model, shapes, Setup.of((), len(LOG_MODULI)))
    error_mm = np.sqrt(CubicSpline(LOG_MODULI, misfit.error_mm**2)(FINE)).mean(axis=1)
    return float(FINE[np.argmin(error_mm)])


def kind(case: Case) -> tuple[str, float]:
    """Return the dimensions of the beam (mm, as text) and the noise of its edges (mm)."""
    return f"{case.specimen.length_mm:g} x {case.specimen.width_mm:g} x {case.specimen.depth_mm:g}", case.noise_mm


def mean_ends(full: Sequence[Outcome]) -> Ends:
    # Return the mean 95 % interval of the modulus, as ln(lower end / modulus) and ln(upper end / modulus).
    # full: results of complete fits. The mean is computed for each beam (dimensions as text) with each noise (mm).
    groups: dict[tuple[str, float], list[Array]] = {}
    for o in full:
        groups.setdefault(kind(o.case), []).append(np.log(np.array(o.interval) / o.value))
    means = {key: np.mean(ends, axis=0) for key, ends in groups.items()}
    return {key: (float(low), float(high)) for key, (low, high) in means.items()}


def quick(case: Case, ends: Ends) -> Outcome:
    # Fit one experiment by interpolation between simulated beams; return the modulus with a 95 % interval. The interval
    # is the mean relative interval of complete fits with the same beam and noise, `ends`.
    value, (low, high) = logarithm(case), ends[kind(case)]
    interval = (float(np.exp(value + low)), float(np.exp(value + high)))
    return Outcome(case, float(np.exp(value)), interval, interval, 0.0, 0.0)


def holds(o: Outcome) -> bool:
    """Return whether the 95 % interval of the modulus contains the true modulus."""
    return o.interval[0] <= 1 <= o.interval[1]


def width(o: Outcome) -> float:
    """Return the width ln(upper end / lower end) of the 95 % interval of the modulus."""
    return float(np.log(o.interval[1] / o.interval[0]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--experiments", type=int, default=2000, help="number of experiments")
    parser.add_argument("--full", type=int, default=24, help="number of experiments that are fitted in full")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2, help="number of processes")
    options = parser.parse_args()
    cases = [Case(number, options.seed, is_usual=True) for number in range(options.experiments)]
    step = max(1, 192 // options.full)  # every 192 experiments contain all beams and levels of noise
    with ProcessPoolExecutor(options.workers) as pool:
        full = list(pool.map(outcome, cases[: step * options.full : step]))
        ends = mean_ends(full)
        both = list(pool.map(partial(quick, ends=ends), [o.case for o in full]))
        every = list(pool.map(partial(quick, ends=ends), cases, chunksize=8))
    print(HEADER)
    for name in dict.fromkeys(kind(case) for case in cases):
        some = [o for o in every if kind(o.case) == name]
        print(line(row(f"{name[0]} mm, {1e3 * name[1]:g} µm", some)))
    print(line(row("all", every)))
    print(line(row("fitted in full", full)))
    print(line(row("the same, not in full", both)))
    apart = 100 * np.log([a.value / b.value for a, b in zip(full, both, strict=True)])
    widths = [width(a) / width(b) for a, b in zip(full, both, strict=True)]
    alike = sum(holds(a) == holds(b) for a, b in zip(full, both, strict=True))
    print(
        f"\nmoduli of full and quick fits differ by {np.sqrt(np.mean(apart**2)):.2f} % (root mean square), "
        f"{np.abs(apart).max():.2f} % at most; widths by {100 * np.std(widths):.0f} %; {alike} of {len(full)} "
        "intervals agree on whether they hold the truth"
    )


if __name__ == "__main__":
    main()

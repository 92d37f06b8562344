"""Measure the processor time of one simulated curve of tip positions (16 fields) and of one fit.

    python -m benchmarks.speed [FIGURE.png]

The time of the curve is measured for growing numbers of candidates (sets of parameters that are solved together),
fields and elements.
"""

from __future__ import annotations

import platform
import sys

import numpy as np
import scipy

from benchmarks import fit_cost
from benchmarks.timing import fastest
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel, Shapes
from eimi_fitting.beam.specimen import Magnet, Specimen
from eimi_fitting.laws import LAWS, Law

SPECIMEN = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-strain", Magnet(4.0, 3.0, 2.0, 1.2, 7500.0))
EXAMPLES = {
    "neo-hookean": [46e3],
    "mooney-rivlin": [20e3, 3e3],
    "yeoh": [23e3, 5e3, -600.0],
    "ogden": [2e4, 1.7, 100.0, 8.0, -5e3, -2.5],
}
MESHES = ((8, 1), (13, 1), (26, 1), (52, 1), (104, 1), (208, 1))
TOLERANCE_MM = 1e-2  # tolerance of the simulated shapes, as in a fit


def population(name: str, size: int) -> np.ndarray:
    """Return `size` different sets of the n parameters of a law, shape (size, n)."""
    spread = np.exp(0.3 * np.random.default_rng(0).standard_normal((size, 1)))
    unit = np.array([u == "Pa" for u in LAWS[name].units])
    return np.where(unit, np.array(EXAMPLES[name]) * spread, EXAMPLES[name])


def cost_s(model: BeamModel, law: Law, candidates: np.ndarray, loads: Loads, repeats: int = 7) -> float:
    """Return the shortest processor time (s) of several solutions for all candidates (sets of parameters)."""

    def solve() -> Shapes:
        return model.solve(law, candidates, loads, tolerance_mm=TOLERANCE_MM)

    solve()  # computes tables that later solutions use again
    return fastest(solve, repeats)[0]


def batch_ms(model: BeamModel, law: Law, size: int, loads: Loads) -> float:
    """Return the processor time (ms) to solve `size` sets of parameters together, divided by `size`."""
    return 1e3 * cost_s(model, law, population(law.name, size), loads) / size


def main() -> None:
    print(f"Python {platform.python_version()}, numpy {np.__version__}, scipy {scipy.__version__}, one thread")
    model, fine = BeamModel(SPECIMEN), BeamModel(SPECIMEN, 39, 3)
    loads = Loads.along(np.linspace(0, 7.05, 16))
    tip = np.array([[30.0, 0.0]])
    print("\nms of one candidate: in a batch of 16 or of 128 candidates, the ratio of these two, and alone")
    print("tip: distance from the tip on 39 x 3 elements, in % of the deflection")
    print(f"\n| law, {len(loads)} field states, ms | in a batch of 16 | of 128 | 128 over 16 | alone | tip, % |")
    print("| --- " * 6 + "|")
    for name, law in LAWS.items():
        few, many = (batch_ms(model, law, size, loads) for size in (16, 128))
        candidate = population(name, 1)
        single = 1e3 * cost_s(model, law, candidate, loads)
        ours = model.positions(model.solve(law, candidate, loads, tolerance_mm=TOLERANCE_MM), tip)[0, -1, 0]
        reference = fine.positions(fine.solve(law, candidate, loads), tip)[0, -1, 0]
        off = np.linalg.norm(ours - reference) / np.linalg.norm(reference - tip[0])
        print(f"| {name} | {few:.2f} | {many:.2f} | {many / few:.2f} | {single:.1f} | {100 * off:.3f} |", flush=True)
    print("\ntotal time in ms (Neo-Hookean) for growing numbers; slope of the logarithms over the last three points:")
    curves = {
        "candidates": [(n, cost(model, n, 16)) for n in (4, 8, 16, 32, 64, 128)],
        "states": [(n, cost(model, 16, n)) for n in (4, 8, 16, 32, 64, 128)],
        "elements": [(n * w, cost(BeamModel(SPECIMEN, n, w), 16, 16)) for n, w in MESHES],
    }
    for name, points in curves.items():
        print(f"  {name:10s} slope {slope(points):.2f}: " + ", ".join(f"{n}: {ms:.1f}" for n, ms in points))
    if len(sys.argv) > 1:
        draw(curves, sys.argv[1])
    fit_cost.main()


def slope(points: list[tuple[int, float]]) -> float:
    """Return the exponent a in cost ~ number^a from the last three pairs (number, cost)."""
    return float(np.polyfit(*np.log(np.array(points[-3:])).T, 1)[0])


def draw(curves: dict[str, list[tuple[int, float]]], path: str) -> None:
    """Draw the times (ms) against the numbers of candidates (sets of parameters), states and elements, into a file.

    `curves` contains pairs (number, time) for "candidates", "states" and "elements".
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.1), layout="constrained")
    for axes, (name, points) in zip(figure.subplots(1, 3, sharey=True), curves.items(), strict=True):
        number, ms = np.array(points).T
        axes.loglog(number, ms[-1] * number / number[-1], "--", color="0.6", label="in proportion")
        axes.loglog(number, ms, "o-", label=f"measured, slope {slope(points):.2f}")
        axes.set_xlabel(name)
        axes.grid(alpha=0.25, which="both")
        axes.legend(frameon=False, fontsize=8)
    figure.axes[0].set_ylabel("ms in all")
    figure.savefig(path, dpi=100)


def cost(model: BeamModel, size: int, states: int) -> float:
    # Return the processor time (ms) of a simulation of `size` Neo-Hookean candidates in `states` fields.
    candidates, loads = population("neo-hookean", size), Loads.along(np.linspace(0, 7.05, states))
    return 1e3 * cost_s(model, LAWS["neo-hookean"], candidates, loads, 3)


if __name__ == "__main__":
    main()

"""Compare times and errors of FElupe and `eimi_fitting` for the tip positions of the same beam in 16 fields.

    pip install -e '.[bench]'; python -m benchmarks.peer [--short]

FElupe is another finite element program. The errors are differences from `eimi_fitting` with 80 x 10 elements.
"""

from __future__ import annotations

import sys
import warnings

import numpy as np
from numpy.typing import NDArray

from benchmarks.speed import EXAMPLES, SPECIMEN, TOLERANCE_MM, cost_s, population
from benchmarks.timing import fastest
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.laws import LAWS
from eimi_fitting.units import moduli_in_MPa

Array = NDArray[np.float64]

FIELDS_MT = np.linspace(0, 7.05, 16)
TIP = np.array([[30.0, 0.0]])
# With a tolerance of 0.01 mm, as in `eimi_fitting`, the ordinary Newton method stops up to 0.45 mm from the solution.
FELUPE_TOLERANCE_MM = 1e-3


def errors(tip: Array, reference: Array) -> tuple[float, float]:
    """Return the tip's error in the last state and its largest error, in % of the deflection in the last state.

    Both arrays have the shape (K, 2): x and y in mm in K states.
    """
    off = np.linalg.norm(tip - reference, axis=1)
    deflection = np.linalg.norm(reference[-1] - TIP[0])
    return 100 * off[-1] / deflection, 100 * off.max() / deflection


def main() -> None:
    try:
        import felupe

        from benchmarks.felupe_beam import Beam, Elements, NoEquilibrium
    except ImportError:
        sys.exit("FElupe is not installed: pip install -e '.[bench]' in the folder of pyproject.toml")
    warnings.simplefilter("ignore")  # a load step that diverges overflows before the step is halved
    short = "--short" in sys.argv
    print(f"FElupe {felupe.__version__}, numpy {np.__version__}, one thread, {len(FIELDS_MT)} states")
    bilinear = [(60, 6, False), (60, 6, True), (100, 10, True), (240, 24, True)]
    serendipity = [(13, 1, True), (26, 2, True), (39, 3, True)]
    rows = [Elements("bilinear", *m) for m in bilinear] + [Elements("serendipity", *m) for m in serendipity]
    for name, chosen in (("neo-hookean", rows), ("ogden", [rows[0], rows[2], *rows[-2:]])):
        law, loads = LAWS[name], Loads.along(FIELDS_MT)
        parameters = np.array(EXAMPLES[name])
        fine = BeamModel(SPECIMEN, *((26, 3) if short else (80, 10)))
        reference = fine.positions(fine.solve(law, parameters[None], loads), TIP)[0, :, 0]
        model, candidates = BeamModel(SPECIMEN), population(name, 16)
        shapes = model.solve(law, parameters[None], loads, tolerance_mm=TOLERANCE_MM)
        last, ours = errors(model.positions(shapes, TIP)[0, :, 0], reference)
        repeats, in_MPa = (1 if short else 15), moduli_in_MPa(parameters, law.units)
        batch = cost_s(model, law, candidates, loads, repeats) / 16
        alone = cost_s(model, law, parameters, loads, repeats)
        print(
            f"{name}\n  eimi_fitting 13 x 1: {1e3 * batch:.2f} ms a candidate of 16, {1e3 * alone:.1f} ms alone; "
            f"tip off by {last:.3f} %, at most {ours:.3f} %"
        )
        best: dict[str, tuple[float, Elements]] = {}
        for elements in chosen[-1:] if short else chosen:
            try:
                seconds, curve = fastest(
                    lambda n=name, e=elements, p=in_MPa: Beam(SPECIMEN, e, n, p).curve(FIELDS_MT, FELUPE_TOLERANCE_MM),
                    1 if short or elements.along * elements.across > 1000 else 5,
                )
            except NoEquilibrium as failure:
                print(f"  FElupe {elements.text}: no equilibrium {failure}")
                continue
            last, largest = errors(curve.tip, reference)
            print(
                f"  FElupe {elements.text}: {seconds:.3f} s, {curve.iterations} iterations; tip off by {last:.3f} %, "
                f"at most {largest:.3f} %; ratio {seconds / batch:.0f} in a batch, {seconds / alone:.0f} alone",
                flush=True,
            )
            if largest <= ours and seconds < best.get(elements.kind, (np.inf, elements))[0]:
                best[elements.kind] = seconds, elements
        for seconds, elements in best.values():
            print(
                f"  no less accurate ({ours:.3f} % in every state): FElupe {elements.text} takes "
                f"{seconds / batch:.0f} times a candidate in a batch, {seconds / alone:.0f} times one alone"
            )


if __name__ == "__main__":
    main()

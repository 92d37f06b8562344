"""Find a mistake in the loads of a file, such as a reversed field, if no modulus explains the measurement."""

# The smallest distance of simulated from measured edges over many moduli is divided by the distance for an unbent beam.
# If this ratio exceeds 0.04 for a dataset, the loads are corrected, once for each usual mistake. A mistake is named if
# the correction reduces the distance to less than 0.4 of its value. If the ratio also exceeds 0.2, no law is fitted.

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.loads import Loads
from eimi_fitting.inference.evidence.objective import Problem
from eimi_fitting.inference.evidence.unknowns import Unknowns
from eimi_fitting.inference.searching.modulus_range import NothingActs, Scan, narrowed, scanned

Array = NDArray[np.float64]

# Limits of the best error over the error of an unbent beam. Three laws with gravity at 0, 30 and 90 degrees were fitted
# as Neo-Hookean and as Ogden. The ratio was at most 0.02 with the right loads, and at least 0.8 with a reversed field.
# It was at least 0.17 with a thousandth of the field, and at least 0.05 with a thousand times the field or with
# reversed gravity; the value 0.05 is that of a hanging beam.
_SUSPECT, _HOPELESS = 0.04, 0.2
_EXPLAINS = 0.4  # largest error with corrected loads over the error with the stated loads


# The keys of the recognised mistakes in the loads.
Slip = Literal[
    "field_reversed",
    "gravity_reversed",
    "field_too_large",
    "field_too_small",
    "force_reversed",
    "force_too_large",
    "gravity_absent",
]


@dataclass(frozen=True)
class Cause:
    """A usual mistake in the loads of a file, such as a reversed field."""

    slip: Slip
    # Name of the mistake.
    words: str
    # Corrects the loads of the file.
    loads: Callable[[Loads], Loads]


class NamedCause(Exception):
    """The exception for a mistake in the loads that explains why no material fits the measurement."""

    # error_mm, error_without_mm: smallest mean distance of measured points from simulated edges, with the mistake and
    # without it.

    def __init__(self, experiment: int, slip: Slip, error_mm: float, error_without_mm: float) -> None:
        self.experiment, self.slip = experiment, slip
        self.error_mm, self.error_without_mm = error_mm, error_without_mm
        super().__init__(
            f"no material explains the measured shape of the beam: the smallest error is {error_mm:.2g} mm, and "
            f"without {self.words} only {error_without_mm:.2g} mm"
        )

    @property
    def words(self) -> str:
        """The mistake in the loads, such as "a field in the opposite direction"."""
        return next(cause.words for cause in CAUSES if cause.slip == self.slip)

    def __reduce__(self) -> tuple[type[NamedCause], tuple[int, Slip, float, float]]:
        # For pickle: the default would call the class with the message alone.
        return NamedCause, (self.experiment, self.slip, self.error_mm, self.error_without_mm)


def _gravity_turned(loads: Loads) -> Loads:
    # Gravity, and tip forces along gravity, are reversed.
    across = loads.gravity[:, 0] * loads.tip_force_N[:, 1] - loads.gravity[:, 1] * loads.tip_force_N[:, 0]
    along = np.abs(across) <= 1e-9 * np.linalg.norm(loads.gravity, axis=1) * np.linalg.norm(loads.tip_force_N, axis=1)
    force = np.where(along[:, None], -loads.tip_force_N, loads.tip_force_N)
    return replace(loads, gravity=-loads.gravity, tip_force_N=force)


CAUSES = (
    Cause("field_reversed", "a field in the opposite direction", lambda loads: replace(loads, field_T=-loads.field_T)),
    Cause("gravity_reversed", "gravity in the opposite direction", _gravity_turned),
    Cause(
        "field_too_large",
        "a field a thousand times too large",
        lambda loads: replace(loads, field_T=1e-3 * loads.field_T),
    ),
    Cause(
        "field_too_small",
        "a field a thousand times too small",
        lambda loads: replace(loads, field_T=1e3 * loads.field_T),
    ),
    Cause(
        "force_reversed",
        "tip forces in the opposite direction",
        lambda loads: replace(loads, tip_force_N=-loads.tip_force_N),
    ),
    Cause(
        "force_too_large",
        "tip forces a thousand times too large",
        lambda loads: replace(loads, tip_force_N=1e-3 * loads.tip_force_N),
    ),
    Cause("gravity_absent", "gravity", lambda loads: replace(loads, gravity=0 * loads.gravity)),
)


def doubtful_loads(problem: Problem, scan: Scan, independent_points: float) -> tuple[NamedCause, ...]:
    """Find probable mistakes in the loads of the files, such as a reversed field."""
    # `scan` is the objective of the fit for many moduli. At most one mistake is returned for each dataset. Raises
    # NamedCause if the fit would be hopeless: with the loads of the file, the residuals exceed 0.2 times those of a
    # beam that stays straight.
    causes: list[NamedCause] = []
    # The loads explain all datasets together.
    if scan.best_mm <= _SUSPECT * scan.unmoved_mm:
        return ()
    for index, experiment in enumerate(problem.experiments):
        alone = replace(problem, experiments=(experiment,), unknowns=Unknowns(problem.unknowns.space), curves=())
        scan_alone = narrowed(alone, scanned(alone, independent_points), independent_points)
        stated_mm = scan_alone.best_mm
        if stated_mm <= _SUSPECT * scan_alone.unmoved_mm:
            continue
        corrected_mm = [_error_without(alone, cause, independent_points) for cause in CAUSES]
        best = int(np.argmin(corrected_mm))
        if corrected_mm[best] < _EXPLAINS * stated_mm:
            causes.append(NamedCause(index, CAUSES[best].slip, stated_mm, corrected_mm[best]))
            # Otherwise the result of the fit gets a warning.
            if stated_mm > _HOPELESS * scan_alone.unmoved_mm:
                raise causes[-1]
    return tuple(causes)


def _error_without(alone: Problem, cause: Cause, independent_points: float) -> float:
    # The smallest error (mm) of a fit of the modulus to one dataset whose loads are corrected.
    (experiment,) = alone.experiments
    loads = cause.loads(experiment.loads)
    # The dataset has no load that the mistake concerns.
    if all(np.array_equal(loads.state(k), experiment.loads.state(k)) for k in range(len(loads))):
        return np.inf
    changed = replace(alone, experiments=(replace(experiment, loads=loads),))
    try:
        return narrowed(changed, scanned(changed, independent_points), independent_points).best_mm
    except NothingActs:
        return np.inf

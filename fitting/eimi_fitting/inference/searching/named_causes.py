"""Why no material explains what was seen, where one slip in the loads does: told before any search.

Where the best modulus of a scan leaves some of what moved, the scan is repeated for each dataset alone, with its loads
as a usual slip would have made them: a field the other way round, a current in milliampere. The slip that explains far
more than the loads as stated is named: as a refusal where these leave much of what moved, else as a doubt.
"""

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

# Of what the places lie off where nothing moves. Three laws, gravity at 0, 30 and 90 degrees, fitted as Neo-Hookean and
# as Ogden: 0.02 at most with the right loads; with the field reversed 0.8 and more, with a thousandth of it 0.17 and
# more, with a thousand times of it and with gravity upside down 0.05 and more, the least where the beam hangs.
_SUSPECT, _HOPELESS = 0.04, 0.2
_EXPLAINS = 0.4  # of the error with the loads as stated


Slip = Literal[
    "field_reversed",
    "gravity_reversed",
    "field_too_large",
    "field_too_small",
    "force_reversed",
    "force_too_large",
    "gravity_absent",
]
"""What was stated wrongly of the loads."""


@dataclass(frozen=True)
class Cause:
    """A slip, its name in English, and the loads as they would be without it."""

    slip: Slip
    words: str
    loads: Callable[[Loads], Loads]


class NamedCause(Exception):
    """No material explains a dataset (counted from 0) with its loads as stated; one does without the slip.

    error_mm, error_without_mm: the best that a scan over moduli finds, with the slip and without it.
    """

    def __init__(self, experiment: int, slip: Slip, error_mm: float, error_without_mm: float) -> None:
        self.experiment, self.slip = experiment, slip
        self.error_mm, self.error_without_mm = error_mm, error_without_mm
        super().__init__(
            f"no material explains this: the best is {error_mm:.2g} mm off, and without {self.words} "
            f"{error_without_mm:.2g} mm"
        )

    @property
    def words(self) -> str:
        """The slip in English."""
        return next(cause.words for cause in CAUSES if cause.slip == self.slip)

    def __reduce__(self) -> tuple[type[NamedCause], tuple[int, Slip, float, float]]:
        """An error with more than words has to say how another process is told of it."""
        return NamedCause, (self.experiment, self.slip, self.error_mm, self.error_without_mm)


def _gravity_turned(loads: Loads) -> Loads:
    """Tip forces along gravity are turned with it: they are stated by its angle."""
    across = loads.gravity[:, 0] * loads.tip_force_N[:, 1] - loads.gravity[:, 1] * loads.tip_force_N[:, 0]
    along = np.abs(across) <= 1e-9 * np.linalg.norm(loads.gravity, axis=1) * np.linalg.norm(loads.tip_force_N, axis=1)
    force = np.where(along[:, None], -loads.tip_force_N, loads.tip_force_N)
    return replace(loads, gravity=-loads.gravity, tip_force_N=force)


CAUSES = (
    Cause(
        "field_reversed", "a field that is the wrong way round", lambda loads: replace(loads, field_T=-loads.field_T)
    ),
    Cause("gravity_reversed", "a gravity that is upside down", _gravity_turned),
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
        "force_reversed", "tip forces the wrong way round", lambda loads: replace(loads, tip_force_N=-loads.tip_force_N)
    ),
    Cause(
        "force_too_large",
        "tip forces a thousand times too large",
        lambda loads: replace(loads, tip_force_N=1e-3 * loads.tip_force_N),
    ),
    Cause("gravity_absent", "gravity", lambda loads: replace(loads, gravity=0 * loads.gravity)),
)


def doubtful_loads(problem: Problem, scan: Scan, independent_points: float) -> tuple[NamedCause, ...]:
    """The slips in the loads of single datasets that explain what the problem's narrowed scan leaves open.

    Raises NamedCause for one without which nothing is explained.
    """
    found: list[NamedCause] = []
    if scan.best_mm <= _SUSPECT * scan.unmoved_mm:
        return ()
    for index, experiment in enumerate(problem.experiments):
        alone = replace(problem, experiments=(experiment,), unknowns=Unknowns(problem.unknowns.space), curves=())
        own = narrowed(alone, scanned(alone, independent_points), independent_points)
        stated = own.best_mm
        if stated <= _SUSPECT * own.unmoved_mm:
            continue
        without = [_without(alone, cause, independent_points) for cause in CAUSES]
        best = int(np.argmin(without))
        if without[best] < _EXPLAINS * stated:
            found.append(NamedCause(index, CAUSES[best].slip, stated, without[best]))
            if stated > _HOPELESS * own.unmoved_mm:
                raise found[-1]
    return tuple(found)


def _without(alone: Problem, cause: Cause, independent_points: float) -> float:
    (experiment,) = alone.experiments
    loads = cause.loads(experiment.loads)
    if all(np.array_equal(loads.state(k), experiment.loads.state(k)) for k in range(len(loads))):
        return np.inf
    changed = replace(alone, experiments=(replace(experiment, loads=loads),))
    try:
        return narrowed(changed, scanned(changed, independent_points), independent_points).best_mm
    except NothingActs:
        return np.inf

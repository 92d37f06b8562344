"""What was done and seen with a specimen, and how far candidates are from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.actuation import Loads
from eimi_fitting.forward import BeamModel, Shapes
from eimi_fitting.materials import Law
from eimi_fitting.nuisance import Setting
from eimi_fitting.observation import Misfit, Observation
from eimi_fitting.solid import Status

Array = NDArray[np.float64]

# Worse than any simulation can be, and finite: the optimiser would replace a NaN by the generation's median.
DISCARDED_MM = 1e6
_TOLERANCE_MM = 1e-2  # of the last Newton step: what is left is below 1e-4, and edges are good to 1e-3


@dataclass(frozen=True)
class Experiment:
    """One specimen in K states: its model, its loads and what was seen of it.

    mesh_change: (K, G, m) mm, what a finer mesh adds to the residuals, see `eimi_fitting.mesh_error`.
    """

    model: BeamModel
    loads: Loads
    observed: Observation
    mesh_change: Array | None = None

    def of_states(self, states: NDArray[np.intp]) -> Experiment:
        """The same specimen in some of its states, or in some of them more than once."""
        return replace(
            self,
            loads=self.loads.take(states),
            observed=self.observed.of_states(states),
            mesh_change=None if self.mesh_change is None else self.mesh_change[states],
        )


@dataclass(frozen=True)
class Comparison:
    """P candidates against every experiment.

    error_mm, deviation_mm: (P, K of all experiments); unconverged: (P,) in any state; unstable: (P,) in any state, of
    those that converged; max_stretch: (P,); misfits: one an experiment.
    """

    error_mm: Array
    deviation_mm: Array
    unconverged: NDArray[np.bool_]
    unstable: NDArray[np.bool_]
    max_stretch: Array
    misfits: tuple[Misfit, ...]

    @property
    def objective_mm(self) -> Array:
        """(P,): mean over the states of the error; DISCARDED_MM where a candidate is not valid."""
        return np.where(self.unconverged | self.unstable, DISCARDED_MM, self.error_mm.mean(axis=1))


def compare(
    law: Law,
    parameters: Array,
    experiments: Sequence[Experiment],
    *,
    bulk_modulus_Pa: Array | None = None,
    settings: Sequence[Setting] | None = None,
) -> Comparison:
    """Simulate P candidates (P, n) in every experiment and measure their distance to what was seen.

    bulk_modulus_Pa: (P,), incompressible without it; settings: one an experiment, what is stated without them.
    """
    errors, deviations, misfits = [], [], []
    unconverged, unstable = np.zeros((2, len(parameters)), bool)
    stretch = np.ones(len(parameters))
    for index, experiment in enumerate(experiments):
        setting = settings[index] if settings else None
        shapes = _solved(law, parameters, experiment, bulk_modulus_Pa, setting)
        misfit = experiment.observed.misfit(experiment.model, shapes, setting, experiment.mesh_change)
        unconverged |= ((shapes.status == Status.DIVERGED) | (shapes.status == Status.OUT_OF_ITERATIONS)).any(axis=1)
        unstable |= (shapes.status == Status.UNSTABLE).any(axis=1)
        stretch = np.maximum(stretch, shapes.max_stretch.max(axis=1))
        errors.append(misfit.error_mm)
        deviations.append(misfit.deviation_mm)
        misfits.append(misfit)
    return Comparison(
        np.concatenate(errors, axis=1),
        np.concatenate(deviations, axis=1),
        unconverged,
        unstable & ~unconverged,
        stretch,
        tuple(misfits),
    )


def _solved(
    law: Law, parameters: Array, experiment: Experiment, bulk_modulus_Pa: Array | None, setting: Setting | None
) -> Shapes:
    """Shapes of all candidates. Those that differ in roll or clamp alone bend alike, and are solved once."""
    if setting is None:
        return experiment.model.solve(
            law, parameters, experiment.loads, tolerance_mm=_TOLERANCE_MM, bulk_modulus_Pa=bulk_modulus_Pa
        )
    bulk = np.zeros(len(parameters)) if bulk_modulus_Pa is None else bulk_modulus_Pa
    every = np.column_stack([parameters, bulk, setting.field_factor])
    _, first, own = np.unique(every, axis=0, return_index=True, return_inverse=True)
    own = own.reshape(-1)
    shapes = experiment.model.solve(
        law,
        parameters[first],
        experiment.loads,
        tolerance_mm=_TOLERANCE_MM,
        bulk_modulus_Pa=None if bulk_modulus_Pa is None else bulk_modulus_Pa[first],
        field_factor=setting.field_factor[first],
    )
    return replace(
        shapes,
        displacement=shapes.displacement[own],
        rigid=shapes.rigid[own],
        status=shapes.status[own],
        iterations=shapes.iterations[own],
        max_stretch=shapes.max_stretch[own],
        last=shapes.last.take(own),
    )

"""What was done and seen with a specimen, and how far candidates are from it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.beside import SolidBeside, SolidOptions
from eimi_fitting.beam.equilibrium import Configuration, Status
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel, Shapes
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.inference.evidence.measurements import EdgeObservation, Misfit, Observation
from eimi_fitting.inference.evidence.sources import StatedSource, loads_under, specimen_under, stand_off_under
from eimi_fitting.inference.evidence.unknowns import Setup
from eimi_fitting.laws.law import Law

Array = NDArray[np.float64]

# Worse than any simulation can be, and finite: the optimiser would replace a NaN by the generation's median.
DISCARDED_MM = 1e6
TOLERANCE_MM = 1e-2  # of the last Newton step: what is left is below 1e-4, and edges are good to 1e-3


@dataclass(frozen=True)
class Experiment:
    """One specimen in K states: its model, its loads and what was seen of it.

    change: (K, G, m) mm, what is added to the residuals, see `inference.evidence.corrections`; solid: solved in the
    model's place, with solid_options; stated: how well known the numbers are that it rests on.

    Examples
    --------
    >>> import numpy as np
    >>> from eimi_fitting import BeamModel, Experiment, Loads, PointObservation, Specimen
    >>> strip = Specimen(
    ...     length_mm=30.0, width_mm=3.0, depth_mm=10.0, density_kg_m3=1070.0, section="plane-stress"
    ... )
    >>> rest, moved = np.array([[[30.0, 0.0]]]), np.array([[[29.6, 2.4]]])
    >>> loads = Loads.along([0.0], gravity_angle_deg=90.0, tip_force_N=[0.002])
    >>> experiment = Experiment(BeamModel(strip), loads, PointObservation(rest, moved, np.full((1, 1), 0.01)))
    >>> len(experiment.loads)
    1
    """

    model: BeamModel
    loads: Loads
    observed: Observation
    change: Array | None = None
    solid: SolidBeside | None = None
    solid_options: SolidOptions | None = None
    stated: tuple[StatedSource, ...] = ()

    @property
    def solved(self) -> BeamModel | SolidBeside:
        """The model that is solved."""
        return self.solid or self.model

    def of_states(self, states: NDArray[np.intp]) -> Experiment:
        """The same specimen in some of its states, or in some of them more than once."""
        return replace(
            self,
            loads=self.loads.take(states),
            observed=self.observed.of_states(states),
            change=None if self.change is None else self.change[states],
        )

    def with_own_change(self, misfit: Misfit, before: Experiment) -> Misfit:
        """A misfit of an experiment that differs from this one in its change alone, as this one's."""
        difference = sum(
            (sign * e.change for sign, e in ((1, self), (-1, before)) if e.change is not None), start=np.zeros(1)
        )
        return self.observed.of_residuals(misfit.residuals + difference)

    def under(self, deviations: Mapping[str, Array]) -> Experiment:
        """The experiment with what sources of SOURCES (parts,) deviate by: another specimen, other loads, another lens.

        Tracked points keep their share of length and width, and their displacement.
        """
        if not deviations:
            return self
        before = self.model.specimen
        specimen = specimen_under(before, deviations)
        same = specimen == before
        return replace(
            self,
            model=self.model if same else self.model.of(specimen),
            solid=self.solid if same or not self.solid else self.solid.of(specimen),
            solid_options=self.solid_options if same else None,
            loads=loads_under(self.loads, deviations),
            observed=_observed_of(self.observed, before, specimen, deviations),
        )


def _observed_of(
    observed: Observation, before: Specimen, specimen: Specimen, deviations: Mapping[str, Array]
) -> Observation:
    if isinstance(observed, EdgeObservation):
        view = observed.view
        if view is None:
            return observed
        return replace(observed, view=replace(view, stand_off_mm=stand_off_under(view.stand_off_mm, deviations)))
    larger = np.array([specimen.length_mm / before.length_mm, specimen.width_mm / before.width_mm])
    step = observed.rest_mm * (larger - 1)
    return replace(observed, rest_mm=observed.rest_mm + step, moved_mm=observed.moved_mm + step)


@dataclass(frozen=True)
class Comparison:
    """P candidates against every experiment.

    unconverged: (P,) in any state; unstable: (P,) in any state, of those that converged; max_stretch: (P,); shapes,
    misfits: one an experiment, no shapes where candidates differ in more than the law.
    """

    unconverged: NDArray[np.bool_]
    unstable: NDArray[np.bool_]
    max_stretch: Array
    shapes: tuple[Shapes, ...]
    misfits: tuple[Misfit, ...]

    @property
    def error_mm(self) -> Array:
        """(P, K of all experiments)."""
        return np.concatenate([misfit.error_mm for misfit in self.misfits], axis=1)

    @property
    def deviation_mm(self) -> Array:
        """(P, K of all experiments)."""
        return np.concatenate([misfit.deviation_mm for misfit in self.misfits], axis=1)

    @property
    def objective_mm(self) -> Array:
        """(P,): mean over the states of the error; DISCARDED_MM where a candidate is not valid."""
        return np.where(self.unconverged | self.unstable, DISCARDED_MM, self.error_mm.mean(axis=1))

    def take(self, rows: NDArray[np.intp]) -> Comparison:
        """Some of the candidates."""
        return Comparison(
            unconverged=self.unconverged[rows],
            unstable=self.unstable[rows],
            max_stretch=self.max_stretch[rows],
            shapes=tuple(shapes.take(rows) for shapes in self.shapes),
            misfits=tuple(misfit.take(rows) for misfit in self.misfits),
        )


def joined(parts: Sequence[tuple[NDArray[np.intp], Comparison]]) -> Comparison:
    """Groups of candidates, which and how they compare, as one batch; without shapes, whose meshes may differ."""
    if len(parts) == 1:
        return parts[0][1]
    order = np.argsort(np.concatenate([rows for rows, _ in parts]))

    def together(arrays: Iterable[NDArray[Any]]) -> NDArray[Any]:
        return np.concatenate(list(arrays))[order]

    every = [comparison for _, comparison in parts]
    return Comparison(
        unconverged=together(c.unconverged for c in every),
        unstable=together(c.unstable for c in every),
        max_stretch=together(c.max_stretch for c in every),
        shapes=(),
        misfits=tuple(
            Misfit(
                residuals=together(m.residuals for m in own),
                weights=own[0].weights,
                error_mm=together(m.error_mm for m in own),
                deviation_mm=together(m.deviation_mm for m in own),
            )
            for own in zip(*(c.misfits for c in every), strict=True)
        ),
    )


def compare(
    law: Law,
    parameters: Array,
    experiments: Sequence[Experiment],
    *,
    bulk_modulus_Pa: Array | None = None,
    setups: Sequence[Setup] | None = None,
    near: Sequence[Shapes] = (),
    keep: bool = False,
) -> Comparison:
    """Simulate P candidates (P, n) in every experiment and measure their distance to what was seen.

    bulk_modulus_Pa: (P,), incompressible without it; setups: one an experiment, what is stated without them; near: of
    candidates near these, one an experiment, whose first is where these are sought from; keep: shapes that can be that.
    """
    every_shapes, misfits = [], []
    unconverged, unstable = np.zeros((2, len(parameters)), bool)
    stretch = np.ones(len(parameters))
    for index, experiment in enumerate(experiments):
        setup = setups[index] if setups else None
        start = near[index].every if near else None
        shapes = _solved(law, parameters, experiment, bulk_modulus_Pa, setup, start, keep)
        misfit = experiment.observed.misfit(experiment.solved, shapes, setup, experiment.change)
        unconverged |= ~np.isin(shapes.status, (Status.CONVERGED, Status.UNSTABLE)).all(axis=1)
        unstable |= (shapes.status == Status.UNSTABLE).any(axis=1)
        stretch = np.maximum(stretch, shapes.max_stretch.max(axis=1))
        every_shapes.append(shapes)
        misfits.append(misfit)
    return Comparison(
        unconverged=unconverged,
        unstable=unstable & ~unconverged,
        max_stretch=stretch,
        shapes=tuple(every_shapes),
        misfits=tuple(misfits),
    )


def _solved(
    law: Law,
    parameters: Array,
    experiment: Experiment,
    bulk_modulus_Pa: Array | None,
    setup: Setup | None,
    near: Configuration | None,
    keep: bool,
) -> Shapes:
    """Shapes of all candidates. Those that differ in roll or clamp alone bend alike, and are solved once."""
    first = own = np.arange(len(parameters))
    if setup is not None:
        bulk = np.zeros(len(parameters)) if bulk_modulus_Pa is None else bulk_modulus_Pa
        every = np.column_stack([parameters, bulk, setup.field_factor])
        _, found, place = np.unique(every, axis=0, return_index=True, return_inverse=True)
        first = np.sort(found)  # the first candidate stays the first
        own = np.searchsorted(first, found[place.reshape(-1)])
    more: dict[str, Any] = {"options": experiment.solid_options} if experiment.solid else {"near": near, "keep": keep}
    shapes = experiment.solved.solve(
        law,
        parameters[first],
        experiment.loads,
        tolerance_mm=TOLERANCE_MM,
        bulk_modulus_Pa=None if bulk_modulus_Pa is None else bulk_modulus_Pa[first],
        field_factor=None if setup is None else setup.field_factor[first],
        **more,
    )
    return shapes if setup is None else shapes.take(own)

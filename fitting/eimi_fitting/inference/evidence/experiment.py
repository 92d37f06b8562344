"""Describe an experiment by its loads and measurements, and compare simulations of it with the measurements."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.beside import SolidBeside, SolidOptions
from eimi_fitting.beam.equilibrium import Configuration, Status
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel, Shapes
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.beam.strip import Strip
from eimi_fitting.beam.view import View
from eimi_fitting.inference.evidence.measurements import EdgeObservation, Misfit, Observation, joined_misfits
from eimi_fitting.inference.evidence.sources import StatedSource, loads_under, specimen_under, view_under
from eimi_fitting.inference.evidence.unknowns import Setup
from eimi_fitting.laws.law import Law

Array = NDArray[np.float64]

# Objective of a candidate that is not valid. It is larger than that of any simulation, and finite, because CMA-ES would
# replace a NaN by the median of the generation.
DISCARDED_MM = 1e6
TOLERANCE_MM = (
    1e-2  # the last Newton step is shorter; the error is then below 1e-4 mm, and that of the edges is 1e-3 mm
)


@dataclass(frozen=True)
class Experiment:
    """One specimen under several loads, with the measurements of each load case.

    Parameters
    ----------
    model : BeamModel
        The planar model of the specimen.
    loads : Loads
        The loads of the K load cases.
    observed : EdgeObservation or PointObservation
        The measured edges or tracked points in the K load cases.
    change : ndarray, shape (K, 2, m), optional
        Correction (mm) added to the residuals at m points of two edges, or in x and y of m tracked points.
    solid : SolidBeside, optional
        A three-dimensional model, which then replaces the planar model in simulations.
    solid_options : SolidOptions, optional
        Options of the solver of the three-dimensional model.
    stated : tuple of StatedSource
        The standard uncertainties of inputs, such as the width of the specimen.
    measured : mapping of str to tuple of float
        Measured deviations from the specified dimensions, by the name of the input. The ``model`` has the measured
        dimensions.

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
    # One deviation for each component of the input, in the unit of the input. "taper" has a second: the width at both
    # ends minus the width in the middle, in mm.
    measured: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    @property
    def solved(self) -> BeamModel | SolidBeside:
        """The beam model of the simulations, planar or three-dimensional."""
        return self.solid or self.model

    @property
    def view(self) -> View | None:
        """The perspective of the edges; None for a telecentric or unknown lens, and for tracked points."""
        return self.observed.view if isinstance(self.observed, EdgeObservation) else None

    def of_states(self, states: NDArray[np.intp]) -> Experiment:
        """Return the experiment with only some of its load cases, given by their indices."""
        return replace(
            self,
            loads=self.loads.take(states),
            observed=self.observed.of_states(states),
            change=None if self.change is None else self.change[states],
        )

    def recorrected(self, misfit: Misfit, before: Experiment) -> Misfit:
        """Return residuals with the beam-model correction of this experiment in place of that of `before`."""
        # No simulation is needed, because the two experiments differ only in their corrections.
        difference = sum(
            (sign * e.change for sign, e in ((1, self), (-1, before)) if e.change is not None), start=np.zeros(1)
        )
        return self.observed.of_residuals(misfit.residuals + difference)

    def under(self, deviations: Mapping[str, Array]) -> Experiment:
        """Return the experiment with changed inputs, such as the width or the direction of gravity.

        Parameters
        ----------
        deviations : mapping of str to ndarray, shape (c,)
            Deviations of the c components of each input from the specified values, in its unit, by its name.
        """
        # An input that changes only the field strength or the image has no effect here; `Setup` contains its effect.
        if not deviations:
            return self
        before = self.model.specimen
        specimen = specimen_under(before, deviations)
        is_same = specimen == before
        return replace(
            self,
            model=self.model if is_same else self.model.of(specimen),
            solid=self.solid if is_same or not self.solid else self.solid.of(specimen),
            solid_options=self.solid_options if is_same else None,
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
        return replace(observed, view=view_under(view, deviations))
    # Tracked points move with the specimen.
    old, new = Strip(before), Strip(specimen)
    states, n, _ = observed.rest_mm.shape
    straight = old.straightened(observed.rest_mm.reshape(-1, 2))
    scale = (specimen.length_mm / before.length_mm, new.straight.width_mm / old.straight.width_mm)
    stretched = straight * np.array(scale)
    step = new.at_rest(stretched).reshape(states, n, 2) - observed.rest_mm
    depth = observed.depth_mm
    if depth is not None:
        z = old.straight_z_mm(straight[:, 0], depth.ravel()) * (new.straight.depth_mm / old.straight.depth_mm)
        depth = new.z_at_rest_mm(stretched[:, 0], z).reshape(states, n)
    return replace(observed, rest_mm=observed.rest_mm + step, moved_mm=observed.moved_mm + step, depth_mm=depth)


@dataclass(frozen=True)
class Comparison:
    """The residuals of simulations of all experiments with several candidate sets of parameters."""

    # There are P candidates.

    # (P,): whether a load case has no equilibrium, and whether the material is unstable in a load case.
    unconverged: NDArray[np.bool_]
    unstable: NDArray[np.bool_]
    # (P,): largest stretch in the beam.
    max_stretch: Array
    # Simulated shapes and residuals of each experiment.
    shapes: tuple[Shapes, ...]
    misfits: tuple[Misfit, ...]
    # Shapes in each experiment from which the solver can start.
    near: tuple[Shapes, ...] = ()

    @property
    def error_mm(self) -> Array:
        """Root mean square residual in mm, for each candidate law and load case."""
        return np.concatenate([misfit.error_mm for misfit in self.misfits], axis=1)

    @property
    def deviation_mm(self) -> Array:
        """Standard deviation of the residuals in mm, for each candidate law and load case."""
        return np.concatenate([misfit.deviation_mm for misfit in self.misfits], axis=1)

    @property
    def objective_mm(self) -> Array:
        """Mean of ``error_mm`` over all load cases, for each candidate law."""
        return np.where(self.unconverged | self.unstable, DISCARDED_MM, self.error_mm.mean(axis=1))

    def take(self, rows: NDArray[np.intp]) -> Comparison:
        """Return the comparison for some of the candidate sets of parameters only."""
        return Comparison(
            unconverged=self.unconverged[rows],
            unstable=self.unstable[rows],
            max_stretch=self.max_stretch[rows],
            shapes=tuple(shapes.take(rows) for shapes in self.shapes),
            misfits=tuple(misfit.take(rows) for misfit in self.misfits),
            near=self.near,
        )


def joined(parts: Sequence[tuple[NDArray[np.intp], Comparison]]) -> Comparison:
    """Join the results of several groups of candidates."""
    # Each group comes with the indices of its candidates.
    if len(parts) == 1:
        return parts[0][1]
    order = np.argsort(np.concatenate([rows for rows, _ in parts]))

    def in_order(arrays: Iterable[NDArray[Any]]) -> NDArray[Any]:
        return np.concatenate(list(arrays))[order]

    comparisons = [comparison for _, comparison in parts]
    return Comparison(
        unconverged=in_order(c.unconverged for c in comparisons),
        unstable=in_order(c.unstable for c in comparisons),
        max_stretch=in_order(c.max_stretch for c in comparisons),
        shapes=(),  # specimen or loads may differ among the groups
        misfits=tuple(
            joined_misfits(misfits).take(order) for misfits in zip(*(c.misfits for c in comparisons), strict=True)
        ),
        near=next(comparison.shapes for rows, comparison in parts if 0 in rows),
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
    by_lens: Sequence[tuple[NDArray[np.intp], Sequence[Mapping[str, Array]]]] = (),
) -> Comparison:
    """Simulate all experiments with several candidate sets of parameters, and compute the residuals."""
    # There are P candidates. parameters (P, n): in the order and units of the law. bulk_modulus_Pa (P,): None for an
    # incompressible material. setups: for each experiment, errors of the field strength and of the camera. near: for
    # each experiment, shapes from which the solver starts. keep: keep the solution of the first candidate, for `near`
    # in another call. by_lens: groups of candidates with equal errors of the lens: the indices of the candidates, and
    # these errors in each experiment.
    all_shapes, misfits = [], []
    unconverged, unstable = np.zeros((2, len(parameters)), bool)
    stretch = np.ones(len(parameters))
    for index, experiment in enumerate(experiments):
        setup = setups[index] if setups else None
        start = near[index].every if near else None
        shapes = _solved(law, parameters, experiment, bulk_modulus_Pa, setup, start, keep)
        misfit = _misfit(experiment, shapes, setup, [(rows, lenses[index]) for rows, lenses in by_lens])
        unconverged |= ~np.isin(shapes.status, (Status.CONVERGED, Status.UNSTABLE)).all(axis=1)
        unstable |= (shapes.status == Status.UNSTABLE).any(axis=1)
        stretch = np.maximum(stretch, shapes.max_stretch.max(axis=1))
        all_shapes.append(shapes)
        misfits.append(misfit)
    return Comparison(
        unconverged=unconverged,
        unstable=unstable & ~unconverged,
        max_stretch=stretch,
        shapes=tuple(all_shapes),
        misfits=tuple(misfits),
        near=tuple(all_shapes),
    )


def _misfit(
    experiment: Experiment,
    shapes: Shapes,
    setup: Setup | None,
    by_lens: Sequence[tuple[NDArray[np.intp], Mapping[str, Array]]],
) -> Misfit:
    model, change = experiment.solved, experiment.change
    if len(by_lens) < 2:
        through = experiment.under(by_lens[0][1]) if by_lens else experiment
        return through.observed.misfit(model, shapes, setup, change)
    misfits = [
        experiment.under(lens).observed.misfit(
            model, shapes.take(rows), None if setup is None else setup.take(rows), change
        )
        for rows, lens in by_lens
    ]
    return joined_misfits(misfits).take(np.argsort(np.concatenate([rows for rows, _ in by_lens])))


def _solved(
    law: Law,
    parameters: Array,
    experiment: Experiment,
    bulk_modulus_Pa: Array | None,
    setup: Setup | None,
    near: Configuration | None,
    keep: bool,
) -> Shapes:
    # candidates that differ only in the position of the camera have the same shape; one of them is solved
    solved = row = np.arange(len(parameters))
    if setup is not None:
        bulk = np.zeros(len(parameters)) if bulk_modulus_Pa is None else bulk_modulus_Pa
        inputs = np.column_stack([parameters, bulk, setup.field_factor])
        _, first_rows, group = np.unique(inputs, axis=0, return_index=True, return_inverse=True)
        solved = np.sort(first_rows)  # the first candidate stays the first
        row = np.searchsorted(solved, first_rows[group.reshape(-1)])
    more: dict[str, Any] = {"options": experiment.solid_options} if experiment.solid else {"near": near, "keep": keep}
    shapes = experiment.solved.solve(
        law,
        parameters[solved],
        experiment.loads,
        tolerance_mm=TOLERANCE_MM,
        bulk_modulus_Pa=None if bulk_modulus_Pa is None else bulk_modulus_Pa[solved],
        field_factor=None if setup is None else setup.field_factor[solved],
        **more,
    )
    return shapes if setup is None else shapes.take(row)

"""Correct the residuals of a fit to those of an accurate beam model, which is solved only at the optimum."""

# The search uses a fast model, with the residuals r(x) for the unknowns x and the optimum x_0. The accurate model has a
# finer mesh or three dimensions, and the residuals R(x). The fit is repeated with the residuals
#
#     r(x) + R(x_0) - r(x_0)
#
# (deferred correction; Stetter 1978, Numer. Math. 29:425).

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.beside import SolidBeside, SolidOptions, SolidShapes
from eimi_fitting.beam.depth_effect import DepthEffect
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.outline import Model, outline
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.beam.strip import Strip
from eimi_fitting.inference.evidence.experiment import Comparison, Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation, Misfit

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Refinement:
    """An accurate beam model for an experiment: a finer planar mesh or a three-dimensional model."""

    # Name of the model in a result.
    name: str
    # Takes an experiment and returns it with the accurate model.
    better: Callable[[Experiment], Experiment]
    # Error that remains in the parameters after the correction by the accurate model, divided by the correction.
    remaining_share: float
    # Warning about a fit in which the accurate model has no equilibrium.
    doubt: str


def _halved(experiment: Experiment) -> Experiment:
    is_solid = experiment.model.specimen.section == "solid"
    return experiment if is_solid else replace(experiment, model=experiment.model.halved())


# The corner where a free side meets the clamp is singular. In an incompressible material in plane strain, the
# displacement at the distance d from the corner grows as d^0.595 (Williams 1952, J. Appl. Mech. 19:526: the exponent
# lambda solves sin^2(pi lambda / 2) = 1 - lambda^2). Quantities of the whole beam therefore converge as h^1.19 in the
# element size h, for elements of any order; 1.19 is twice the exponent. Halving h removes the share 1 - 2^-1.19 of the
# error. The remaining error is 1 / (2^1.19 - 1) = 0.78 times the change (Richardson extrapolation; Roache 1998,
# Verification and Validation in Computational Science and Engineering, section 5.5).
MESH_ORDER = 1.19  # order of convergence in the element size
FINER_MESH = Refinement(
    name="mesh",
    better=_halved,
    remaining_share=1 / (2**MESH_ORDER - 1),
    doubt="with these parameters no equilibrium was found on a finer mesh. Parameters and intervals do not contain the "
    "error of the mesh, which is often some tenths of a per cent of the modulus",
)


@lru_cache(maxsize=8)
def solid_beside(specimen: Specimen) -> SolidBeside:
    """Return the three-dimensional beam model of a specimen."""
    across = round(ALONG * Strip(specimen).straight.width_mm / specimen.flexible_length_mm)
    return SolidBeside(specimen, ALONG, min(max(across, _LEAST_ACROSS), _MOST_ACROSS))


def _solid(experiment: Experiment) -> Experiment:
    specimen = experiment.model.specimen
    return replace(experiment, solid=solid_beside(specimen)) if specimen.section == "solid" else experiment


def polished(experiment: Experiment) -> Experiment:
    """Return the experiment with the planar mesh of its three-dimensional model, if the specimen is a solid."""
    # The fit uses this mesh after the search.
    specimen = experiment.model.specimen
    return replace(experiment, model=_on_lines_of_solid(specimen)) if specimen.section == "solid" else experiment


@lru_cache(maxsize=8)
def _on_lines_of_solid(specimen: Specimen) -> BeamModel:
    beside = solid_beside(specimen)
    return BeamModel(specimen, beside.planar.along, beside.planar.across, beside.planar.plane)


ALONG, _LEAST_ACROSS, _MOST_ACROSS = 20, 2, 4
_FIRST = np.zeros(1, np.intp)
# The fast model assumes plane stress. In a beam of finite depth, the clamp and the magnet prevent the lateral
# contraction of the cross-section near them, and a bent cross-section curves across its width and depth. If the depth
# of the magnet is smaller than the depth of the beam, silicone covers the magnet in the direction of the depth and
# deforms there. These effects change the modulus by some per cent and the edges by tens of micrometres, much more than
# the noise. The correction is therefore computed again at each new optimum, until the modulus hardly changes. The mesh
# of the three-dimensional model is fine enough: meshes of 20 x 2 and of 36 x 4 elements give moduli that differ by less
# than 0.1 %. The change by a finer planar mesh is not added, because the stress at the corner of the clamp is different
# in a three-dimensional model.
SOLID = Refinement(
    name="section",
    better=_solid,
    remaining_share=0.05,
    doubt="with these parameters no equilibrium of the solid was found. The beam is assumed in plane stress, which "
    "makes the modulus wrong by some per cent. Parameters and intervals do not contain this error",
)


def refinements(experiments: Sequence[Experiment]) -> tuple[Refinement, ...]:
    """Return the accurate models of the experiments: finer planar meshes, three-dimensional models, or both."""
    sections = {e.model.specimen.section for e in experiments}
    return (*([SOLID] if "solid" in sections else []), *([FINER_MESH] if sections - {"solid"} else []))


@dataclass(frozen=True)
class Correction:
    """The change of the residuals of a fit in mm if an accurate beam model replaces the fast one."""

    refinement: Refinement
    # (K, 2, m) for each experiment: change in K load cases at m points of the two edges (or in x and y).
    changes: tuple[Array, ...]
    # Residuals and shapes of the accurate model.
    better: Comparison
    # The accurate model of each experiment.
    models: tuple[Model, ...]
    # For each experiment, displacements of the three-dimensional model minus those of the planar model.
    effects: tuple[DepthEffect | None, ...]

    def without_shapes(self) -> Correction:
        """Return a copy without the simulated shapes of the beam, which needs less memory."""
        return replace(self, better=replace(self.better, shapes=()))

    def added(self, experiments: Sequence[Experiment]) -> tuple[Experiment, ...]:
        """Return the experiments with this correction added to their residuals."""
        return tuple(
            replace(e, change=change if e.change is None else e.change + change)
            for e, change in zip(experiments, self.changes, strict=True)
        )


def with_residuals_of(
    better: Comparison, experiments: Sequence[Experiment], here: Comparison
) -> tuple[Experiment, ...]:
    """Add the residuals of the accurate model (`better`) minus those of the fast model (`here`) to experiments."""
    return tuple(
        replace(e, change=(0.0 if e.change is None else e.change) + finer.residuals[0] - plain.residuals[0])
        for e, finer, plain in zip(experiments, better.misfits, here.misfits, strict=True)
    )


def correction(
    refinement: Refinement,
    experiments: Sequence[Experiment],
    here: Comparison,
    compare: Callable[[Sequence[Experiment]], Comparison],
    near: Sequence[Correction] = (),
    options: SolidOptions | None = None,
) -> Correction | None:
    """Compute the change of the residuals of a fit if an accurate beam model replaces the fast one."""
    # here: comparison of the fast model with the data, for the fitted parameters. compare: makes the same comparison
    # for given experiments, which contain their beam models. near: corrections of similar parameters; the solver of the
    # three-dimensional model starts from their shapes.
    # Only the first set of parameters of ``here`` is used.
    options = options or SolidOptions()
    refined = [refinement.better(e) for e in experiments]
    for i, e in enumerate(refined):
        if e.solid:
            similar = tuple(effect for earlier in near if (effect := earlier.effects[i]))
            has_planar_shapes = here.shapes and e.solid.has_mesh_of(e.model)
            planar_shapes = here.shapes[i].take(_FIRST) if has_planar_shapes else None
            refined[i] = replace(e, solid_options=replace(options, similar=similar, planar_shapes=planar_shapes))
    better = compare(refined)
    # A finer mesh reaches larger stretches near a singular corner, where the law may be unstable. The edges are valid
    # all the same, so that an unstable candidate is accepted here.
    if here.unconverged[0] or better.unconverged[0]:
        return None
    changes = tuple(
        finer.residuals[0] - plain.residuals[0] for finer, plain in zip(better.misfits, here.misfits, strict=True)
    )
    effects = tuple(s.effect if isinstance(s, SolidShapes) else None for s in better.shapes)
    return Correction(refinement, changes, better, tuple(e.solved for e in refined), effects)


def by_better_model(
    experiment: Experiment,
    here: Comparison,
    compare: Callable[[Sequence[Experiment]], Comparison],
    near: Sequence[Correction] = (),
    options: SolidOptions | None = None,
) -> tuple[Misfit, Array, Correction | None] | None:
    """Return residuals and edges of an accurate beam model, and the `Correction` of the fast model to it."""
    # The parameters are those of `correction`. The edges have the shape (K, 2, S, 3, 2): K load cases, two edges, S
    # segments, three points, x and y in mm. The whole result is None without an equilibrium of fast or solid model.
    if here.unconverged[0]:
        return None
    (refinement,) = refinements([experiment])
    better = correction(refinement, [experiment], here, compare, near, options)
    if better is None and refinement is SOLID:
        return None
    # Without an equilibrium on a finer mesh, the result contains the residuals and edges of the fast model.
    observed, residuals = experiment.observed, here.misfits[0].residuals
    view = observed.view if isinstance(observed, EdgeObservation) else None
    model, shapes = (better.models[0], better.better.shapes[0]) if better else (experiment.model, here.shapes[0])
    misfit = observed.of_residuals(residuals + better.changes[0] if better else residuals)
    return misfit, outline(model, shapes, view)[0], better

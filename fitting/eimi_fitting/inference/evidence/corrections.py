"""Correct the residuals of a fit by a more exact beam model, which is solved only at the optimum.

The search uses a fast beam model, with the residuals r(x) for the unknowns x and the optimum x_0. A more exact model
has the residuals R(x). The fit is repeated with the residuals

    r(x) + R(x_0) - r(x_0)

(deferred correction; Stetter 1978, Numer. Math. 29:425). The new optimum is close to the optimum of R, although the
more exact model is solved only for x_0. If there are several more exact models, their changes R - r are added. These
models have an error, too. It is estimated as a share of the change of the optimum by the correction. The interval of
the fit contains this error as a normal error, with the estimate as its 95 % bound.

The finer mesh. The corner where a free side meets the clamp is singular. In an incompressible material in plane strain,
the displacement at the distance d from the corner grows as d^0.595 (Williams 1952, J. Appl. Mech. 19:526: the exponent
lambda solves sin^2(pi lambda / 2) = 1 - lambda^2). Quantities of the whole beam therefore converge as h^1.19 in the
element size h, for elements of any order; 1.19 is twice the exponent. Halving h removes the share 1 - 2^-1.19 of the
error. The remaining error is 1 / (2^1.19 - 1) = 0.78 times the change (Richardson extrapolation; Roache 1998,
Verification and Validation in Computational Science and Engineering, section 5.5).

The three-dimensional model. The fast model assumes plane stress. In a beam of finite depth, the clamp and the magnet
prevent the lateral contraction of the cross-section near them, and a bent cross-section curves across its width and
depth. If the depth of the magnet is smaller than the depth of the beam, silicone covers the magnet in the direction of
the depth and deforms there. These effects change the modulus by some per cent and the edges by tens of micrometres,
much more than the noise, and no planar model contains them. The correction is therefore computed again at each new
optimum, until the modulus hardly changes. The correction for a finer planar mesh is not added, because the stress at
the corner of the clamp is different in a three-dimensional model. The mesh of the three-dimensional model is fine
enough: meshes of 20 x 2 and of 36 x 4 elements give moduli that differ by less than 0.1 %.
"""

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
    """A way to simulate an experiment more exactly: with a finer planar mesh or with a three-dimensional model.

    Parameters
    ----------
    name : str
        Name of the more exact model in a result.
    better : callable
        Takes an experiment and returns the experiment with the more exact model.
    remaining_share : float
        Estimated error of the fitted parameters with the more exact model, divided by their change from the fast to the
        more exact model.
    doubt : str
        Text of the warning about a fit for which the solver of the more exact model finds no equilibrium.
    """

    name: str
    better: Callable[[Experiment], Experiment]
    remaining_share: float
    doubt: str


def _halved(experiment: Experiment) -> Experiment:
    is_solid = experiment.model.specimen.section == "solid"
    return experiment if is_solid else replace(experiment, model=experiment.model.halved())


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
    """Return the three-dimensional model of a specimen, which also contains a planar model of the same specimen."""
    across = round(ALONG * Strip(specimen).straight.width_mm / specimen.flexible_length_mm)
    return SolidBeside(specimen, ALONG, min(max(across, _LEAST_ACROSS), _MOST_ACROSS))


def _solid(experiment: Experiment) -> Experiment:
    specimen = experiment.model.specimen
    return replace(experiment, solid=solid_beside(specimen)) if specimen.section == "solid" else experiment


def polished(experiment: Experiment) -> Experiment:
    """Return the experiment with the planar mesh that the Gauss-Newton steps at the end of a fit use.

    For a solid section, this is the planar mesh that belongs to the three-dimensional model. Otherwise the mesh stays
    the same.
    """
    specimen = experiment.model.specimen
    return replace(experiment, model=_on_lines_of_solid(specimen)) if specimen.section == "solid" else experiment


@lru_cache(maxsize=8)
def _on_lines_of_solid(specimen: Specimen) -> BeamModel:
    beside = solid_beside(specimen)
    return BeamModel(specimen, beside.planar.along, beside.planar.across, beside.planar.plane)


ALONG, _LEAST_ACROSS, _MOST_ACROSS = 20, 2, 4
_FIRST = np.zeros(1, np.intp)
SOLID = Refinement(
    name="section",
    better=_solid,
    remaining_share=0.05,
    doubt="with these parameters no equilibrium of the solid was found. The beam is assumed in plane stress, which "
    "makes the modulus wrong by some per cent. Parameters and intervals do not contain this error",
)


def refinements(experiments: Sequence[Experiment]) -> tuple[Refinement, ...]:
    """Return the kinds of more exact models that the experiments need: finer planar meshes, three-dimensional ones."""
    sections = {e.model.specimen.section for e in experiments}
    return (*([SOLID] if "solid" in sections else []), *([FINER_MESH] if sections - {"solid"} else []))


@dataclass(frozen=True)
class Correction:
    """The change of the residuals of a fit (measured minus simulated positions) by a more exact beam model.

    Parameters
    ----------
    refinement : Refinement
        The more exact beam model: a finer planar mesh or a three-dimensional model.
    changes : tuple of ndarray, shape (K, G, m)
        For each experiment, the residuals of the more exact model minus the residuals of the fast model, in mm. There
        are K load cases, G groups of points (the two edges, or x and y of tracked points) and m points.
    better : Comparison
        The residuals of the more exact model, with its simulated shapes of the beam.
    models : tuple of Model
        The more exact model of each experiment.
    effects : tuple of DepthEffect or None
        For each experiment, the displacements of the three-dimensional model minus those of the planar model. None if
        the more exact model is planar.
    """

    refinement: Refinement
    changes: tuple[Array, ...]
    better: Comparison
    models: tuple[Model, ...]
    effects: tuple[DepthEffect | None, ...]

    def without_shapes(self) -> Correction:
        """Return this correction without the simulated shapes of the beam, to save memory."""
        return replace(self, better=replace(self.better, shapes=()))

    def added(self, experiments: Sequence[Experiment]) -> tuple[Experiment, ...]:
        """Return the experiments with this change added to the corrections of their residuals."""
        return tuple(
            replace(e, change=change if e.change is None else e.change + change)
            for e, change in zip(experiments, self.changes, strict=True)
        )


def with_residuals_of(
    better: Comparison, experiments: Sequence[Experiment], here: Comparison
) -> tuple[Experiment, ...]:
    """Return the experiments, corrected so that the present beam model gives the residuals of a more exact one.

    A residual is the measured minus the simulated position. Simulations of the corrected experiments with the present
    model and the parameters of ``here`` have the residuals of ``better``.

    Parameters
    ----------
    better : Comparison
        Residuals of the more exact model.
    experiments : sequence of Experiment
        The experiments, with their earlier corrections.
    here : Comparison
        Residuals of the present model, with the earlier corrections, for the same parameters of the law.

    Returns
    -------
    tuple of Experiment
        The experiments with their new corrections.
    """
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
    """Compute the change of the residuals (measured minus simulated positions) by a more exact beam model.

    Parameters
    ----------
    refinement : Refinement
        The more exact model: a finer planar mesh or a three-dimensional model.
    experiments : sequence of Experiment
        The experiments, with the present model.
    here : Comparison
        Residuals of the present model. Only its first set of parameters is used.
    compare : callable
        Takes experiments, simulates them with the first set of parameters of ``here``, and returns their `Comparison`.
    near : sequence of Correction
        Corrections for similar parameters, from which the solver of a three-dimensional model starts.
    options : SolidOptions, optional
        Options of the solver of a three-dimensional model.

    Returns
    -------
    Correction or None
        The correction; None if the solver finds no equilibrium with the present or with the more exact model.
    """
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
    """Simulate one experiment with a more exact beam model: a finer planar mesh or a three-dimensional model.

    Parameters
    ----------
    experiment : Experiment
        The experiment, with the present model.
    here : Comparison
        Residuals of the present model. Only its first set of parameters is used.
    compare : callable
        Takes experiments, simulates them with the first set of parameters of ``here``, and returns their `Comparison`.
    near : sequence of Correction
        Corrections for similar parameters, from which the solver of a three-dimensional model starts.
    options : SolidOptions, optional
        Options of the solver of a three-dimensional model.

    Returns
    -------
    tuple or None
        The residuals of the more exact model, the simulated edges of the beam, and the correction. The edges have the
        shape (K, 2, S, 3, 2): K load cases, two edges, S quadratic segments, three points, x and y in mm.

        If the solver finds no equilibrium on a finer mesh, the residuals and edges of the present mesh are returned,
        with None as correction. If it finds none with a three-dimensional model or with the present model, the result
        is None.
    """
    if here.unconverged[0]:
        return None
    (refinement,) = refinements([experiment])
    better = correction(refinement, [experiment], here, compare, near, options)
    if better is None and refinement is SOLID:
        return None
    observed, residuals = experiment.observed, here.misfits[0].residuals
    view = observed.view if isinstance(observed, EdgeObservation) else None
    model, shapes = (better.models[0], better.better.shapes[0]) if better else (experiment.model, here.shapes[0])
    misfit = observed.of_residuals(residuals + better.changes[0] if better else residuals)
    return misfit, outline(model, shapes, view)[0], better

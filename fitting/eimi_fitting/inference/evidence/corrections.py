"""What a better model of the same specimen changes in the residuals, found at the optimum alone.

The change of the residuals at the optimum is added to those of all candidates near it, and the optimum is sought once
more (deferred correction; Stetter 1978, Numer. Math. 29:425): the parameters are then those of the better model, for
little more than one candidate's cost on it. Changes by several models add up. What is left is stated in the interval,
as the bound of 95 % of a normal error.

The finer mesh: the corner where a free side meets the clamp is singular. In an incompressible material in plane strain
the displacement goes there as r^0.595 (Williams 1952, J. Appl. Mech. 19:526: sin^2(pi lambda / 2) = 1 - lambda^2), so
that whole-beam quantities converge as h^1.19, whatever the element's order. From a mesh to one twice as fine goes
1 - 2^-1.19 of the error; what is then left is 0.78 of that change (Richardson extrapolation; Roache 1998, Verification
and Validation, section 5.5).

The solid: the search model of a beam is in plane stress. In the solid clamp and magnet hold the section, it bows, and
silicone before and behind a shallower magnet is soft: some per cent of the modulus, and tens of micrometres of the
edges that no planar model follows. What it changes is far more than noise; so it is found once more at the optimum that
it led to, until that stays. The residuals are then the solid's own, on its own mesh: what a finer mesh changes in plane
stress is not added, because the section that is free there is held in the solid, whose corner is another one. On 20 x 2
elements the solid is at most 0.1 % of the modulus from a mesh of 36 x 4, with the plane's change or without.
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
from eimi_fitting.inference.evidence.experiment import Comparison, Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation, Misfit

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Refinement:
    """A better model: its name in a result, how it is made, which share of its effect is left, and what its lack means.

    better: an experiment simulated by it; left: of what it moves the optimum by, the share that remains uncertain;
    doubt: said of a fit for which it finds no equilibrium.
    """

    name: str
    better: Callable[[Experiment], Experiment]
    left: float
    doubt: str


def _halved(experiment: Experiment) -> Experiment:
    is_solid = experiment.model.specimen.section == "solid"
    return experiment if is_solid else replace(experiment, model=experiment.model.halved())


MESH_ORDER = 1.19  # of convergence in the size of the elements
FINER_MESH = Refinement(
    name="mesh",
    better=_halved,
    left=1 / (2**MESH_ORDER - 1),
    doubt="with these parameters a finer mesh finds no equilibrium: what the mesh does to the edges (often "
    "some tenths of a per cent of the modulus) is neither in the parameters nor in the intervals",
)


@lru_cache(maxsize=8)
def solid_beside(specimen: Specimen) -> SolidBeside:
    """The solid of a specimen and its planar model, on lines that are enough."""
    across = round(ALONG * specimen.width_mm / specimen.flexible_length_mm)
    return SolidBeside(specimen, ALONG, min(max(across, _LEAST_ACROSS), _MOST_ACROSS))


def _solid(experiment: Experiment) -> Experiment:
    specimen = experiment.model.specimen
    return replace(experiment, solid=solid_beside(specimen)) if specimen.section == "solid" else experiment


def polished(experiment: Experiment) -> Experiment:
    """On the model that follows small steps of the parameters: of a solid, the planar one on its lines."""
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
    left=0.05,
    doubt="with these parameters the solid finds no equilibrium: the beam is taken in plane stress, which makes the "
    "modulus some per cent wrong, and neither the parameters nor the intervals hold that",
)


def refinements(experiments: Sequence[Experiment]) -> tuple[Refinement, ...]:
    """Those that are due to these experiments."""
    sections = {e.model.specimen.section for e in experiments}
    return (*([SOLID] if "solid" in sections else []), *([FINER_MESH] if sections - {"solid"} else []))


@dataclass(frozen=True)
class Correction:
    """What a refinement changes for one candidate: changes, (K, G, m) mm of each experiment.

    better: its comparison; models: that it was made with; effects: of depth, in each experiment.
    """

    refinement: Refinement
    changes: tuple[Array, ...]
    better: Comparison
    models: tuple[Model, ...]
    effects: tuple[DepthEffect | None, ...]

    def without_shapes(self) -> Correction:
        """The same without where each node stands in each state, which is large and known from the effects."""
        return replace(self, better=replace(self.better, shapes=()))

    def added(self, experiments: Sequence[Experiment]) -> tuple[Experiment, ...]:
        """The experiments with the changes added to what is added to their residuals already."""
        return tuple(
            replace(e, change=change if e.change is None else e.change + change)
            for e, change in zip(experiments, self.changes, strict=True)
        )


def with_residuals_of(
    better: Comparison, experiments: Sequence[Experiment], here: Comparison
) -> tuple[Experiment, ...]:
    """The experiments with changes that make their residuals for a candidate, those of ``here``, a better model's."""
    return tuple(
        replace(e, change=(0.0 if e.change is None else e.change) + there.residuals[0] - own.residuals[0])
        for e, there, own in zip(experiments, better.misfits, here.misfits, strict=True)
    )


def correction(
    refinement: Refinement,
    experiments: Sequence[Experiment],
    here: Comparison,
    compare: Callable[[Sequence[Experiment]], Comparison],
    near: Sequence[Correction] = (),
    options: SolidOptions | None = None,
) -> Correction | None:
    """What the refinement changes for a candidate; None where the better model finds no equilibrium.

    here: of the experiments, with the candidate first; compare: says how far the candidate is from experiments; near:
    of candidates near this one; options: how a solid is solved.
    """
    options = options or SolidOptions()
    every = [refinement.better(e) for e in experiments]
    for i, e in enumerate(every):
        if e.solid:
            similar = tuple(effect for earlier in near if (effect := earlier.effects[i]))
            has_planar_shapes = here.shapes and e.solid.has_mesh_of(e.model)
            planar_shapes = here.shapes[i].take(_FIRST) if has_planar_shapes else None
            every[i] = replace(e, solid_options=replace(options, similar=similar, planar_shapes=planar_shapes))
    better = compare(every)
    # Nearer to a singular corner the stretch is larger, and may be beyond the law's stability; the edges still tell.
    if here.unconverged[0] or better.unconverged[0]:
        return None
    changes = tuple(
        there.residuals[0] - own.residuals[0] for there, own in zip(better.misfits, here.misfits, strict=True)
    )
    effects = tuple(s.effect if isinstance(s, SolidShapes) else None for s in better.shapes)
    return Correction(refinement, changes, better, tuple(e.solved for e in every), effects)


def by_better_model(
    experiment: Experiment,
    here: Comparison,
    compare: Callable[[Sequence[Experiment]], Comparison],
    near: Sequence[Correction] = (),
    options: SolidOptions | None = None,
) -> tuple[Misfit, Array, Correction | None] | None:
    """Simulate a candidate by the better model that is due to an experiment; for the arguments see `correction`.

    Returns
    -------
    tuple or None
        The misfit with what the better model changes, the outline (K, 2, n, 2) in mm, and the correction. Where the
        finer mesh finds no equilibrium, misfit and outline are those of the coarse mesh and there is no correction.
        None where the planar model or the solid finds no equilibrium.
    """
    if here.unconverged[0]:
        return None
    (due,) = refinements([experiment])
    better = correction(due, [experiment], here, compare, near, options)
    if better is None and due is SOLID:
        return None
    observed, residuals = experiment.observed, here.misfits[0].residuals
    view = observed.view if isinstance(observed, EdgeObservation) else None
    model, shapes = (better.models[0], better.better.shapes[0]) if better else (experiment.model, here.shapes[0])
    misfit = observed.of_residuals(residuals + better.changes[0] if better else residuals)
    return misfit, outline(model, shapes, view)[0], better

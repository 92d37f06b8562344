"""What the mesh does to the edges, found on a mesh twice as fine, at the optimum alone.

The corner where a free side meets the clamp is singular: in an incompressible material in plane strain the displacement
goes there as r^0.595 (Williams 1952, J. Appl. Mech. 19:526: sin^2(pi lambda / 2) = 1 - lambda^2), so that whole-beam
quantities converge as h^1.19, whatever the element's order. From a mesh to one twice as fine goes 1 - 2^-1.19 of the
error; what is then left is 0.78 of that change (Richardson extrapolation; Roache 1998, Verification and Validation,
section 5.5).

The change of the residuals at the optimum is added to those of all candidates near it, and the optimum is sought once
more (deferred correction; Stetter 1978, Numer. Math. 29:425): the parameters are then those of the finer mesh, for
little more than one candidate's cost on it. What is left is stated in the interval, as the bound of 95 % of a normal
error.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from eimi_fitting.experiment import Comparison, Experiment

LEFT = 1 / (2**1.19 - 1)  # of the change, once it is taken out

Compare = Callable[[Sequence[Experiment]], Comparison]


def mesh_corrected(experiments: Sequence[Experiment], compare: Compare) -> tuple[Experiment, ...] | None:
    """The experiments with what elements of half the size change; None where they find no solution.

    compare: takes experiments, and says how far the candidate is from them about which the change is wanted.
    """
    plain = tuple(replace(experiment, mesh_change=None) for experiment in experiments)
    here = compare(plain)
    there = compare([replace(experiment, model=experiment.model.halved()) for experiment in plain])
    # Nearer to the singular corner the stretch is larger, and may be beyond the law's stability; the edges still tell.
    if here.unconverged[0] or there.unconverged[0]:
        return None
    return tuple(
        replace(experiment, mesh_change=finer.residuals[0] - own.residuals[0])
        for experiment, finer, own in zip(plain, there.misfits, here.misfits, strict=True)
    )

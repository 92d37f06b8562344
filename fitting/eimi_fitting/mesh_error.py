"""What the mesh does to the parameters, found on a mesh twice as fine, at the optimum alone.

The corner where a free side meets the clamp is singular: in an incompressible material in plane strain the displacement
goes there as r^0.595 (Williams 1952, J. Appl. Mech. 19:526: sin^2(pi lambda / 2) = 1 - lambda^2), so that whole-beam
quantities converge as h^1.19, whatever the element's order. From a mesh to one twice as fine goes 1 - 2^-1.19 of the
error; what is then left is 0.78 of that change (Richardson extrapolation; Roache 1998, Verification and Validation,
section 5.5).

The change is taken out of the parameters by one Gauss-Newton step. What is left is not: it is stated in the interval,
as the bound of 95 % of a normal error.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.forward import BeamModel
from eimi_fitting.linearised import Linearised
from eimi_fitting.problem import Problem

Array = NDArray[np.float64]

LEFT = 1 / (2**1.19 - 1)  # of the change, once it is taken out
_STATES = 5  # of each experiment are simulated on the finer mesh


def mesh_pull(problem: Problem, about: Linearised) -> Array | None:
    """(n,): what a mesh twice as fine adds to sum w_k J'r; None where it finds no solution."""
    chosen, finer = [], []
    for experiment in problem.experiments:
        k = len(experiment.loads)
        states = np.unique(np.round(np.linspace(0, k - 1, min(k, _STATES))).astype(int))
        model = experiment.model
        chosen.append(states)
        finer.append(
            replace(experiment.of_states(states), model=BeamModel(model.specimen, 2 * model.along, 2 * model.across))
        )
    judged = problem.judge(about.unit[None], about.independent_points, finer)
    if judged.unconverged[0]:
        return None
    pull = np.zeros(len(about.unit))
    for d, (states, misfit) in enumerate(zip(chosen, judged.comparison.misfits, strict=True)):
        change = misfit.residuals[0] - about.residuals[d][states]
        share = len(about.residuals[d]) / len(states)
        pull += share * np.einsum("k,ikgn,kgn->i", about.weights[d][states], about.slopes[d][:, states], change)
    return pull

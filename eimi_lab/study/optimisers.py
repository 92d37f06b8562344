"""Compare CMA-ES with Gauss-Newton, Nelder-Mead and differential evolution."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from eimi_fitting.beam.model import BeamModel
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.objective import Evaluation, Problem
from eimi_fitting.inference.evidence.unknowns import Unknowns
from eimi_fitting.inference.searching.polish import polish
from eimi_fitting.inference.searching.search import search
from eimi_fitting.laws import LAWS, search_space
from eimi_lab.study.extent import TRAINED_ON, Extent
from eimi_lab.study.hidden_materials import MATERIALS
from eimi_lab.study.observed import experiment_of, field_mT, noise_mm, outlines_mm, specimen_of

Array = NDArray[np.float64]

_STATES, _STRIDE = 6, 3  # number of states; every third point of an edge is used
_MOST = 1200  # evaluations of one search
_NEAR = 0.01


@dataclass
class _Counted:
    """An optimisation problem that records all evaluated sets of parameters and their errors."""

    problem: Problem
    units: list[Array] = field(default_factory=list)
    values: list[float] = field(default_factory=list)

    def evaluate(self, units: Array) -> Evaluation:
        """Evaluate and record P sets of n parameters, scaled from 0 to 1, shape (P, n)."""
        evaluation = self.problem.evaluate(units, 1.0)
        self.units += list(np.atleast_2d(units))
        self.values += evaluation.objective_mm.tolist()
        return evaluation

    def objective(self, unit: Array) -> float:
        """Return the mean error (mm) for one set of n parameters, scaled from 0 to 1, shape (n,)."""
        return float(self.evaluate(unit[None]).objective_mm[0])

    def moduli_Pa(self) -> Array:
        """Return the modulus of the best parameters after each evaluation."""
        values = np.array(self.values)
        best = np.maximum.accumulate(np.where(values <= np.minimum.accumulate(values), np.arange(len(values)), 0))
        parameters = self.problem.unknowns.parameters(np.array(self.units)[best])
        return np.asarray(self.problem.law.initial_shear_modulus(parameters))


def _cma_es(counted: _Counted, n: int, seed: int) -> None:
    search(counted.evaluate, n, seed=seed)


def _gauss_newton(counted: _Counted, n: int, seed: int) -> None:
    polish(lambda units, _: counted.evaluate(units), np.full(n, 0.5))


def _nelder_mead(counted: _Counted, n: int, seed: int) -> None:
    start = np.random.default_rng(seed).uniform(size=n)
    options = {"maxfev": _MOST, "xatol": 1e-3, "fatol": 1e-4}
    scipy.optimize.minimize(counted.objective, start, method="Nelder-Mead", bounds=[(0.0, 1.0)] * n, options=options)


def _differential_evolution(counted: _Counted, n: int, seed: int) -> None:
    scipy.optimize.differential_evolution(
        lambda units: counted.evaluate(units.T).objective_mm,
        [(0.0, 1.0)] * n,
        popsize=15,
        maxiter=_MOST // (15 * n),
        tol=1e-3,
        rng=seed,
        polish=False,
        vectorized=True,
        updating="deferred",
    )


OPTIMISERS: dict[str, Callable[[_Counted, int, int], None]] = {
    "CMA-ES": _cma_es,
    "Gauss-Newton": _gauss_newton,
    "Nelder-Mead": _nelder_mead,
    "differential evolution": _differential_evolution,
}


def evaluations_to_one_percent(extent: Extent, seed: int) -> list[dict[str, Any]]:
    """Run each optimiser on each law, with several seeds.

    Returns
    -------
    list of dict
        A row for each law and optimiser, with lists over the seeds: `to_one_percent` (evaluations until the modulus
        stays within one per cent of the optimum), `evaluations` (all evaluations) and `least_error_um` (smallest
        error).
    """
    experiment = _experiment()
    rows = []
    for law in ("neo-hookean", "yeoh", "ogden")[: extent.cases]:
        problem = Problem(LAWS[law], Unknowns(search_space(LAWS[law])), (experiment,))
        runs = {
            name: [_run(optimiser, problem, seed + i) for i in range(1 if name == "Gauss-Newton" else extent.cases)]
            for name, optimiser in OPTIMISERS.items()
        }
        best = min((run for by_seed in runs.values() for run in by_seed), key=lambda run: min(run.values))
        target = float(best.moduli_Pa()[-1])
        for name, by_seed in runs.items():
            rows.append(
                {
                    "law": law,
                    "optimiser": name,
                    "to_one_percent": [_reached(run.moduli_Pa(), target) for run in by_seed],
                    "evaluations": [len(run.values) for run in by_seed],
                    "least_error_um": [1e3 * min(run.values) for run in by_seed],
                }
            )
    return rows


def _experiment() -> Experiment:
    key = "dragon_skin_10"
    fields = field_mT(MATERIALS[key], Extent(states=_STATES))
    edges = outlines_mm(MATERIALS[key], specimen_of(TRAINED_ON), fields)[:, :, ::_STRIDE]
    edges = edges + noise_mm(edges.shape, "optimisers")
    experiment = experiment_of(TRAINED_ON, edges, fields, "solid")
    specimen = experiment.model.specimen
    return replace(experiment, model=BeamModel(specimen, plane=specimen.planar_section))


def _run(optimiser: Callable[[_Counted, int, int], None], problem: Problem, seed: int) -> _Counted:
    counted = _Counted(problem)
    optimiser(counted, problem.unknowns.searched, seed)
    return counted


def _reached(moduli_Pa: Array, target_Pa: float) -> int | None:
    """Return the number of evaluations after which the modulus stays within one per cent of a target, or None.

    `moduli_Pa` holds the best modulus after each evaluation.
    """
    far = np.flatnonzero(np.abs(moduli_Pa / target_Pa - 1) > _NEAR)
    first = int(far[-1]) + 1 if len(far) else 0
    return first + 1 if first < len(moduli_Pa) else None

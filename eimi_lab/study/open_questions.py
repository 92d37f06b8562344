"""Answer questions that Di Lecce et al. 2022 leave open: compressibility, magnetic moment, states and optimiser."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.outline import outline, points_on
from eimi_fitting.beam.specimen import Section
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.unknowns import NuisancePrior
from eimi_fitting.inference.identification.fit import Fit
from eimi_fitting.inference.identification.whole_fit import identify
from eimi_fitting.laws import LAWS
from eimi_lab.study.extent import TRAINED_ON, Extent
from eimi_lab.study.hidden_materials import HiddenMaterial
from eimi_lab.study.observed import NOISE_MM, experiment_of, noise_mm, outlines_mm, specimen_of
from eimi_lab.study.optimisers import evaluations_to_one_percent

Array = NDArray[np.float64]

_LAW = "neo-hookean"
PLAIN = HiddenMaterial("Neo-Hookean", LAWS[_LAW], 46e3, "dragon_skin_10", tested_to=1.0)
_FIELDS_MT = np.linspace(0.0, 7.05, 6)

BULK_OVER_SHEAR = (50.0, None, 10.0, 20.0, 200.0)  # None: incompressible; casting silicones are above 10
MOMENT_OFF = 0.05  # relative error of the moment; larger than the uncertainty of a remanence "N35 to N45"
NOISES_MM = {"0.01 px": NOISE_MM, "0.1 px": 10 * NOISE_MM, "1 px": 100 * NOISE_MM}  # at 25 px/mm
STATES = (2, 3, 6, 11, 16)


def compressibility(extent: Extent, seed: int) -> list[dict[str, Any]]:
    """Fit beams of a compressible material, and return the errors of the fitted shear modulus.

    Parameters
    ----------
    extent : Extent
        Number of computed cases.
    seed : int
        Seed of the searches.

    Returns
    -------
    list of dict
        A row of results for each ratio of bulk modulus to shear modulus.
    """
    specimen = specimen_of(TRAINED_ON)
    rows = []
    for ratio in BULK_OVER_SHEAR[: extent.cases]:
        bulk = None if ratio is None else ratio * PLAIN.modulus_Pa
        solid = outlines_mm(PLAIN, specimen, _FIELDS_MT, bulk)
        incompressible = _fit(solid, "solid", seed)
        flat = BeamModel(replace(specimen, section="plane-strain"), along=30)
        shapes = flat.solve(
            PLAIN.law,
            PLAIN.parameters,
            Loads.along(_FIELDS_MT),
            bulk_modulus_Pa=None if bulk is None else np.array([bulk]),
        )
        edges = points_on(outline(flat, shapes)[0], 2)[:, :, 4:-2]
        fixed, freed = _fit(edges, "plane-strain", seed), _fit(edges, "plane-strain", seed, free_bulk=True)
        assert freed.bulk_modulus
        rows.append(
            {
                "bulk_over_shear": ratio,
                "solid_percent": _off_percent(incompressible),
                "solid_error_um": 1e3 * incompressible.mean_error_mm,
                "plane_strain_percent": _off_percent(fixed),
                "freed_percent": _off_percent(freed),
                "freed_interval_percent": _interval_percent(freed),
                "bulk_over_shear_found": [
                    v / PLAIN.modulus_Pa for v in (freed.bulk_modulus.value, *freed.bulk_modulus.interval_95)
                ],
            }
        )
    return rows


def moment(extent: Extent, seed: int) -> list[dict[str, Any]]:
    """Fit beams with an error of the magnetic moment in the specimen file, and return the errors of the modulus."""
    # The torque on a rigid magnet depends only on the product of moment and field: a stronger field simulates a
    # stronger magnet.
    off, percent = 1 + MOMENT_OFF, f"{100 * MOMENT_OFF:g}"
    settings: tuple[tuple[str, float, float | None], ...] = (
        (
            f"magnet {percent} % stronger than given, moment fitted, prior standard deviation {percent} %",
            off,
            MOMENT_OFF,
        ),
        ("magnet as strong as given, given moment taken as exact", 1.0, None),
        (f"magnet {percent} % stronger than given, given moment taken as exact", off, None),
        (f"magnet {percent} % stronger than given, moment fitted, prior standard deviation 20 %", off, 0.2),
    )
    rows = []
    for words, factor, spread in settings[: extent.cases]:
        edges = outlines_mm(PLAIN, specimen_of(TRAINED_ON), factor * _FIELDS_MT)
        fit = _fit(edges, "solid", seed, free=() if spread is None else (NuisancePrior("moment", spread),))
        freed = fit.freed[0].deviation if fit.freed else None
        names = fit.identifiability.names
        rows.append(
            {
                "case": words,
                "percent": _off_percent(fit),
                "interval_percent": _interval_percent(fit),
                "error_um": 1e3 * fit.mean_error_mm,
                "moment_percent": None if freed is None else [100 * v for v in (freed.value, *freed.interval_95)],
                "correlation": fit.identifiability.correlation[0][len(names) - 1] if freed else None,
            }
        )
    return rows


def states_needed(extent: Extent, seed: int) -> list[dict[str, Any]]:
    """Compute how the 95 % interval of the modulus depends on the number of load steps."""
    rows = []
    for count in STATES[: extent.cases]:
        fields = np.linspace(0.0, _FIELDS_MT[-1], count)
        edges = outlines_mm(PLAIN, specimen_of(TRAINED_ON), fields)
        # Independent errors sigma of the edge points: the relative standard deviation of the modulus is sigma / s.
        sensitivity_mm = _sensitivity_mm(experiment_of(TRAINED_ON, edges, fields, "plane-stress"))
        fit = _fit(edges, "solid", seed, fields, NOISES_MM["0.1 px"])
        low, high = _interval_percent(fit)
        rows.append(
            {
                "states": count,
                "foretold_percent": {words: 100 * 1.96 * sigma / sensitivity_mm for words, sigma in NOISES_MM.items()},
                "fit_half_percent": 0.5 * (high - low),
                "fit_percent": _off_percent(fit),
            }
        )
    return rows


QUESTIONS: dict[str, Callable[[Extent, int], list[dict[str, Any]]]] = {
    "compressibility": compressibility,
    "moment": moment,
    "states": states_needed,
    "optimisers": evaluations_to_one_percent,
}


def _fit(
    edges: Array, section: Section, seed: int, fields: Array = _FIELDS_MT, sigma_mm: float = NOISE_MM, **options: Any
) -> Fit:
    noisy = edges + noise_mm(edges.shape, f"question, seed {seed}", sigma_mm)
    return identify(_LAW, [experiment_of(TRAINED_ON, noisy, fields, section)], seed=seed, possible_causes=(), **options)


def _sensitivity_mm(experiment: Experiment) -> float:
    """Return how far the edge points move (root of the sum of squares, mm) per relative change of the modulus."""
    step = 1e-3
    around = PLAIN.modulus_Pa * np.array([[1 - step], [1 + step]])
    shapes = experiment.model.solve(PLAIN.law, around, experiment.loads, tolerance_mm=1e-4)
    residuals = experiment.observed.misfit(experiment.model, shapes).residuals
    return float(np.linalg.norm(residuals[1] - residuals[0]) / (2 * step))


def _off_percent(fit: Fit) -> float:
    """Return the deviation of the identified modulus from the true modulus, in per cent."""
    return 100 * (fit.initial_shear_modulus.value / PLAIN.modulus_Pa - 1)


def _interval_percent(fit: Fit) -> tuple[float, float]:
    """Return the ends of the 95 % interval of the modulus as deviations from the true modulus, in per cent."""
    low, high = fit.initial_shear_modulus.interval_95
    return 100 * (low / PLAIN.modulus_Pa - 1), 100 * (high / PLAIN.modulus_Pa - 1)

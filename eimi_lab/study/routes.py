"""The routes to a law: by the bending of one specimen under a section, and by windows of a tensile curve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.identification import identify
from eimi_fitting.laws import LAWS, CannotFit, fit_tensile
from eimi_lab.fits.tensile_files import read_tensile
from eimi_lab.process.errors import InputError
from eimi_lab.study.extent import Extent

Array = NDArray[np.float64]

BENDING = "bending"


@dataclass(frozen=True)
class Route:
    """A law with its parameters (n,), in the law's own order and units, and the data that it is from.

    source: BENDING, or a tensile curve: ``own`` of the hidden material or ``published``; window: of the latter.
    """

    law: str
    values: tuple[float, ...]
    modulus_Pa: float
    source: str
    window: str = ""

    @property
    def name(self) -> str:
        """As tables have it: `bending`, `tension 20 %`, `published curve, full`."""
        if self.source == BENDING:
            return BENDING
        return f"{'tension' if self.source == 'own' else 'published curve,'} {self.window}"

    @staticmethod
    def of(stored: dict[str, Any]) -> Route:
        """From a stored part."""
        own = {name: stored[name] for name in ("law", "modulus_Pa", "source", "window")}
        return Route(values=tuple(stored["values"]), **own)


def by_bending(law: str, experiment: Experiment, seed: int) -> dict[str, Any]:
    """A law by EIMI: a `Route` and what the tables say of its search, ready to be stored."""
    fit = identify(law, [experiment], seed=seed)
    return {
        "law": law,
        "values": fit.values.tolist(),
        "modulus_Pa": fit.initial_shear_modulus.value,
        "source": BENDING,
        "window": "",
        "modulus_interval_Pa": list(fit.initial_shear_modulus.interval_95),
        "intervals": {name: list(quantity.interval_95) for name, quantity in fit.parameters.items()},
        "evaluations": fit.evaluations,
        "generations": len(fit.history),
        "unconverged": fit.discarded.unconverged,
        "unstable": fit.discarded.unstable,
        "mean_error_mm": fit.mean_error_mm,
        "mean_deviation_mm": fit.mean_deviation_mm,
        "max_stretch": fit.max_stretch,
        "not_fixed": list(fit.identifiability.not_fixed),
        "seconds": fit.wall_s,
    }


def by_tension(strain: Array, stress_Pa: Array, source: str, extent: Extent) -> list[dict[str, Any]]:
    """Every law by least squares on every window of a curve, ready to be stored; none where a window is too short."""
    found = []
    for percent in extent.windows_percent:
        for law in extent.laws:
            try:
                fit = fit_tensile(
                    LAWS[law], strain, stress_Pa, largest_strain=np.inf if percent is None else percent / 100
                )
            except CannotFit:
                continue
            found.append(
                {
                    "law": law,
                    "values": fit.parameters.tolist(),
                    "modulus_Pa": fit.initial_shear_modulus_Pa,
                    "source": source,
                    "window": "full" if percent is None else f"{percent:g} %",
                    "rmse_Pa": fit.rmse_Pa,
                    "stable_to": fit.stable_to,
                }
            )
    return found


def published_curves(folder: Path | None, materials: Sequence[str]) -> dict[str, Path]:
    """The tensile test of each material in a folder, by the material's key: a CSV named by its first word.

    Raises InputError where there is none of a material, or more than one.
    """
    if folder is None:
        return {}
    found = {}
    for key in materials:
        word = key.split("_")[0]
        files = sorted(file for file in folder.glob("*.csv") if file.name.lower().startswith(word))
        if len(files) != 1:
            raise InputError(
                f"--tensile-data {folder}: should hold one tensile test whose name begins with {word} and ends with "
                f".csv; holds {', '.join(file.name for file in files) or 'none'}"
            )
        read_tensile(files[0])  # what is wrong with it is said before anything is computed
        found[key] = files[0]
    return found

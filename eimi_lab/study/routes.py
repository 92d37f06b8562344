"""Identify laws in two ways: from the bending of one specimen, and from parts of a tensile curve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.identification.whole_fit import identify
from eimi_fitting.laws import LAWS, CannotFit, fit_tensile
from eimi_lab.fits.tensile_files import read_tensile
from eimi_lab.process.errors import InputError
from eimi_lab.study.extent import Extent

Array = NDArray[np.float64]

BENDING = "bending"


@dataclass(frozen=True)
class Route:
    """A law with identified parameters, and the kind of data from which they were identified.

    Attributes
    ----------
    law : str
        Name of the law.
    values : tuple of float
        Identified parameters.
    modulus_Pa : float
        Initial shear modulus.
    source : {"bending", "own", "published"}
        Bending, simulated tensile curve, or published tensile curve.
    window : str
        Largest strain of the tensile curve, such as `20 %` or `full`; empty for bending.
    """

    law: str
    values: tuple[float, ...]
    modulus_Pa: float
    source: str
    window: str = ""

    @property
    def name(self) -> str:
        """Return the name of the data, such as `bending`, or `tension 20 %` for a curve up to a strain of 20 %."""
        if self.source == BENDING:
            return BENDING
        return f"{'tension' if self.source == 'own' else 'published curve,'} {self.window}"

    @staticmethod
    def of(stored: dict[str, Any]) -> Route:
        """Create a Route from a dictionary that was stored as JSON."""
        return Route(stored["law"], tuple(stored["values"]), stored["modulus_Pa"], stored["source"], stored["window"])


def by_bending(law: str, experiment: Experiment, seed: int) -> dict[str, Any]:
    """Identify the parameters of a law from the bending of a specimen.

    Return a dictionary for JSON with the law, its parameters, evaluations, time (s) and errors of the fit.
    """
    fit = identify(law, [experiment], seed=seed, possible_causes=())
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
    """Fit each law to parts of a tensile curve (up to several largest strains) by least squares.

    Parameters
    ----------
    strain, stress_Pa : ndarray, shape (m,)
        Engineering strain, and engineering stress in Pa.
    source : {"own", "published"}
        Simulated or published curve.
    extent : Extent
        Laws and largest strains.

    Returns
    -------
    list of dict
        For each fit: law, parameters, error (Pa) and stability limit.
    """
    fits = []
    for percent in extent.windows_percent:
        for law in extent.laws:
            try:
                fit = fit_tensile(
                    LAWS[law], strain, stress_Pa, largest_strain=np.inf if percent is None else percent / 100
                )
            except CannotFit:
                continue
            fits.append(
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
    return fits


def published_curves(folder: Path | None, materials: Sequence[str]) -> dict[str, Path]:
    """Return the file with the tensile test of each material; empty without a folder.

    Raises
    ------
    InputError
        If a material has no file or several, or if a file cannot be read.
    """
    if folder is None:
        return {}
    curves = {}
    for key in materials:
        word = key.split("_")[0]
        files = sorted(file for file in folder.glob("*.csv") if file.name.lower().startswith(word))
        if len(files) != 1:
            raise InputError(
                f"--tensile-data {folder}: should hold one tensile test whose name begins with {word} and ends with "
                f".csv; holds {', '.join(file.name for file in files) or 'none'}"
            )
        read_tensile(files[0])  # an error in the file is reported before anything is computed
        curves[key] = files[0]
    return curves

"""Fit a law to a tensile test up to a largest strain, for `eimi tensile`."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from eimi_fitting.inference.doubts.checks import Doubt
from eimi_fitting.inference.evidence.quantity import Quantity
from eimi_fitting.inference.interval.draws import draw_parameters
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.stability import LARGEST_STRETCH_CHECKED
from eimi_fitting.laws.tensile import CannotFit, TensileFit, fit_tensile
from eimi_lab.fits.law_record import Stability
from eimi_lab.fits.records import package_versions
from eimi_lab.fits.tensile_files import TensileTest
from eimi_lab.fits.tensile_record import TensileRecord, TensileSource
from eimi_lab.process.errors import InputError

_MISFIT = 0.1  # ratio of the residuals to the stresses (root mean squares) from which the law is doubtful


def fit_window(test: TensileTest, model: str, window_percent: float | None, relative: bool = False) -> TensileRecord:
    """Fit a law to a tensile test up to a largest strain, by least squares.

    Parameters
    ----------
    test : TensileTest
        Tensile test.
    model : str
        Name of the law.
    window_percent : float or None
        Largest engineering strain in per cent; None for the whole curve.
    relative : bool
        Whether to divide each residual by the measured stress.

    Raises
    ------
    InputError
        If there are too few rows.
    """
    largest = np.inf if window_percent is None else window_percent / 100
    try:
        fit = fit_tensile(LAWS[model], test.strain, test.stress_Pa, largest_strain=largest, relative=relative)
    except CannotFit as error:
        window = "the whole curve" if window_percent is None else f"fit of the strains up to {window_percent:g} %"
        most = float(test.strain.max())
        unit = f"; the strains reach {100 * most:g} %: name a column in per cent strain_percent" if most > 1 else ""
        raise InputError(f"{test.path}: {window}: {error}{unit}") from error
    low, high = fit.initial_shear_modulus_interval_Pa
    used = test.stress_Pa[np.abs(test.strain) <= largest]
    return TensileRecord(
        model=model,
        parameters={
            name: Quantity(float(value), unit, (float(a), float(b)))
            for name, unit, value, (a, b) in zip(
                fit.law.parameter_names, fit.law.units, fit.parameters, fit.intervals, strict=True
            )
        },
        initial_shear_modulus=Quantity(fit.initial_shear_modulus_Pa, "Pa", (low, high)),
        max_stretch=fit.max_stretch,
        stability=Stability(
            criterion="Drucker",
            stable_up_to_stretch=fit.stable_to,
            checked_up_to_stretch=LARGEST_STRETCH_CHECKED,
        ),
        doubts=tuple(_doubts(fit, float(np.sqrt(np.mean(used**2))))),
        versions=package_versions(),
        window_percent=window_percent,
        residuals="relative" if relative else "absolute",
        rmse_Pa=fit.rmse_Pa,
        rows=fit.rows,
        rows_left_out=fit.rows_left_out,
        correlation_rows=fit.correlation_rows,
        correlation=tuple(tuple(map(float, row)) for row in fit.correlation),
        not_fixed=fit.not_fixed,
        draws=draw_parameters(
            fit.law.parameter_names,
            fit.parameters,
            fit.intervals,
            fit.correlation,
            fit.law.initial_shear_modulus,
        ),
        source=TensileSource(path=str(test.path), sha256=test.sha256, material=test.material),
    )


def _doubts(fit: TensileFit, stress_Pa: float) -> Iterator[Doubt]:
    """Yield reasons to distrust a tensile fit; `stress_Pa` is the root mean square of the measured stresses."""
    if fit.rows_left_out:
        yield Doubt(f"{fit.rows_left_out} rows without a positive stress were left out", kind="rows_left_out")
    if fit.rmse_Pa > _MISFIT * stress_Pa:
        percent = 100 * fit.rmse_Pa / stress_Pa
        yield Doubt(
            f"the residuals are {percent:.0f} % of the stress (root mean square): the law cannot follow the shape of "
            "the curve",
            kind="curve_shape",
        )
    if fit.initial_shear_modulus_interval_Pa[0] <= 0:
        yield Doubt(
            "the interval of the initial shear modulus reaches zero: this curve does not determine the law at small "
            "strains",
            kind="modulus_open",
        )
    if fit.stable_to is not None and fit.stable_to < fit.max_stretch:
        yield Doubt(
            f"the law is not Drucker-stable beyond a stretch of {fit.stable_to:.2f}, but the curve extends to "
            f"{fit.max_stretch:.2f}: a simulation may fail there",
            kind="unstable",
        )

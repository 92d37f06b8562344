"""Fits to random samples of the states (bootstrap replicates), as a result file contains them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from eimi_fitting.inference.identification.fit import Fit
from eimi_lab.fits.law_record import Record


class ReplicateRecord(Record):
    """A law fitted to one bootstrap replicate: states drawn at random, with replacement, from the measured states."""

    replicate: int
    parameters: dict[str, float]
    initial_shear_modulus_Pa: float
    mean_error_mm: float
    evaluations: int
    stop: str
    wall_s: float

    @staticmethod
    def of(fit: Fit, replicate: int) -> ReplicateRecord:
        """Return the record of a fit to the bootstrap replicate with this number."""
        return ReplicateRecord(
            replicate=replicate,
            parameters={name: quantity.value for name, quantity in fit.parameters.items()},
            initial_shear_modulus_Pa=fit.initial_shear_modulus.value,
            mean_error_mm=fit.mean_error_mm,
            evaluations=fit.evaluations,
            stop=fit.stop,
            wall_s=fit.wall_s,
        )


FEWEST_FOR_INTERVAL = 40  # replicates: one beyond each end of a 95 % interval


class BootstrapRecord(Record):
    """Fits to bootstrap replicates: states drawn at random, with replacement, from the measured states.

    `initial_shear_modulus_interval_95_Pa` holds the 2.5 % and 97.5 % percentiles of the initial shear modulus (Efron
    and Tibshirani 1993, An Introduction to the Bootstrap, section 13.3); null with fewer than 40 replicates.
    """

    drawn: Literal["states"] = "states"
    initial_shear_modulus_interval_95_Pa: tuple[float, float] | None
    replicates: tuple[ReplicateRecord, ...]

    @staticmethod
    def of(replicates: Sequence[ReplicateRecord]) -> BootstrapRecord:
        """Return the record of all bootstrap replicates, with the 95 % interval of the initial shear modulus."""
        moduli = [replicate.initial_shear_modulus_Pa for replicate in replicates]
        enough = len(moduli) >= FEWEST_FOR_INTERVAL
        low, high = np.quantile(moduli, [0.025, 0.975]) if enough else (0.0, 0.0)
        return BootstrapRecord(
            initial_shear_modulus_interval_95_Pa=(float(low), float(high)) if enough else None,
            replicates=tuple(replicates),
        )

"""The fit of a viscoelastic law takes the uncertainty of the magnetic loads into account."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pytest

from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.inference.evidence.sources import StatedSource
from eimi_fitting.laws.prony import Prony
from eimi_fitting.time.law_of_time import FREE_LOAD, Problem, optimum_of, relative_load_sigmas
from eimi_fitting.time.terms import Terms
from eimi_lab.config.specimen import load_specimen

MODULUS_PA = 50e3


@pytest.fixture(scope="module")
def specimen() -> Specimen:
    return load_specimen("type1").mechanics()


def stated(**sigmas: float) -> list[StatedSource]:
    return [StatedSource(key.replace("_", "-"), sigma, "specimen") for key, sigma in sigmas.items()]


def test_given_uncertainties_of_the_moment_and_the_coil_are_relative(specimen: Specimen) -> None:
    assert specimen.magnet is not None
    remanence_T = specimen.magnet.remanence_T
    sigmas = relative_load_sigmas(stated(remanence=0.02 * remanence_T, coil=0.01, width=0.05), specimen)
    assert sigmas == pytest.approx({"remanence": 0.02, "coil": 0.01})
    assert relative_load_sigmas(stated(moment=0.03), specimen) == {"moment": 0.03}


def test_an_exact_moment_has_no_uncertainty_and_an_unknown_moment_is_free(specimen: Specimen) -> None:
    assert relative_load_sigmas(stated(remanence=0.0), specimen) == {}
    assert relative_load_sigmas(stated(coil=0.01), specimen) is None
    assert relative_load_sigmas(stated(remanence=0.01), replace(specimen, magnet=None)) is None


@dataclass(frozen=True)
class Normal:
    # Replaces real data: a measurement of ln(modulus / MODULUS_PA) that also depends on the loads.
    # of_load : derivative of the measured value with respect to ln(factor of the loads)
    # mean, sigma : measured value and its standard deviation

    of_load: float
    mean: float
    sigma: float

    def residuals(self, instantaneous_Pa: np.ndarray, series: Prony, load_log: np.ndarray) -> np.ndarray:
        value = np.log(instantaneous_Pa / MODULUS_PA) + self.of_load * load_log
        return np.asarray((value - self.mean) / self.sigma)[:, None]

    def effects(self, sources: Mapping[str, float]) -> dict[str, np.ndarray]:
        return {key: np.zeros((1, 1)) for key in sources}


def test_the_prior_and_the_data_share_the_moment_by_their_variances() -> None:
    # A ring-down gives the modulus to 1 %. Static states give modulus over moment almost exactly, 10 % too large.
    evidence = (Normal(0.0, 0.0, 0.01), Normal(-1.0, 0.1, 1e-4))
    problem = Problem(Terms(1, (0.01, 30.0), MODULUS_PA, True), evidence, 0.01)
    optimum = optimum_of(problem)
    assert optimum.unknowns[-1] == pytest.approx(-0.05, rel=0.01)
    # If the stated moment moves by 1 %, the optimum follows by the share of the prior in the information.
    assert optimum.load_step(0.01)[-1] == pytest.approx(0.005, rel=0.01)
    free = optimum.with_free_load()
    assert free.unknowns[-1] == pytest.approx(-0.1, rel=0.01)
    assert np.sqrt(free.covariance[-1, -1]) == pytest.approx(0.01, rel=0.01)
    assert free.problem.load_sigma == FREE_LOAD

"""Normal priors on the parameters of a hyperelastic law."""

# A prior with the mean m and the standard deviation s adds the residual (p - m) / s of the parameter p to a fit (Theil
# and Goldberger 1961, Int. Econ. Rev. 2:65).

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.laws.law import Law
from eimi_fitting.suggestion import suggestion

Array = NDArray[np.float64]

# Every law has this modulus besides its parameters.
INITIAL_SHEAR_MODULUS = "initial_shear_modulus"


# A prior cannot correct the error of an input, such as a wrong width, if the input keeps its specified value in the
# fit. An input whose error may have a larger effect than the noise should therefore be fitted together with the law.
@dataclass(frozen=True)
class Prior:
    """A normal prior on one parameter of a hyperelastic law.

    Parameters
    ----------
    parameter : str
        A parameter of the law, such as ``"C10"``, or ``"initial_shear_modulus"``, which every law has.
    mean : float
        Expected value of the parameter, in its unit: Pa for a modulus, 1 for an exponent.
    standard_deviation : float
        Standard deviation of the prior, in the same unit; above 0.

    Raises
    ------
    ValueError
        For a mean that is not finite, and for a standard deviation that is not above 0.

    Examples
    --------
    >>> Prior("C10", 20e3, 500.0)
    Prior(parameter='C10', mean=20000.0, standard_deviation=500.0)
    >>> Prior("C10", 20e3, 0.0)
    Traceback (most recent call last):
    ValueError: prior on C10: a standard deviation of 0 should be a number above 0
    """

    parameter: str
    mean: float
    standard_deviation: float

    def __post_init__(self) -> None:
        if not math.isfinite(self.mean):
            raise ValueError(f"prior on {self.parameter}: a mean of {self.mean:g} should be a finite number")
        if not 0 < self.standard_deviation < math.inf:
            raise ValueError(
                f"prior on {self.parameter}: a standard deviation of {self.standard_deviation:g} should be a number "
                "above 0"
            )

    def standardised(self, law: Law, parameters: Array) -> Array:
        """Return the difference of the parameter from the mean of the prior, in standard deviations."""
        if self.parameter == INITIAL_SHEAR_MODULUS:
            values = law.initial_shear_modulus(parameters)
        else:
            values = parameters[:, law.parameter_names.index(self.parameter)]
        return np.asarray((values - self.mean) / self.standard_deviation)

    def unit(self, law: Law) -> str:
        """Return the unit of the parameter: "Pa", or "1" for a parameter without a unit."""
        if self.parameter == INITIAL_SHEAR_MODULUS:
            return "Pa"
        return law.units[law.parameter_names.index(self.parameter)]

    def in_words(self, law: Law) -> str:
        """Return mean and standard deviation with their unit, such as "46000 ± 500 Pa"."""
        unit = "" if self.unit(law) == "1" else f" {self.unit(law)}"
        return f"{self.mean:.5g} ± {self.standard_deviation:.3g}{unit}"


def check_priors(priors: Sequence[Prior], law: Law) -> None:
    """Raise ValueError for a prior on an unknown parameter, or for two priors on one parameter."""
    names = (*law.parameter_names, INITIAL_SHEAR_MODULUS)
    for index, prior in enumerate(priors):
        if prior.parameter not in names:
            raise ValueError(f"{law.name} has no parameter {prior.parameter!r}; {suggestion(prior.parameter, names)}")
        if any(prior.parameter == other.parameter for other in priors[:index]):
            raise ValueError(f"two priors on {prior.parameter}: give only one")

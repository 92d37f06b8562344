"""Convert moduli between Pa (in files and messages) and MPa = N/mm² (in elements and in most material cards)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

MPA_PER_PA = 1e-6
PA_PER_MPA = 1e6


def moduli_in_MPa(parameters: NDArray[np.float64], units: Sequence[str]) -> NDArray[np.float64]:
    """Convert the moduli among the parameters of a hyperelastic law from Pa to MPa.

    Parameters
    ----------
    parameters : array, shape (..., n)
        The n parameters of the law along the last axis, with moduli in Pa.
    units : sequence of str, length n
        Unit of each parameter: ``"Pa"``, or ``"1"`` for a number such as an exponent, which stays unchanged.

    Returns
    -------
    array, shape (..., n)
        The parameters of the law, with moduli in MPa.
    """
    return np.asarray(parameters * np.array([MPA_PER_PA if unit == "Pa" else 1.0 for unit in units]))


def in_words(modulus_Pa: float, interval_Pa: tuple[float, float], digits: int = 5) -> str:
    """Return a modulus and its interval as text, such as ``"46380 Pa [46359, 46401]"``.

    Parameters
    ----------
    modulus_Pa : float
        The modulus in Pa.
    interval_Pa : (float, float)
        Lower and upper end of the interval of the modulus, in Pa.
    digits : int
        Significant digits of the modulus. All digits before the decimal point are always printed.

    Examples
    --------
    >>> in_words(46380.2, (46359.1, 46401.3))
    '46380 Pa [46359, 46401]'
    >>> in_words(100.31, (99.2, 101.4))
    '100.31 Pa [99.20, 101.40]'
    >>> in_words(34.67e9, (34.6e9, 34.7e9))
    '34.670 GPa [34.600, 34.700]'
    """
    # All three numbers have the same unit and the same number of decimals. The unit is Pa for a modulus below 10 MPa,
    # MPa from 10 MPa to 1 GPa, and GPa above 1 GPa.
    size = abs(modulus_Pa)
    factor, unit = (1e-9, "GPa") if size >= 1e9 else (1e-6, "MPa") if size >= 1e7 else (1.0, "Pa")
    leading = math.floor(math.log10(factor * size)) if size > 0 else 0
    places = min(max(digits - 1 - leading, 0), digits)
    value, low, high = (f"{factor * x:.{places}f}" for x in (modulus_Pa, *interval_Pa))
    return f"{value} {unit} [{low}, {high}]"

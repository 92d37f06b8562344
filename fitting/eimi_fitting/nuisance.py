"""Quantities beside the law that are known only so well: magnetic moment, coil constant, roll of the camera, clamp.

Each is left at what the specimen and the calibration say, or freed with a normal prior about it: its standard deviation
enters the fit as one more observation (Theil and Goldberger 1961, Int. Econ. Rev. 2:65).

moment    the magnet's moment, relative; one for each dataset
coil      the coil constant, relative; common to all datasets
roll      the camera's roll about the middle of the clamp, degrees, counter-clockwise in the beam frame; each dataset
clamp     the place of the clamp, mm, x and y of the beam frame; each dataset
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Kind = Literal["moment", "coil", "roll", "clamp"]
Part = Literal["moment", "coil", "roll", "clamp x", "clamp y"]

UNITS: dict[Kind, str] = {"moment": "1", "coil": "1", "roll": "deg", "clamp": "mm"}
# Standard deviations above which nothing is known: the field may have either sign, x and y may be swapped, the clamp
# may be anywhere on the beam. Such a number is a slip, of percent for a share or of degrees for radians.
LARGEST: dict[Kind, float] = {"moment": 0.5, "coil": 0.5, "roll": 45.0, "clamp": 10.0}
RANGE = 6.0  # standard deviations either way that a unit coordinate spans


@dataclass(frozen=True)
class Prior:
    """A kind of nuisance that is freed, and the standard deviation of what is known of it, in UNITS."""

    kind: Kind
    spread: float

    def __post_init__(self) -> None:
        if self.kind not in get_args(Kind):
            raise ValueError(f"{self.kind}: should be one of {', '.join(get_args(Kind))}")
        largest = LARGEST[self.kind]
        if not 0 < self.spread <= largest:
            raise ValueError(f"{self.kind}: a standard deviation of {self.spread:g} should be in 0..{largest:g}")


@dataclass(frozen=True)
class Nuisance:
    """One unknown number: ``dataset`` counts from 0 and is None where it is common to all; its value is a deviation."""

    name: str
    part: Part
    dataset: int | None
    unit: str
    spread: float

    def value(self, unit_coordinate: Array) -> Array:
        """From 0..1 to the deviation from what was stated."""
        return 2 * RANGE * self.spread * (unit_coordinate - 0.5)


@dataclass(frozen=True)
class Setting:
    """What P candidates assume of one dataset: field_factor (P,), roll_deg (P,), clamp_mm (P, 2)."""

    field_factor: Array
    roll_deg: Array
    clamp_mm: Array

    @staticmethod
    def of(deviations: Iterable[tuple[Part, Array | float]], candidates: int) -> Setting:
        """What deviations (P,) from what was stated mean, or numbers for all P candidates."""
        factor, roll, clamp = np.ones(candidates), np.zeros(candidates), np.zeros((candidates, 2))
        for part, value in deviations:
            if part in ("moment", "coil"):
                factor *= 1 + value
            elif part == "roll":
                roll += value
            else:
                clamp[:, 0 if part == "clamp x" else 1] += value
        return Setting(factor, roll, clamp)

    def corrected(self, points_mm: Array) -> Array:
        """Measured points (..., 2) as they lie once clamp and roll of each candidate are taken out: (P, ..., 2)."""
        lead = (len(self.roll_deg),) + (1,) * (points_mm.ndim - 1)
        moved = points_mm - self.clamp_mm.reshape(*lead, 2)
        angle = np.radians(self.roll_deg).reshape(lead)
        c, s = np.cos(angle), np.sin(angle)
        x, y = moved[..., 0], moved[..., 1]
        return np.stack([c * x + s * y, c * y - s * x], axis=-1)


def nuisances(priors: Sequence[Prior], datasets: int) -> tuple[Nuisance, ...]:
    """The unknown numbers that the priors stand for."""
    found: list[Nuisance] = []
    for prior in priors:
        unit = UNITS[prior.kind]
        if prior.kind == "coil":
            found.append(Nuisance("coil constant", "coil", None, unit, prior.spread))
            continue
        for dataset in range(datasets):
            where = f" of dataset {dataset}" if datasets > 1 else ""
            if prior.kind == "moment":
                found.append(Nuisance(f"moment{where}", "moment", dataset, unit, prior.spread))
            elif prior.kind == "roll":
                found.append(Nuisance(f"roll{where}", "roll", dataset, unit, prior.spread))
            else:
                found.append(Nuisance(f"clamp x{where}", "clamp x", dataset, unit, prior.spread))
                found.append(Nuisance(f"clamp y{where}", "clamp y", dataset, unit, prior.spread))
    return tuple(found)


def settings(freed: Sequence[Nuisance], unit: Array, datasets: int) -> list[Setting]:
    """What unit coordinates (P, m) of the freed nuisances mean for each dataset."""
    values = [(nuisance, nuisance.value(unit[:, column])) for column, nuisance in enumerate(freed)]
    return [
        Setting.of(((n.part, value) for n, value in values if n.dataset in (None, dataset)), len(unit))
        for dataset in range(datasets)
    ]

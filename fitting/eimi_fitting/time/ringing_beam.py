"""A beam with the loads that act during a free vibration, and its undamped frequencies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.solid_model import SolidModel
from eimi_fitting.beam.specimen import STANDARD_GRAVITY, Specimen
from eimi_fitting.beam.vibration import Vibration
from eimi_fitting.inference.evidence.sources import SOURCES, loads_under, specimen_under
from eimi_fitting.laws.law import Law

Array = NDArray[np.float64]

_STIFF_PA, _SOFTEST_PA = 1e6, 100.0
_TRIES = 15
_SAME_FREQUENCY = 1e-5


class NoEquilibrium(Exception):
    """The specimen has no stable equilibrium with a given modulus, or no modulus gives the measured frequency."""


@dataclass(frozen=True)
class RingingBeam:
    """A beam with the loads that act during a free vibration."""

    # The beam, with its magnet if it has one.
    specimen: Specimen
    # The loads in one state.
    loads: Loads
    # The hyperelastic law.
    law: Law
    # (n,): the n parameters of the law for an initial shear modulus of 1 Pa.
    shape: Array
    # Weight that hangs at the tip. Its force is part of ``loads``. Its mass moves with the tip along gravity only.
    hanging_N: float = 0.0

    @property
    def section(self) -> str:
        """The section of the specimen: solid, plane stress or plane strain."""
        return self.specimen.section

    def vibration(self, model: BeamModel | SolidModel) -> Vibration:
        """Return the small vibrations of a beam model about equilibrium, with the mass that hangs at the tip."""
        gravity = self.loads.gravity[0]
        size = float(np.linalg.norm(gravity))
        return Vibration(model, self.hanging_N / STANDARD_GRAVITY, gravity / size if self.hanging_N and size else None)

    def planar(self) -> BeamModel:
        """Return the planar finite-element model of the beam."""
        return BeamModel(self.specimen, plane=self.specimen.planar_section)

    def parameters(self, modulus_Pa: Array) -> Array:
        """Return the parameters of the law for each of several initial shear moduli in Pa."""
        is_modulus = np.array([unit == "Pa" for unit in self.law.units])
        return np.where(is_modulus, np.asarray(modulus_Pa)[:, None] * self.shape, self.shape)

    def undamped_Hz(self, modulus_Pa: float, count: int = 3) -> Array:
        """Return the lowest undamped frequencies of the beam for a shear modulus.

        Raises
        ------
        NoEquilibrium
            The beam has no stable equilibrium.
        """
        motion, _ = self.vibration(self.planar()).about(self.law, self.parameters(np.array([modulus_Pa])), self.loads)
        if not motion.sound.all():
            raise NoEquilibrium(f"the specimen has no stable equilibrium at a shear modulus of {modulus_Pa:.3g} Pa")
        return np.asarray(motion.frequencies_Hz(count)[0])

    def under(self, deviations: Mapping[str, Array]) -> RingingBeam:
        """Return the beam with changed inputs, such as another width."""
        # ``deviations``: the changes of the inputs, by their names.
        return replace(
            self, specimen=specimen_under(self.specimen, deviations), loads=loads_under(self.loads, deviations)
        )

    def changed_by(self, key: str, sigma: float) -> tuple[RingingBeam, ...]:
        """Return the beam with an input changed by its uncertainty, once for each component of the input."""
        # ``key``, ``sigma``: the input, and its standard uncertainty. Empty if the input does not change the beam.
        source = SOURCES[key]
        if sigma and (source.specimen or source.loads):
            return tuple(self.under({key: deviation}) for deviation in sigma * np.eye(len(source.parts)))
        if sigma and source.field and self.loads.field_T.any():
            return (replace(self, loads=replace(self.loads, field_T=self.loads.field_T * (1 + sigma))),)
        return ()

    def modulus_at(self, frequency_Hz: float) -> float:
        """Find the shear modulus (Pa) for which the beam has a given lowest undamped frequency.

        Raises
        ------
        NoEquilibrium
            No modulus gives this frequency.
        """
        vibration, target = self.vibration(self.planar()), np.log(frequency_Hz)
        # The search starts at a stiff beam and stays at moduli above the solution: without loads f² is proportional to
        # mu, and with loads f² rises less. Below the solution the beam may have no equilibrium.
        solved: list[tuple[float, float]] = []
        log_modulus = float(np.log(_STIFF_PA))
        for _ in range(_TRIES):
            motion, _ = vibration.about(self.law, self.parameters(np.exp([log_modulus])), self.loads)
            if not motion.sound[0]:
                break
            log_frequency = float(np.log(motion.frequencies_Hz(1)[0, 0]))
            solved.append((log_frequency, log_modulus))
            if abs(log_frequency - target) < _SAME_FREQUENCY:
                return float(np.exp(log_modulus))
            slope = 2.0
            if len(solved) > 1 and solved[-1][0] != solved[-2][0]:
                slope = float(np.clip((solved[-1][1] - solved[-2][1]) / (solved[-1][0] - solved[-2][0]), 1.0, 20.0))
            log_modulus += slope * (target - log_frequency)
            if not _SOFTEST_PA < np.exp(log_modulus) < 1e3 * _STIFF_PA:
                break
        raise NoEquilibrium(
            f"no shear modulus gives the beam a frequency of {frequency_Hz:.4g} Hz: check the dimensions and weights "
            "of the beam, the direction of gravity and the frame rate"
        )

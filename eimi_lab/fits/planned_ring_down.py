"""The expected interval of the modulus with and without a ring-down (free vibration) in a planned run.

Let s and d be the logarithms of the modulus from the static states and from the ring-down. To first order,

    s = x + a · δ + n_s,    d = x + r + b · δ + n_d,

where x is the true value, δ holds the errors of the inputs in standard uncertainties, a and b are the changes for a
unit error, r is the error of the correction from the dynamic to the static modulus, and n_s and n_d are noise. The best
linear estimate of x has the variance 1 / (1ᵀ C⁻¹ 1), with the covariance matrix C of s and d (Gauss-Markov theorem).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.inference.evidence.quantity import NORMAL_95
from eimi_fitting.inference.evidence.sources import SOURCES, StatedSource
from eimi_fitting.inference.planning.design_of_experiment import KnownLaw
from eimi_fitting.time.ringing_beam import NoEquilibrium, RingingBeam
from eimi_fitting.time.small_effects import small_effects

Array = NDArray[np.float64]

FREQUENCY_SHARE = 5e-4
"""Assumed relative standard uncertainty of the measured frequency of a ring-down, including the error of the mesh."""
RELAXATION_SHARE = 0.01
"""Assumed relative standard uncertainty of the relaxation of the modulus between a ring-down and the static states."""
_LOSS = 0.1  # assumed loss factor, for the effect of the air on the loss; this factor does not change the modulus
_STEP = 1.05
_MAGNETIC = ("moment", "coil", "remanence")  # sources that only multiply the magnetic load


@dataclass(frozen=True)
class ExpectedRingDown:
    """Expected half-widths of the 95 % intervals for a run that ends with a ring-down (free vibration) in zero field.

    After the ring-down the creep of the beam is also measured.

    Attributes
    ----------
    frequency_Hz : float
        Expected frequency of the ring-down.
    dynamic_percent : float
        Half-width for the modulus from the ring-down alone.
    without_percent, with_percent : float
        Half-widths for the static modulus, without and with the data of ring-down and creep.
    moment_share_percent : float
        Part of ``without_percent`` that is due to the uncertainty of magnetic moment times field.
    moment_percent : float or None
        The corresponding part of ``with_percent``.
    """

    frequency_Hz: float
    dynamic_percent: float
    without_percent: float
    with_percent: float
    moment_share_percent: float
    moment_percent: float | None

    @property
    def in_words(self) -> str:
        """Return a sentence with the expected intervals of the modulus, with and without a ring-down."""
        moment = ""
        if self.moment_percent is not None:
            moment = (
                f"; the part of this interval that the moment and the field cause would shrink from "
                f"± {self.moment_share_percent:.3g} % to ± {self.moment_percent:.3g} % of the modulus"
            )
        return (
            f"with a ring-down in zero field, at about {self.frequency_Hz:.3g} Hz, and creep: "
            f"± {self.with_percent:.3g} % instead of ± {self.without_percent:.3g} %{moment}; "
            f"the ring-down alone determines the dynamic modulus to ± {self.dynamic_percent:.3g} %"
        )


def expected_ring_down(
    known: KnownLaw,
    specimen: Specimen,
    gravity_angle_deg: float | None,
    tip_weight_N: float,
    stated: Sequence[StatedSource],
    static_percent: float,
    effects: Mapping[str, float],
) -> ExpectedRingDown | None:
    """Return the expected intervals of the modulus if a ring-down (free vibration) is added to a run.

    Parameters
    ----------
    known : KnownLaw
        Law and parameters of an earlier fit.
    specimen : Specimen
        Beam and magnet.
    gravity_angle_deg : float or None
        Angle of gravity in the beam frame; None without gravity.
    tip_weight_N : float
        Weight at the tip.
    stated : sequence of StatedSource
        Uncertain inputs with their standard uncertainties.
    static_percent : float
        Expected half-width (%) of the 95 % interval from the static states alone.
    effects : mapping of str to float
        By name of an uncertain input: change of the static modulus (%) for one standard uncertainty.

    Returns
    -------
    ExpectedRingDown or None
        None if the beam has no equilibrium without the field.
    """
    law, parameters = known.law, np.asarray(known.parameters, float)
    modulus = float(law.initial_shear_modulus(parameters))
    is_modulus = np.array([unit == "Pa" for unit in law.units])
    loads = Loads.along(np.zeros(1), gravity_angle_deg=gravity_angle_deg, tip_force_N=tip_weight_N)
    beam = RingingBeam(specimen, loads, law, np.where(is_modulus, parameters / modulus, parameters), tip_weight_N)
    try:
        frequency_Hz = float(beam.undamped_Hz(modulus)[0])
        gain = float(np.log(_STEP) / np.log(beam.undamped_Hz(_STEP * modulus)[0] / frequency_Hz))
        dynamic = _effects_percent(beam, modulus, frequency_Hz, gain, stated)
    except (NoEquilibrium, ValueError):
        return None
    small = small_effects(specimen, loads, frequency_Hz, _LOSS, gain, None)
    noise = float(np.hypot(100 * gain * FREQUENCY_SHARE, np.sqrt(sum(one.modulus_percent**2 for one in small))))
    names = sorted({*effects, *dynamic})
    a, b = (np.array([given.get(name, 0.0) for name in names]) for given in (effects, dynamic))
    rest = max((static_percent / NORMAL_95) ** 2 - float(a @ a), 0.0)
    relaxation = 100 * RELAXATION_SHARE
    covariance = np.array([[a @ a + rest, a @ b], [a @ b, b @ b + noise**2 + relaxation**2]])
    joined = 1.0 / np.linalg.inv(covariance).sum() if np.linalg.det(covariance) > 0 else covariance.min()
    magnetic = np.isin(names, [part for source in _MAGNETIC for part in SOURCES[source].parts])
    share = float(np.linalg.norm(a[magnetic]))
    others = np.where(magnetic, 0.0, a)
    difference = ((others - b) ** 2).sum() + rest + noise**2 + relaxation**2
    moment = np.sqrt(1.0 / (1.0 / share**2 + 1.0 / difference)) if share else None
    return ExpectedRingDown(
        frequency_Hz,
        NORMAL_95 * float(np.sqrt(b @ b + noise**2)),
        static_percent,
        NORMAL_95 * float(np.sqrt(joined)),
        NORMAL_95 * share,
        None if moment is None else NORMAL_95 * float(moment),
    )


def _effects_percent(
    beam: RingingBeam, modulus: float, frequency_Hz: float, gain: float, stated: Sequence[StatedSource]
) -> dict[str, float]:
    """Return, by name of an uncertain input, the change of the modulus (%) for one standard uncertainty.

    `modulus` is in Pa; `gain` is the relative change of the modulus for a relative change of the frequency.
    """
    effects: dict[str, float] = {}
    for one in stated:
        source = SOURCES[one.source]
        if not one.standard_uncertainty or not (source.specimen or source.loads):
            continue
        for part, name in enumerate(source.parts):
            deviation = np.zeros(len(source.parts))
            deviation[part] = one.standard_uncertainty
            changed_Hz = float(beam.under({one.source: deviation}).undamped_Hz(modulus)[0])
            effects[name] = 100 * gain * float(np.log(changed_Hz / frequency_Hz))
    return effects

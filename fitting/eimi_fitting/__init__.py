"""Identify hyperelastic laws from the bending of soft beams: laws, finite elements and inference.

laws          hyperelastic laws: energy, stability, tensile fits, material cards
beam          finite-element models that compute the bent shape of a specimen from its loads
inference     the fit of a law to measured edges, with its uncertainty
time          the fit of a viscoelastic (Prony) law to ring-downs (free vibrations), creep and static states
discovery     the choice of the terms of a strain energy function
units         conversion between Pa and MPa
correlation   the number of correlated residuals that count as one independent residual
randomness    tests of residuals for randomness along an edge
suggestion    the existing name that is nearest to a misspelt name

The names in ``__all__`` are public. Each name is loaded when it is first used. This package reads no files and knows
no instruments, and its only imports are numpy, scipy and cma.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from eimi_fitting.beam.bending import Beam as Beam
    from eimi_fitting.beam.loads import Loads as Loads
    from eimi_fitting.beam.model import BeamModel as BeamModel
    from eimi_fitting.beam.specimen import Magnet as Magnet
    from eimi_fitting.beam.specimen import Specimen as Specimen
    from eimi_fitting.inference.evidence.experiment import Experiment as Experiment
    from eimi_fitting.inference.evidence.measurements import EdgeObservation as EdgeObservation
    from eimi_fitting.inference.evidence.measurements import PointObservation as PointObservation
    from eimi_fitting.inference.evidence.parameter_priors import Prior as Prior
    from eimi_fitting.inference.evidence.quantity import Quantity as Quantity
    from eimi_fitting.inference.evidence.tensile_curves import TensileCurve as TensileCurve
    from eimi_fitting.inference.evidence.unknowns import NuisancePrior as NuisancePrior
    from eimi_fitting.inference.identification.fit import Fit as Fit
    from eimi_fitting.inference.identification.whole_fit import identify as identify
    from eimi_fitting.inference.planning.sensitivity import edge_sensitivity as edge_sensitivity
    from eimi_fitting.laws import LAWS as LAWS
    from eimi_fitting.laws.cards import Material as Material
    from eimi_fitting.laws.cards import material_card as material_card
    from eimi_fitting.laws.tensile import fit_tensile as fit_tensile

_HOMES = {
    "LAWS": "laws",
    "Beam": "beam.bending",
    "BeamModel": "beam.model",
    "EdgeObservation": "inference.evidence.measurements",
    "Experiment": "inference.evidence.experiment",
    "Fit": "inference.identification.fit",
    "Loads": "beam.loads",
    "Magnet": "beam.specimen",
    "Material": "laws.cards",
    "NuisancePrior": "inference.evidence.unknowns",
    "PointObservation": "inference.evidence.measurements",
    "Prior": "inference.evidence.parameter_priors",
    "Quantity": "inference.evidence.quantity",
    "Specimen": "beam.specimen",
    "TensileCurve": "inference.evidence.tensile_curves",
    "edge_sensitivity": "inference.planning.sensitivity",
    "fit_tensile": "laws.tensile",
    "identify": "inference.identification.whole_fit",
    "material_card": "laws.cards",
}

__all__ = sorted(_HOMES)


if not TYPE_CHECKING:  # type checkers then accept the names above only

    def __getattr__(name: str) -> Any:
        """Import a public name from its module when it is first used (PEP 562)."""
        if name not in _HOMES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})

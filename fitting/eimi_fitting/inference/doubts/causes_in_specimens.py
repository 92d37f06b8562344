"""List the systematic errors of the specimen: a wrong shape, twist, clamping or law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.rest_modes import WAIST, with_modes
from eimi_fitting.inference.doubts.possible_causes import BOTH_POLARITIES, Assumed, PossibleCause, by_sources, of_source
from eimi_fitting.inference.doubts.twisted_picture import without_twist
from eimi_fitting.inference.evidence.sources import SOURCES
from eimi_fitting.laws.sum_of_terms import SumOfTerms

Array = NDArray[np.float64]


def _tapered(assumed: Assumed, amplitudes: Array) -> Assumed:
    # The amplitudes in mm: the change of the width from the clamp to the end of the flexible part, and the width at
    # both ends minus the width in the middle.
    assumed = by_sources({("taper", 0): 1.0})(assumed, amplitudes[:1])
    if not amplitudes[1]:
        return assumed
    model = assumed.experiment.model
    waisted = with_modes(model.specimen, (), (0.0, float(amplitudes[1]) / WAIST))
    return replace(assumed, experiment=replace(assumed.experiment, model=model.of(waisted)))


def _untwisted(assumed: Assumed, amplitudes: Array) -> Assumed:
    # The amplitude is the angle between the magnetic moment and the plane of the picture.
    law, parameters, angle_deg = assumed.law, assumed.parameters, float(amplitudes[0])
    experiment = without_twist(assumed.experiment, assumed.with_errors, law, parameters, angle_deg)
    return replace(assumed, experiment=experiment)


# For some laws, the names of the terms, and for each term its coefficient divided by the parameter of the law.
_AS_TERMS: dict[str, tuple[tuple[str, ...], tuple[float, ...]]] = {
    "neo-hookean": (("i1",), (1.0,)),
    "mooney-rivlin": (("i1", "i2"), (2.0, 2.0)),
    "yeoh": (("i1", "i1^2", "i1^3"), (2.0, 1.0, 1.0)),
}


def _with_terms(assumed: Assumed, amplitudes: Array) -> Assumed:
    # Adds terms in (I1 - 3)^2 and I2 - 3 to the strain energy.
    if assumed.law.name not in _AS_TERMS or not amplitudes.any():
        return assumed
    terms, factors = _AS_TERMS[assumed.law.name]
    coefficients = dict(zip(terms, assumed.parameters[0] * factors, strict=True))
    modulus = float(assumed.law.initial_shear_modulus(assumed.parameters)[0])
    # The amplitudes are in units of the initial shear modulus, which the terms do not change.
    quadratic, second = modulus * amplitudes
    coefficients["i1^2"] = coefficients.get("i1^2", 0.0) + quadratic
    coefficients["i2"] = coefficients.get("i2", 0.0) + second
    coefficients["i1"] -= second
    return replace(assumed, law=SumOfTerms.of(*coefficients), parameters=np.array([list(coefficients.values())]))


_REST_PICTURE = "two pictures without field, the second with the beam turned by 180 degrees about its axis"

CAUSES_IN_SPECIMENS: tuple[PossibleCause, ...] = (
    PossibleCause(
        "clamp_softness",
        "softness of the clamp",
        "mm",
        (0.3,),
        by_sources({("length", 0): 1.0, ("clamp", 0): -1.0}),
        "the angle of the beam at the clamp under load in an enlarged picture, or a stiffer clamp",
    ),
    of_source("rest_shape", "rest-shape", (0.5, 0.3, 0.3), _REST_PICTURE),
    PossibleCause(
        "taper",
        SOURCES["taper"].words,
        SOURCES["taper"].unit,
        (0.06, 0.03),
        _tapered,
        "the width at both ends and in the middle of the beam",
        "taper",
    ),
    of_source("width", "width", (0.05,), "the width at several places"),
    of_source("magnetisation_angle", "magnetisation-angle", (3.0,), BOTH_POLARITIES),
    PossibleCause(
        "magnetisation_out_of_plane",
        "twist by a magnetisation out of the plane of the picture",
        "deg",
        (3.0,),
        _untwisted,
        "a picture of the tip along the beam",
    ),
    PossibleCause(
        "section", "planar section of a solid beam", "1", (1.0,), None, 'a fit with section = "solid"', is_common=True
    ),
    PossibleCause(
        "law",
        "another law",
        "1",
        (0.3, 0.3),
        _with_terms,
        "a fit of the other laws, larger fields, or a tensile curve",
        is_common=True,
    ),
)

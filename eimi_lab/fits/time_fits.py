"""Fit a viscoelastic (Prony) law to the recorded motions of datasets, with or without static states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from eimi_fitting.beam.strip import ImpossibleShape
from eimi_fitting.inference.evidence.quantity import Quantity
from eimi_fitting.inference.evidence.sources import StatedSource
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.stability import LARGEST_STRETCH_CHECKED, stable_up_to
from eimi_fitting.time.identification import LawOfTime, NoEquilibrium, NoRingDown, StaticStates, identify_time
from eimi_lab.fits.evidence import Evidence
from eimi_lab.fits.law_record import Stability
from eimi_lab.fits.recorded_motions import MotionEvidence, motions_beside, static_states
from eimi_lab.fits.records import FitRecord, package_versions
from eimi_lab.fits.time_records import MotionReference, RingDownRecord
from eimi_lab.process.errors import InputError

_ALONE = "neo-hookean"  # the law with one modulus as its only parameter


def with_law_of_time(record: FitRecord, evidence: Sequence[Evidence], motions: Sequence[MotionEvidence]) -> FitRecord:
    """Return the record of a fit to static states with an added viscoelastic (Prony) law.

    The law is fitted to the static modulus and to motions (ring-downs, which are free vibrations, and creep). Of
    `evidence` and `motions`, only the datasets of the record and the datasets without states are used. Raises
    InputError if no ring-down can be used.
    """
    fitted = {dataset.sha256 for dataset in record.datasets}
    own = [one for one in evidence if one.sha256 in fitted]
    beside = motions_beside([one.path for one in own], motions)
    static = static_states(own, record)
    return replace(record, time=_identified(record.model, np.array(record.values()), beside, static, record.seed))


def fit_motions(model: str, motions: Sequence[MotionEvidence], seed: int) -> RingDownRecord:
    """Fit a viscoelastic (Prony) law to ring-downs (free vibrations) and creep, without static states.

    Raises
    ------
    InputError
        If the hyperelastic law `model` has more than one parameter, or if no ring-down can be used.
    """
    law, paths = LAWS[model], ", ".join(str(dataset.path) for dataset in motions)
    if len(law.parameter_names) > 1:
        raise InputError(
            f"{paths}: --model {model}: a ring-down determines only one parameter; use --model {_ALONE}, or add a "
            "dataset of static states"
        )
    time = _identified(model, np.ones(1), motions, None, seed)
    modulus = time.dynamic_shear_modulus
    scale = float(law.initial_shear_modulus(np.ones(1)))
    (name,) = law.parameter_names
    parameter = Quantity(
        modulus.value / scale,
        law.units[0],
        (modulus.interval_95[0] / scale, modulus.interval_95[1] / scale),
    )
    return RingDownRecord(
        model=model,
        parameters={name: parameter},
        initial_shear_modulus=modulus,
        max_stretch=1.0,
        stability=Stability(
            criterion="Drucker",
            stable_up_to_stretch=stable_up_to(law, np.array([parameter.value])),
            checked_up_to_stretch=LARGEST_STRETCH_CHECKED,
        ),
        doubts=(),
        versions=package_versions(),
        time=time,
        datasets=tuple(
            MotionReference(
                path=str(dataset.path),
                sha256=dataset.sha256,
                section=dataset.specimen.section,
                motions=len(dataset.motions),
                stated=dataset.stated,
            )
            for dataset in motions
        ),
        taken_as_exact=tuple(dict.fromkeys(word for dataset in motions for word in dataset.taken_as_exact)),
        seed=seed,
    )


def _identified(
    model: str,
    shape: np.ndarray,
    motions: Sequence[MotionEvidence],
    static: StaticStates | None,
    seed: int,
) -> LawOfTime:
    paths = ", ".join(str(dataset.path) for dataset in motions)
    specimen = motions[0].specimen
    recorded = [motion for dataset in motions for motion in dataset.motions]
    try:
        return identify_time(LAWS[model], shape, specimen, recorded, _stated(motions), static, seed=seed)
    except (NoRingDown, NoEquilibrium) as error:
        raise InputError(f"{paths}: --time prony: {error}") from error
    except ImpossibleShape as error:
        raise InputError(
            f"{paths}: --time prony: an uncertainty of the specimen is too large, because no beam can have this error "
            f"({error}); check rest_shape_mm and taper_mm in [uncertainty]"
        ) from error


def _stated(motions: Sequence[MotionEvidence]) -> tuple[StatedSource, ...]:
    """Return the uncertain inputs of all datasets; if datasets state different uncertainties, the largest counts."""
    stated = [source for dataset in motions for source in dataset.stated]
    return tuple(
        max((one for one in stated if one.source == key), key=lambda one: one.standard_uncertainty)
        for key in dict.fromkeys(one.source for one in stated)
    )

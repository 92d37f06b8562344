"""fits.json: made of what a fit found, written, read, and its laws compared."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Discriminator, Field, Tag, ValidationError

from eimi_fitting.identification import Fit
from eimi_fitting.model_choice import Candidate, choose
from eimi_lab.config.reading import read_text
from eimi_lab.errors import InputError
from eimi_lab.identification.auxiliary import FileCurve
from eimi_lab.identification.experiments import Evidence
from eimi_lab.identification.records import (
    BootstrapRecord,
    ChoiceRecord,
    CurveRecord,
    DatasetReference,
    DirectionRecord,
    Discarded,
    DoubtRecord,
    FitRecord,
    FreedRecord,
    GenerationRecord,
    Identifiability,
    MeshRecord,
    PolishRecord,
    Quantity,
    Record,
    ReplicateRecord,
    RunRecord,
    Stability,
    StateError,
    TensileRecord,
    package_versions,
)
from eimi_lab.outputs import whole_file


def _kind(fit: Any) -> str:
    return str(fit.get("kind", "bending")) if isinstance(fit, dict) else getattr(fit, "kind", "bending")


AnyFit = Annotated[
    Annotated[FitRecord, Tag("bending")] | Annotated[TensileRecord, Tag("tensile")], Discriminator(_kind)
]


class FitsFile(Record):
    """A whole fits.json; comparison: of its laws, where all were fitted to the same data."""

    fits: tuple[AnyFit, ...] = Field(min_length=1)
    comparison: tuple[ChoiceRecord, ...] = ()


def comparison(fits: Sequence[FitRecord | TensileRecord]) -> tuple[ChoiceRecord, ...]:
    """The laws compared; nothing where there is one alone, one twice, or where they have not the same data."""
    bending = [fit for fit in fits if isinstance(fit, FitRecord)]
    data = {
        (
            tuple((d.sha256, d.section, d.states_left_out) for d in fit.datasets),
            tuple((c.sha256, c.window_percent, c.weight) for c in fit.tensile),
            fit.identifiability.points,
        )
        for fit in bending
    }
    once = len({fit.model for fit in bending}) == len(fits)
    if len(bending) < 2 or not once or len(data) > 1:
        return ()
    chosen = choose(
        [
            Candidate(
                fit.model,
                len(fit.identifiability.names),
                (
                    (fit.identifiability.independent_points, fit.mean_error_mm),
                    *((c.weight * c.rows / c.correlation_rows, c.rmse_Pa) for c in fit.tensile),
                ),
            )
            for fit in bending
        ]
    )
    return tuple(
        ChoiceRecord(
            model=choice.model,
            unknowns=choice.unknowns,
            independent_points=choice.independent_points,
            aicc=choice.aicc if np.isfinite(choice.aicc) else None,
            bic=choice.bic,
            weight=choice.weight,
            held_out_error_mm=fit.held_out_error_mm,
        )
        for choice, fit in zip(chosen, bending, strict=True)
    )


def record(fit: Fit, evidence: Sequence[Evidence]) -> FitRecord:
    """What is written down of one fit."""
    law, worth = fit.law, fit.uncertainty
    states = [(d, state) for d, e in enumerate(evidence) for state in e.states]
    return FitRecord(
        model=law.name,
        parameters={
            name: Quantity(value=float(value), unit=unit, interval_95=(float(low), float(high)))
            for name, unit, value, (low, high) in zip(
                law.parameter_names, law.units, fit.parameters, worth.intervals, strict=True
            )
        },
        initial_shear_modulus=Quantity(
            value=fit.initial_shear_modulus_Pa,
            unit="Pa",
            interval_95=(float(worth.initial_shear_modulus_Pa[0]), float(worth.initial_shear_modulus_Pa[1])),
        ),
        mean_error_mm=float(np.mean(fit.error_mm)),
        mean_deviation_mm=float(np.mean(fit.deviation_mm)),
        by_state=tuple(
            StateError(
                dataset=d,
                state=state.index,
                current_A=state.current_A,
                field_mT=state.field_mT,
                error_mm=float(error),
                deviation_mm=float(deviation),
            )
            for (d, state), error, deviation in zip(states, fit.error_mm, fit.deviation_mm, strict=True)
        ),
        max_stretch=fit.max_stretch,
        evaluations=fit.evaluations,
        generations=len(fit.history),
        discarded=Discarded(unconverged=fit.unconverged, unstable=fit.unstable),
        polish=PolishRecord(
            mean_error_before_mm=fit.polish.before_mm,
            mean_error_after_mm=fit.polish.after_mm,
            steps=fit.polish.steps,
        ),
        stop=fit.stop,
        wall_s=fit.wall_s,
        identifiability=_identifiability(fit),
        bulk_modulus=_bulk_modulus(fit),
        freed=_freed(fit),
        tensile=_curves(fit),
        mesh=_mesh(fit),
        held_out_error_mm=worth.held_out_error_mm,
        doubts=tuple(
            DoubtRecord(dataset=d, state=None if k is None else evidence[d].states[k].index, words=words)
            for d, k, words in fit.doubts
        ),
        stability=Stability(
            criterion="Drucker",
            stable_up_to_stretch=fit.stable_to,
            checked_up_to_stretch=fit.stability_checked_to,
        ),
        datasets=tuple(
            DatasetReference(
                path=str(e.path),
                sha256=e.sha256,
                section=e.experiment.model.specimen.section,
                states_left_out=tuple(s.index for s in e.left_out),
            )
            for e in evidence
        ),
        seed=fit.seed,
        versions=package_versions(),
        runs=tuple(RunRecord(**dataclasses.asdict(run)) for run in fit.runs),
        history=tuple(GenerationRecord.of(generation) for generation in fit.history),
    )


def replicate_record(fit: Fit, replicate: int) -> ReplicateRecord:
    """What is written down of a fit to one replicate of the data."""
    return ReplicateRecord(
        replicate=replicate,
        parameters=dict(zip(fit.law.parameter_names, fit.parameters.tolist(), strict=True)),
        initial_shear_modulus_Pa=fit.initial_shear_modulus_Pa,
        mean_error_mm=float(np.mean(fit.error_mm)),
        evaluations=fit.evaluations,
        stop=fit.stop,
        wall_s=fit.wall_s,
    )


FEWEST_FOR_INTERVAL = 40  # replicates: one beyond each end of a 95 % interval


def bootstrap_record(replicates: Sequence[ReplicateRecord]) -> BootstrapRecord:
    """All replicates of one fit, and what they say together."""
    moduli = [replicate.initial_shear_modulus_Pa for replicate in replicates]
    enough = len(moduli) >= FEWEST_FOR_INTERVAL
    low, high = np.quantile(moduli, [0.025, 0.975]) if enough else (0.0, 0.0)
    return BootstrapRecord(
        initial_shear_modulus_interval_95_Pa=(float(low), float(high)) if enough else None,
        replicates=tuple(replicates),
    )


def _curves(fit: Fit) -> tuple[CurveRecord, ...]:
    """What is written down of the tensile curves of a fit, which come from files."""
    found = []
    for evidence, rmse in zip(fit.curves, fit.curve_rmse_Pa, strict=True):
        curve = evidence.curve
        if isinstance(curve, FileCurve):
            found.append(
                CurveRecord(
                    path=curve.path,
                    sha256=curve.sha256,
                    window_percent=curve.window_percent,
                    weight=curve.weight,
                    rows=len(curve.strain),
                    correlation_rows=evidence.correlation_rows,
                    rmse_alone_Pa=evidence.noise_Pa,
                    rmse_Pa=rmse,
                )
            )
    return tuple(found)


def _identifiability(fit: Fit) -> Identifiability:
    """What is written down of what the data fix."""
    worth = fit.uncertainty
    return Identifiability(
        statement=worth.statement,
        not_fixed=worth.not_fixed,
        at_bound=fit.at_bound,
        residual_mm=worth.noise_mm,
        correlation_points=worth.correlation_points,
        points=worth.points,
        independent_points=worth.independent_points,
        names=worth.names,
        correlation=tuple(tuple(float(x) for x in row) for row in worth.correlation),
        directions=tuple(DirectionRecord(words=d.words, remaining=d.remaining) for d in worth.directions),
        profiled=worth.profiled,
    )


def _freed(fit: Fit) -> tuple[FreedRecord, ...]:
    """What is written down of the nuisances."""
    return tuple(
        FreedRecord(
            name=value.name,
            dataset=value.dataset,
            deviation=Quantity(value=value.value, unit=value.unit, interval_95=value.interval),
            prior_standard_deviation=value.prior_spread,
        )
        for value in fit.uncertainty.freed
    )


def _bulk_modulus(fit: Fit) -> Quantity | None:
    """What is written down of the bulk modulus: nothing where it was not freed."""
    ends = fit.uncertainty.bulk_modulus_Pa
    if fit.bulk_modulus_Pa is None or ends is None:
        return None
    return Quantity(value=fit.bulk_modulus_Pa, unit="Pa", interval_95=(float(ends[0]), float(ends[1])))


def _mesh(fit: Fit) -> MeshRecord:
    """What is written down of the mesh."""
    change, left = fit.uncertainty.mesh_change, fit.uncertainty.mesh_left
    return MeshRecord(
        change_percent=None if change is None else 100 * change, left_percent=None if left is None else 100 * left
    )


def write_fits(path: Path, fits: Sequence[FitRecord | TensileRecord], force: bool = False) -> None:
    """Write fits.json. Raises InputError when the file exists and ``force`` is not given."""
    with whole_file(path, force) as temporary:
        temporary.write_text(
            FitsFile(fits=tuple(fits), comparison=comparison(fits)).model_dump_json(indent=1) + "\n", encoding="utf-8"
        )


_EXPECTED = "expected a file that `eimi fit` or `eimi tensile` of this release wrote"


def read_any_fits(path: str | Path) -> tuple[FitRecord | TensileRecord, ...]:
    """Read fits.json, tensile fits included. Raises InputError naming the file and the key."""
    path = Path(path)
    text = read_text(path)
    try:
        return FitsFile.model_validate(json.loads(text)).fits
    except json.JSONDecodeError as error:
        raise InputError(f"{path}: line {error.lineno}: is not JSON ({error.msg}); {_EXPECTED}") from error
    except ValidationError as error:
        raise InputError(f"{path}: {first_fault(error)}; {_EXPECTED}: if it is of an earlier one, fit again") from error


def first_fault(error: ValidationError) -> str:
    """The first key that cannot be used, and why; without the choices that pydantic tried on the way to it."""
    first = error.errors()[0]
    keys = [str(key) for key in first["loc"]]
    if keys[:1] == ["fits"]:
        del keys[2:3]  # the kind of fit
    return ": ".join(words for words in (".".join(key for key in keys if "(" not in key), first["msg"]) if words)

"""What the parts of a result file have in common, and what is written of a fit's worth."""

from __future__ import annotations

from dataclasses import dataclass

from pydantic import BaseModel, ConfigDict

from eimi_fitting.identification import Fit
from eimi_fitting.tensile_evidence import TensileCurve


class Record(BaseModel):
    """A part of a result file: not changed after it is made, no unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Quantity(Record):
    """A value with its unit and its 95 % interval."""

    value: float
    unit: str
    interval_95: tuple[float, float]


class DirectionRecord(Record):
    """A combination of unknowns, and the share of what was unknown of it that the data leave."""

    words: str
    remaining: float


class Identifiability(Record):
    """What the data fix, in words and in numbers.

    not_fixed: coordinates that only the bounds hold; at_bound: those that ended on a bound; names and correlation: all
    unknowns and how their errors hang together, a row each; directions: best known first; profiled: coordinates whose
    interval is that of the profile likelihood; points count as independent_points.
    """

    statement: str
    not_fixed: tuple[str, ...]
    at_bound: tuple[str, ...]
    residual_mm: float
    correlation_points: float
    points: int
    independent_points: float
    names: tuple[str, ...]
    correlation: tuple[tuple[float, ...], ...]
    directions: tuple[DirectionRecord, ...]
    profiled: tuple[str, ...]


class FreedRecord(Record):
    """A nuisance that was freed: by how much it is off what was stated, beside the prior's standard deviation.

    dataset counts from 0 in the order given; null where it is common to all.
    """

    name: str
    dataset: int | None
    deviation: Quantity
    prior_standard_deviation: float


class MeshRecord(Record):
    """What a mesh twice as fine changed in the parameters, and the half-width left in the interval for the rest.

    Both in per cent of the initial shear modulus; null where the finer mesh found no solution.
    """

    change_percent: float | None
    left_percent: float | None


class CurveRecord(Record):
    """A tensile curve in the fit: its weight, and the root mean square residual of the law alone with it and here."""

    path: str
    sha256: str
    window_percent: float | None
    weight: float
    rows: int
    correlation_rows: float
    rmse_alone_Pa: float
    rmse_Pa: float


class ChoiceRecord(Record):
    """One law among those of the file: AICc and BIC above the best one's, Akaike weight, error on states left out.

    aicc is null where the data are too few for the law.
    """

    model: str
    unknowns: int
    independent_points: float
    aicc: float | None
    bic: float
    weight: float
    held_out_error_mm: float


class DatasetReference(Record):
    """Which file was fitted, by its content, and which of its states were left out for their flags."""

    path: str
    sha256: str
    section: str
    states_left_out: tuple[int, ...]


class Discarded(Record):
    """Candidates that counted as worst: no convergence, or not stable over the stretches reached."""

    unconverged: int
    unstable: int


class PolishRecord(Record):
    """Gauss-Newton after the search, on the finer mesh: the mean error where it began and where it ended.

    Before what a still finer mesh changes was taken into account; with tensile curves or freed nuisances in the fit it
    is the objective, which holds them too.
    """

    mean_error_before_mm: float
    mean_error_after_mm: float
    steps: int


class DoubtRecord(Record):
    """Something a reader should know: about one state of a dataset, or about all of it (null)."""

    dataset: int
    state: int | None
    words: str


@dataclass(frozen=True)
class FileCurve(TensileCurve):
    """A tensile curve from a file, up to a largest strain (None: the whole curve)."""

    path: str = ""
    sha256: str = ""
    window_percent: float | None = None


def curves(fit: Fit) -> tuple[CurveRecord, ...]:
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


def identifiability(fit: Fit) -> Identifiability:
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


def freed(fit: Fit) -> tuple[FreedRecord, ...]:
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


def bulk_modulus(fit: Fit) -> Quantity | None:
    """What is written down of the bulk modulus: nothing where it was not freed."""
    ends = fit.uncertainty.bulk_modulus_Pa
    if fit.bulk_modulus_Pa is None or ends is None:
        return None
    return Quantity(value=fit.bulk_modulus_Pa, unit="Pa", interval_95=(float(ends[0]), float(ends[1])))


def mesh(fit: Fit) -> MeshRecord:
    """What is written down of the mesh."""
    change, left = fit.uncertainty.mesh_change, fit.uncertainty.mesh_left
    return MeshRecord(
        change_percent=None if change is None else 100 * change, left_percent=None if left is None else 100 * left
    )

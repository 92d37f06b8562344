"""What decides a fit beside data, law and seed: an option is one field here, of the command line and of a checkpoint.

Nothing that takes time to import is imported before an option is used: the command line needs the fields alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from eimi_lab.process.errors import InputError

if TYPE_CHECKING:
    from eimi_fitting.inference.evidence.parameter_priors import Prior
    from eimi_fitting.inference.evidence.unknowns import NuisancePrior
    from eimi_lab.fits.evidence import Evidence
    from eimi_lab.fits.tensile_files import FileCurve

_WINDOW = "50"  # percent: more than beams bend to
_BULK = "bulk"


@dataclass(frozen=True)
class FitOptions:
    """The options of `eimi fit` on which its numbers depend."""

    section: Annotated[
        str | None, typer.Option(metavar="solid|plane-strain|plane-stress", help="in place of the specimen's")
    ] = None
    include_flagged: Annotated[bool, typer.Option("--include-flagged", help="fit flagged states too")] = False
    free: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME[=DEVIATION]",
            help="what is uncertain as one more unknown, by its standard deviation in mm, degrees or as a share: "
            "width=0.02, roll=0.1, coil=0.01, ...; or bulk",
        ),
    ] = None
    prior: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PARAMETER=MEAN,DEVIATION",
            help="what is known of a parameter of the law, by mean and standard deviation in its unit: C10=20000,500, "
            "or initial_shear_modulus=...; may be repeated",
        ),
    ] = None
    tensile: Annotated[
        list[Path] | None, typer.Option(help="a tensile curve that the law has to follow as well; may be repeated")
    ] = None
    tensile_window: Annotated[str | None, typer.Option(help="its largest strain in percent, or full [50]")] = None
    tensile_weight: Annotated[float | None, typer.Option(help="multiplies what its own noise makes it count [1]")] = (
        None
    )
    restarts: Annotated[int, typer.Option(help="of the search, each with twice the population", min=0, max=9)] = 0
    bipop: Annotated[bool, typer.Option("--bipop", help="between restarts, also runs of a small population")] = False

    def for_identify(self) -> dict[str, Any]:
        """As `eimi_fitting.identify` takes them. Raises InputError."""
        return {
            "free": self._nuisances,
            "free_bulk": self._bulk,
            "tensile": self._curves,
            "priors": self._priors,
            "restarts": self.restarts,
            "bipop": self.bipop,
        }

    def head(self) -> dict[str, Any]:
        """As a checkpoint writes them down: files by their content."""
        return {**asdict(self), "tensile": [curve.sha256 for curve in self._curves]}

    def check_laws(self, models: Sequence[str]) -> None:
        """Raise InputError for a prior on a parameter that one of these laws does not have."""
        from eimi_fitting.inference.evidence.parameter_priors import check_priors
        from eimi_fitting.laws import LAWS

        for model in models:
            try:
                check_priors(self._priors, LAWS[model])
            except ValueError as error:
                raise InputError(f"--prior: {error}") from error

    def load(self, path: Path) -> Evidence:
        """A dataset as these options take it. Raises InputError."""
        from eimi_lab.fits.evidence import load_evidence
        from eimi_lab.fits.fitting import check_section

        return load_evidence(path, section=check_section(self.section), flagged=self.include_flagged)

    def check(self, evidence: Sequence[Evidence]) -> None:
        """Raises InputError where two datasets hold the same, or one knows nothing of what is to be freed."""
        from eimi_fitting.inference.evidence.sources import SOURCES

        known: dict[str, Path] = {}
        for seen in evidence:
            same = known.setdefault(seen.sha256, seen.path)
            if same != seen.path:
                raise InputError(f"{seen.path}: holds the same as {same}; the same data would count twice")
            section = seen.experiment.model.specimen.section
            if self._bulk and section != "plane-strain":
                raise InputError(
                    f"--free bulk: {seen.path} is taken as {section}, whose search model is exactly incompressible; "
                    "a bulk modulus takes --section plane-strain"
                )
            for prior in self._nuisances:
                if SOURCES[prior.kind].field and not seen.experiment.loads.field_T.any():
                    raise InputError(f"--free {prior.kind}: {seen.path} has no state with a field")
                self._check_spread(prior, seen)

    @staticmethod
    def _check_spread(prior: NuisancePrior, seen: Evidence) -> None:
        """Raises InputError where the standard deviation of what is freed is not known of this dataset."""
        from eimi_fitting.inference.evidence.sources import SOURCES

        if prior.spread is not None:
            return
        stated = next((s for s in seen.experiment.stated if s.source == prior.kind), None)
        if stated is None or stated.standard_uncertainty == 0:
            source = SOURCES[prior.kind]
            said = "states no uncertainty of it" if stated is None else "says that it is exact"
            raise InputError(
                f"--free {prior.kind}: {seen.path} {said}; give one, such as --free {prior.kind}={source.usual:g}"
            )

    @property
    def _bulk(self) -> bool:
        return _BULK in (self.free or ())

    @cached_property
    def _priors(self) -> tuple[Prior, ...]:
        return tuple(map(_prior, self.prior or ()))

    @cached_property
    def _nuisances(self) -> tuple[NuisancePrior, ...]:
        priors: dict[str, NuisancePrior] = {}
        for words in self.free or ():
            if words == _BULK:
                continue
            prior = _nuisance(words)
            if prior.kind in priors:
                raise InputError(f"--free {words}: {prior.kind} is given twice")
            priors[prior.kind] = prior
        return tuple(priors.values())

    @cached_property
    def _curves(self) -> tuple[FileCurve, ...]:
        from eimi_lab.fits.tensile_files import check_windows, read_curve

        for option, given in (("--tensile-window", self.tensile_window), ("--tensile-weight", self.tensile_weight)):
            if given is not None and not self.tensile:
                raise InputError(f"{option} {given}: of which curve? give --tensile too")
        (percent,) = check_windows([self.tensile_window or _WINDOW], "--tensile-window")
        weight = 1.0 if self.tensile_weight is None else self.tensile_weight
        if not 0 < weight < float("inf"):
            raise InputError(f"--tensile-weight {weight:g}: should be a number above 0")
        curves = tuple(read_curve(path, percent, weight) for path in self.tensile or ())
        for i, curve in enumerate(curves):
            for other in curves[:i]:
                if curve.sha256 == other.sha256:
                    raise InputError(f"{curve.path}: holds the same as {other.path}; the same data would count twice")
        return curves


def _prior(words: str) -> Prior:
    from eimi_fitting.inference.evidence.parameter_priors import Prior

    parameter, _, numbers = words.partition("=")
    try:
        mean, deviation = map(float, numbers.split(","))
    except ValueError as error:
        raise InputError(
            f"--prior {words}: should be PARAMETER=MEAN,DEVIATION in the parameter's unit, such as C10=20000,500"
        ) from error
    try:
        return Prior(parameter.strip(), mean, deviation)
    except ValueError as error:
        raise InputError(f"--prior {words}: {error}") from error


def _nuisance(words: str) -> NuisancePrior:
    from eimi_fitting.inference.evidence.sources import SOURCES
    from eimi_fitting.inference.evidence.unknowns import NuisancePrior

    units = {key: {"1": "relative", "deg": "degrees"}.get(source.unit, source.unit) for key, source in SOURCES.items()}
    key, equals, number = words.partition("=")
    if key not in SOURCES or not (equals or SOURCES[key].stated_in):
        examples = ", ".join(f"{key}={source.usual:g} ({units[key]})" for key, source in SOURCES.items())
        raise InputError(f"--free {words}: should be a standard deviation such as {examples}, or {_BULK}")
    try:
        return NuisancePrior(key, float(number) if equals else None)
    except ValueError as error:
        raise InputError(
            f"--free {words}: should be {key}=NUMBER above 0, at most {SOURCES[key].largest:g} ({units[key]})"
        ) from error

"""The options of a fit that determine the numbers of the result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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

_WINDOW = "50"  # percent: larger than the strains of bent beams
_BULK = "bulk"
_LAWS_OF_TIME = ("none", "prony")


Section = Annotated[
    str | None,
    typer.Option(
        metavar="solid|plane-strain|plane-stress",
        help="model of the cross-section: solid (in three dimensions), plane-strain (planar, with a fixed depth of the "
        "beam) or plane-stress (planar, without stress on the front and back faces); default: the model in the "
        "specimen file",
    ),
]
IncludeFlagged = Annotated[
    bool,
    typer.Option(
        "--include-flagged",
        help="also use the states with a serious flag (failed quality check), which are left out by default",
    ),
]


@dataclass(frozen=True)
class FitOptions:
    """The options of `eimi fit` that determine the numbers of the fit."""

    section: Section = None
    include_flagged: IncludeFlagged = False
    free: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME[=DEVIATION]",
            help="input that is not known exactly and is fitted together with the law, and its standard deviation, "
            "such as width=0.02 (mm), coil=0.01 (coil constant, relative) or roll=0.2 (rotation of the camera, "
            "degrees); the message about a wrong name lists all names. Without a deviation, the uncertainty in the "
            "input files is used. With the name bulk, the bulk modulus is fitted. May be repeated",
        ),
    ] = None
    prior: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PARAMETER=MEAN,DEVIATION",
            help="prior knowledge of a parameter: mean and standard deviation in the unit of the parameter, such as "
            "C10=20000,500 or initial_shear_modulus=...; may be repeated",
        ),
    ] = None
    tensile: Annotated[
        list[Path] | None,
        typer.Option(metavar="FILE", help="tensile curve to fit together with the datasets; may be repeated"),
    ] = None
    tensile_window: Annotated[
        str | None,
        typer.Option(
            metavar="PERCENT|full",
            help="largest strain of the tensile curves that is fitted, in per cent; full for the whole curves",
            show_default="50",
        ),
    ] = None
    tensile_weight: Annotated[
        float | None,
        typer.Option(
            help="factor by which the weight of the tensile curves is multiplied; with 1, the weight follows from the "
            "noise of the curves",
            show_default="1",
        ),
    ] = None
    restarts: Annotated[
        int,
        typer.Option(
            help="number of restarts of the search; each restart has twice the population (candidates in each "
            "generation) of the search before",
            min=0,
            max=9,
        ),
    ] = 0
    bipop: Annotated[
        bool,
        typer.Option(
            "--bipop", help="between restarts, also search with small populations (few candidates in each generation)"
        ),
    ] = False
    time: Annotated[
        str,
        typer.Option(
            metavar="none|prony",
            help="viscoelastic law to fit to the recorded ring-downs and creep; prony is a Prony series",
        ),
    ] = "none"

    @property
    def has_law_of_time(self) -> bool:
        """Whether a viscoelastic (Prony) law is fitted. Raises InputError for an unknown value of ``--time``."""
        if self.time not in _LAWS_OF_TIME:
            raise InputError(f"--time {self.time}: should be one of {', '.join(_LAWS_OF_TIME)}")
        return self.time != "none"

    def for_identify(self) -> dict[str, Any]:
        """Return the options as keyword arguments of `eimi_fitting.identify`.

        Raises
        ------
        InputError
            If an option cannot be used.
        """
        return {
            "free": self._nuisances,
            "free_bulk": self._bulk,
            "tensile": self._curves,
            "priors": self._priors,
            "restarts": self.restarts,
            "bipop": self.bipop,
        }

    def head(self) -> dict[str, Any]:
        """Return the options for the first line of a checkpoint (log of a search); a hash replaces each file."""
        return {**asdict(self), "tensile": [curve.sha256 for curve in self._curves]}

    def check_laws(self, models: Sequence[str]) -> None:
        """Raise InputError if the option `--prior` names a parameter that no law of `models` has."""
        from eimi_fitting.inference.evidence.parameter_priors import check_priors
        from eimi_fitting.laws import LAWS

        for model in models:
            try:
                check_priors(self._priors, LAWS[model])
            except ValueError as error:
                raise InputError(f"--prior: {error}") from error

    def load(self, path: Path) -> Evidence:
        """Return beam model, loads and edges of a dataset, read with these options.

        Raises
        ------
        InputError
            If the dataset cannot be used.
        """
        from eimi_lab.fits.evidence import load_evidence
        from eimi_lab.fits.fitting import check_section

        return load_evidence(path, section=check_section(self.section), flagged=self.include_flagged)

    def check(self, evidence: Sequence[Evidence]) -> None:
        """Check the datasets of a fit with these options.

        Raises
        ------
        InputError
            If two datasets have the same content, or if a dataset does not allow one of the given options.
        """
        from eimi_fitting.inference.evidence.sources import SOURCES

        path_of_content: dict[str, Path] = {}
        for dataset in evidence:
            same = path_of_content.setdefault(dataset.sha256, dataset.path)
            if same != dataset.path:
                raise InputError(f"{dataset.path}: has the same content as {same}; the same data would count twice")
            section = dataset.experiment.model.specimen.section
            if self._bulk and section != "plane-strain":
                raise InputError(
                    f"--free bulk: {dataset.path} is modelled as {section}, and the fit of this section assumes that "
                    "the material is incompressible; give --section plane-strain, too"
                )
            for prior in self._nuisances:
                if SOURCES[prior.kind].field and not dataset.experiment.loads.field_T.any():
                    raise InputError(
                        f"--free {prior.kind}: {dataset.path} has no state with a field, and therefore contains no "
                        "information about this input"
                    )
                if SOURCES[prior.kind].lens and dataset.experiment.view is None:
                    raise InputError(
                        f"--free {prior.kind}: {dataset.path} has no edges with a known distance of the lens "
                        "(stand_off_mm), and therefore contains no information about this input"
                    )
                self._check_spread(prior, dataset)

    def check_motions(self, datasets: Sequence[Path], others: Mapping[str, object]) -> None:
        """Refuse options that need states (load steps), for a fit to recorded motions without states.

        Parameters
        ----------
        datasets : sequence of Path
            Datasets, for messages.
        others : mapping
            Further options that need states, with their values.

        Raises
        ------
        InputError
            If an option is given that such a fit does not use.
        """
        given = {
            "--include-flagged": self.include_flagged,
            "--free": self.free,
            "--prior": self.prior,
            "--tensile": self.tensile,
            "--restarts": self.restarts,
            "--bipop": self.bipop,
            **others,
        }
        for name, value in given.items():
            if value:
                raise InputError(
                    f"{', '.join(map(str, datasets))}: {name}: is for a fit to states (load steps), and these datasets "
                    "hold recorded motions and no states; leave this option out"
                )

    @staticmethod
    def _check_spread(prior: NuisancePrior, dataset: Evidence) -> None:
        """Raise InputError if no standard deviation is known for an uncertain input that is fitted with the law."""
        from eimi_fitting.inference.evidence.sources import SOURCES

        if prior.spread is not None:
            return
        stated = next((s for s in dataset.experiment.stated if s.source == prior.kind), None)
        if stated is None or stated.standard_uncertainty == 0:
            source = SOURCES[prior.kind]
            problem = (
                "gives no uncertainty of this input" if stated is None else "gives the uncertainty 0 for this input"
            )
            raise InputError(
                f"--free {prior.kind}: {dataset.path} {problem}; give a standard deviation, such as "
                f"--free {prior.kind}={source.usual:g}"
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

        for option, value in (("--tensile-window", self.tensile_window), ("--tensile-weight", self.tensile_weight)):
            if value is not None and not self.tensile:
                raise InputError(f"{option} {value}: needs a tensile curve; give --tensile, too")
        (percent,) = check_windows([self.tensile_window or _WINDOW], "--tensile-window")
        weight = 1.0 if self.tensile_weight is None else self.tensile_weight
        if not 0 < weight < float("inf"):
            raise InputError(f"--tensile-weight {weight:g}: should be a number above 0")
        curves = tuple(read_curve(path, percent, weight) for path in self.tensile or ())
        for i, curve in enumerate(curves):
            for other in curves[:i]:
                if curve.sha256 == other.sha256:
                    raise InputError(
                        f"{curve.path}: has the same content as {other.path}; the same data would count twice"
                    )
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
        raise InputError(
            f"--free {words}: should be an input with its standard deviation, such as {examples}, or {_BULK} "
            "for the bulk modulus"
        )
    try:
        return NuisancePrior(key, float(number) if equals else None)
    except ValueError as error:
        raise InputError(
            f"--free {words}: should be {key}=NUMBER above 0, at most {SOURCES[key].largest:g} ({units[key]})"
        ) from error

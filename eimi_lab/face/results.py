"""Classes of results of the Python interface, which are printed as text and shown as HTML in a notebook."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from eimi_fitting.discovery.terms_of_a_law import Discovery
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.toml import parse
from eimi_lab.fits import planning
from eimi_lab.fits.discovering import lines
from eimi_lab.fits.evidence import Evidence
from eimi_lab.fits.residuals import Residuals
from eimi_lab.fits.simulated_fit import FittedLaw, Prediction
from eimi_lab.fits.validation import Validation, ValidationFile
from eimi_lab.fits.validation_tables import by_dataset
from eimi_lab.process.outputs import write_file
from eimi_lab.showing.tables import html_table, installed

T = TypeVar("T")


@dataclass(frozen=True, repr=False)
class Validations:
    """Comparisons of fits with datasets: one prediction for each dataset and fit.

    The order is: all fits for the first dataset, then all fits for the next dataset.
    """

    predictions: tuple[Prediction[FittedLaw], ...]

    def __len__(self) -> int:
        return len(self.predictions)

    def __iter__(self) -> Iterator[Validation]:
        return (prediction.validation for prediction in self.predictions)

    def __getitem__(self, index: int) -> Validation:
        return self.predictions[index].validation

    @property
    def evidence(self) -> tuple[Evidence, ...]:
        """The measured edges and loads of each dataset, in the order in which the datasets were given."""
        return tuple({id(prediction.evidence): prediction.evidence for prediction in self.predictions}.values())

    @property
    def content(self) -> dict[str, Any]:
        """The content of the file validation.json."""
        return ValidationFile(validations=tuple(self)).model_dump(mode="json")

    def residuals(self, index: int = 0) -> Residuals:
        """Return, for one prediction, the distances (mm) of the measured points from the simulated beam.

        ``index`` is the position of the prediction in this object, counted from 0.
        """
        prediction = self.predictions[index]
        return Residuals.of(prediction.evidence, prediction.residuals_mm)

    def to_pandas(self) -> Any:
        """Return a pandas.DataFrame with one row for each dataset, fit and state (load step).

        A fit has its number and its law as its name, and also its file if fits of several files would have the same
        name. Raises ImportError if pandas is not installed.
        """
        names = _different(
            [(one.dataset, f"{one.fit.index} {one.model}") for one in self],
            [(one.dataset, f"{one.fit.path}:{one.fit.index} {one.model}") for one in self],
        )
        tables = {name: one.to_pandas() for name, one in zip(names, self, strict=True)}
        return installed("pandas").concat(tables, names=["dataset", "fit"])

    def write(self, path: str | Path, force: bool = False) -> Path:
        """Write validation.json to ``path`` and return the path.

        Raises InputError if the file exists and ``force`` is False.
        """
        write_file(Path(path), ValidationFile(validations=tuple(self)).model_dump_json(indent=1) + "\n", force)
        return Path(path)

    def plot(self) -> Any:
        """Return a matplotlib figure of the error of each state (load step) against the magnetic field.

        The error is the root mean square distance of the measured points from the simulated edges.
        """
        from eimi_lab.fits.fit_figures import drawn_errors_of_several  # matplotlib is slow to import

        names = _different(
            [f"{one.model} on {Path(one.dataset).name}" for one in self],
            [f"{one.fit.path}:{one.fit.index} {one.model} on {one.dataset}" for one in self],
        )
        return drawn_errors_of_several(
            {
                name: ([state.field_mT for state in one.by_state], [state.error_mm for state in one.by_state])
                for name, one in zip(names, self, strict=True)
            }
        )

    def __repr__(self) -> str:
        return "\n".join(by_dataset(list(self)))

    def _repr_html_(self) -> str:
        return "".join(validation._repr_html_() for validation in self)


def _different(names: Sequence[T], longer: Sequence[T]) -> Sequence[T]:
    """Return the names if they are all different, otherwise the longer names."""
    return names if len(set(names)) == len(names) else longer


@dataclass(frozen=True, repr=False)
class Plan:
    """The states (load steps) that are proposed for the next run.

    Attributes
    ----------
    goal : planning.Goal
        What the next run should determine.
    runs : tuple of planning.PlannedRun
        The planned runs, the best run first.
    base : Protocol
        The protocol that gives the limits, the rate of the current and the wait for rest.
    """

    goal: planning.Goal
    runs: tuple[planning.PlannedRun, ...]
    base: Protocol

    @property
    def text(self) -> str:
        """The protocol of the best planned run, as TOML text."""
        return planning.protocol_text(self.goal, self.runs[0], self.base)

    @property
    def protocol(self) -> Protocol:
        """The protocol of the best planned run."""
        return parse(Protocol, self.text, "plan")

    def write(self, path: str | Path, force: bool = False) -> Path:
        """Write the protocol of the best planned run to ``path``, and return the path.

        Raises InputError if the file exists and ``force`` is False.
        """
        write_file(Path(path), self.text, force)
        return Path(path)

    def __repr__(self) -> str:
        return "\n".join(planning.table(self.goal, self.runs))

    def _repr_html_(self) -> str:
        rows = [
            (
                run.mounting.in_words(),
                self.goal.value(run.expected),
                self.goal.value(run.spaced),
                ", ".join(f"{current:g}" for current in run.currents_A),
            )
            for run in self.runs
        ]
        return html_table(self.goal.in_words(), ("mounting", "planned", "equally spaced", "currents, A"), rows)


@dataclass(frozen=True, repr=False)
class Discovered:
    """The result of a search for the terms of a law.

    Attributes
    ----------
    discovery : Discovery
        The sets of terms, and the error of each set on data that were not fitted.
    content : mapping
        The content of the file discovery.json.
    """

    discovery: Discovery
    content: Mapping[str, Any]

    @property
    def statement(self) -> str:
        """A sentence that says whether the data determine the terms of the material's strain energy."""
        return self.discovery.statement

    @property
    def identified(self) -> bool:
        """Whether exactly one set of terms agrees with the data."""
        return self.discovery.identified

    def write(self, path: str | Path, force: bool = False) -> Path:
        """Write the discovered terms of the law to the JSON file ``path``, and return the path.

        Raises InputError if the file exists and ``force`` is False.
        """
        write_file(Path(path), json.dumps(self.content, indent=1) + "\n", force)
        return Path(path)

    def __repr__(self) -> str:
        return "\n".join(lines(self.discovery, Path("discovery.json")))

    def _repr_html_(self) -> str:
        rows = [
            (" + ".join(term.name for term in alternative.terms), f"{alternative.held_out_error:.2f}")
            for alternative in self.discovery.alternatives
        ]
        return html_table(self.statement, ("terms", "held-out error over noise"), rows)


@dataclass(frozen=True)
class Report:
    """The paths of the files of a report.

    Attributes
    ----------
    path : Path
        The HTML page.
    assets : Path or None
        The folder with the figures and tables; None if no folder was requested.
    """

    path: Path
    assets: Path | None = None

    def __fspath__(self) -> str:
        return str(self.path)

    def _repr_html_(self) -> str:
        return f'<a href="{self.path.as_posix()}" target="_blank">{self.path.name}</a>'

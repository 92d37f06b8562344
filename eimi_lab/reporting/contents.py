"""The fits and datasets of a report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from eimi_fitting.time.result import LawOfTime
from eimi_lab.dataset.reading import Dataset
from eimi_lab.fits.evidence import Evidence
from eimi_lab.fits.records import FitRecord
from eimi_lab.fits.simulated_fit import Prediction
from eimi_lab.fits.tensile_record import TensileRecord
from eimi_lab.fits.validation import Validation
from eimi_lab.reporting.shown import ShownFit


@dataclass(frozen=True)
class DatasetContents:
    """A dataset of a report, with its simulations.

    Attributes
    ----------
    dataset : Dataset
        The open dataset file.
    evidence : Evidence
        The loads, and the measured edges or tracked points.
    predictions : sequence of Prediction
        The simulation of the dataset with each fit of the report.
    name : str
        Short name of the file, which no other dataset of the report has.
    leading : ShownFit, optional
        The fit for figures with only one fit.
    """

    dataset: Dataset
    evidence: Evidence
    predictions: Sequence[Prediction[ShownFit]]
    name: str
    leading: ShownFit | None = None

    @property
    def simulated(self) -> list[Prediction[ShownFit]]:
        """Return the simulations of the dataset in which the beam has an equilibrium."""
        return [prediction for prediction in self.predictions if prediction.has_equilibrium]

    @property
    def validations(self) -> list[Validation]:
        """Return the errors of each fit on the dataset, in the order of the fits."""
        return [prediction.validation for prediction in self.predictions]

    def simulated_by(self, shown: ShownFit | None) -> Prediction[ShownFit] | None:
        """Return the simulation of the dataset with a fit; None if the simulated beam has no equilibrium."""
        return next((prediction for prediction in self.simulated if prediction.fitted_law == shown), None)

    @property
    def best(self) -> Prediction[ShownFit] | None:
        """Return the simulation for figures that show only one fit; None if no fit gives an equilibrium of the beam.

        This is the simulation with the fit ``leading`` if there is one, and otherwise the simulation with the smallest
        mean error.
        """
        return self.simulated_by(self.leading) or min(
            self.simulated, key=lambda prediction: float(prediction.error_mm.mean()), default=None
        )


@dataclass(frozen=True)
class ReportContents:
    """The fits, datasets, date, command line and viscoelastic (Prony) laws of a report."""

    fits: tuple[ShownFit, ...]
    datasets: tuple[DatasetContents, ...]
    written: datetime
    command: str = ""
    laws_of_time: tuple[tuple[str, LawOfTime], ...] = ()

    @property
    def bending(self) -> list[ShownFit]:
        """Return the fits to datasets of bent beams."""
        return [shown for shown in self.fits if isinstance(shown.fit, FitRecord)]

    @property
    def tensile(self) -> list[ShownFit]:
        """Return the fits to tensile tests."""
        return [shown for shown in self.fits if isinstance(shown.fit, TensileRecord)]


def short_names(paths: Sequence[Path]) -> list[str]:
    """Return a different short name for each path: the file name, if necessary with its last folders.

    Examples
    --------
    >>> short_names([Path("monday/beam.h5"), Path("friday/beam.h5")]) == [
    ...     str(Path("monday/beam.h5")), str(Path("friday/beam.h5"))]
    True
    >>> short_names([Path("monday/first.h5"), Path("monday/second.h5")])
    ['first.h5', 'second.h5']
    """
    for parts in range(1, max((len(path.parts) for path in paths), default=1)):
        names = [str(Path(*path.parts[-parts:])) for path in paths]
        if len(set(names)) == len(paths):
            return names
    return [str(path) for path in paths]

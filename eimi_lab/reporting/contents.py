"""The fits and datasets of a report, as its panels receive them. A panel is one section of the report."""

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
    """One open dataset of a report, with its prediction (simulation) by each fit of the report.

    Attributes
    ----------
    dataset : Dataset
        The open dataset file.
    evidence : Evidence
        The loads and the measured edges or tracked points of the states that are compared with simulations.
    predictions : sequence of Prediction
        One prediction for each fit of the report, in the order of the fits.
    name : str
        Name of the file, with as many of its folders as are needed to distinguish it from the other datasets.
    leading : ShownFit, optional
        The fit that represents the dataset in figures with only one fit.
    """

    dataset: Dataset
    evidence: Evidence
    predictions: Sequence[Prediction[ShownFit]]
    name: str
    leading: ShownFit | None = None

    @property
    def simulated(self) -> list[Prediction[ShownFit]]:
        """Return the predictions (simulations of the dataset with fitted laws) in which the beam has an equilibrium."""
        return [prediction for prediction in self.predictions if prediction.has_equilibrium]

    @property
    def validations(self) -> list[Validation]:
        """Return the errors of each fit on the dataset, in the order of the fits."""
        return [prediction.validation for prediction in self.predictions]

    def simulated_by(self, shown: ShownFit | None) -> Prediction[ShownFit] | None:
        """Return the simulation of the dataset with this fit; None if the beam has no equilibrium with the fit."""
        return next((prediction for prediction in self.simulated if prediction.fitted_law == shown), None)

    @property
    def best(self) -> Prediction[ShownFit] | None:
        """Return the simulation of the dataset for figures that show only one fit.

        This is the simulation by the leading fit, which represents the dataset in such figures. If the beam has no
        equilibrium with the leading fit, it is the simulation with the smallest mean error; None if the beam has no
        equilibrium with any fit.
        """
        return self.simulated_by(self.leading) or min(
            self.simulated, key=lambda prediction: float(prediction.error_mm.mean()), default=None
        )


@dataclass(frozen=True)
class ReportContents:
    """The contents of a report: fits, datasets, date, command line (may be empty), and viscoelastic (Prony) laws."""

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
    """Return a short name for each path, so that all names differ.

    A name consists of the file name, if necessary with the last folders of the path. All names have the same number of
    folders.

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

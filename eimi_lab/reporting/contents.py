"""What a report is about: what the panels are given to show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from eimi_lab.dataset.reading import Dataset
from eimi_lab.fits.evidence import Evidence
from eimi_lab.fits.records import FitRecord, TensileRecord
from eimi_lab.fits.simulated_fit import Prediction
from eimi_lab.fits.validation import Validation
from eimi_lab.reporting.shown import ShownFit


@dataclass(frozen=True)
class DatasetContents:
    """One open dataset, and the predictions of all fits for it.

    name: of its file, with as many folders as tell it from the others. leading: the fit that stands for it.
    """

    dataset: Dataset
    evidence: Evidence
    predictions: Sequence[Prediction[ShownFit]]
    name: str
    leading: ShownFit | None = None

    @property
    def simulated(self) -> list[Prediction[ShownFit]]:
        """The predictions of the fits with which the beam has an equilibrium."""
        return [prediction for prediction in self.predictions if prediction.has_equilibrium]

    @property
    def validations(self) -> list[Validation]:
        """The errors of all fits."""
        return [prediction.validation for prediction in self.predictions]

    def simulated_by(self, shown: ShownFit | None) -> Prediction[ShownFit] | None:
        """The prediction of a fit, if the beam has an equilibrium with it."""
        return next((prediction for prediction in self.simulated if prediction.fitted_law == shown), None)

    @property
    def best(self) -> Prediction[ShownFit] | None:
        """The leading fit, or else the one with the smallest mean error; None without any."""
        return self.simulated_by(self.leading) or min(
            self.simulated, key=lambda prediction: float(prediction.error_mm.mean()), default=None
        )


@dataclass(frozen=True)
class ReportContents:
    """All fits and all datasets; when the report was written, and by what command line where it was by one."""

    every: tuple[ShownFit, ...]
    datasets: tuple[DatasetContents, ...]
    written: datetime
    command: str = ""

    @property
    def bending(self) -> list[ShownFit]:
        """The fits of datasets."""
        return [shown for shown in self.every if isinstance(shown.fit, FitRecord)]

    @property
    def tensile(self) -> list[ShownFit]:
        """The fits of tensile tests."""
        return [shown for shown in self.every if isinstance(shown.fit, TensileRecord)]


def short_names(paths: Sequence[Path]) -> list[str]:
    """Each path's last parts, as many as tell it from all the others."""
    for parts in range(1, max((len(path.parts) for path in paths), default=1)):
        names = [str(Path(*path.parts[-parts:])) for path in paths]
        if len(set(names)) == len(paths):
            return names
    return [str(path) for path in paths]

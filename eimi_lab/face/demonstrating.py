"""Demonstrate the program: simulate a dataset, find the edges, fit laws, and compare the fits with the true law.

The true law is read only after the last fit is written.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eimi_fitting.laws import LAWS
from eimi_lab.acquisition.event_words import on_terminal
from eimi_lab.acquisition.open_bench import open_bench
from eimi_lab.acquisition.run import acquire
from eimi_lab.config.protocol import Protocol, load_protocol
from eimi_lab.config.rig import Rig, load_rig
from eimi_lab.config.specimen import SpecimenFile, load_specimen
from eimi_lab.config.toml import parse
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.fits.evidence import load_evidence
from eimi_lab.fits.fit_grid import fit_grid, grid
from eimi_lab.fits.fits_file import Fits
from eimi_lab.fits.records import FitRecord
from eimi_lab.process.errors import InputError
from eimi_lab.process.outputs import new_folder
from eimi_lab.process.workers import executor_for
from eimi_lab.reporting.page import write_report
from eimi_lab.virtual.beam import forget_solids

Progress = Callable[[str, int], AbstractContextManager[Callable[[str], None]]]


@dataclass(frozen=True)
class Score:
    """A fit, and the true initial shear modulus of the virtual beam (Pa)."""

    fit: FitRecord
    truth_Pa: float

    @property
    def difference_percent(self) -> float:
        """Fitted minus true initial shear modulus, per cent of the true modulus."""
        return 100 * (self.fit.initial_shear_modulus.value / self.truth_Pa - 1)


@dataclass(frozen=True)
class Demonstration:
    """The result of a demonstration: the written files, the true law of the virtual beam, and the fits.

    `true_parameters` are the parameters of the true law, by names that end in the unit.
    """

    dataset: Path
    fits: Path
    report: Path
    true_model: str
    true_parameters: dict[str, float]
    scores: tuple[Score, ...]


def demonstrate(
    folder: Path,
    material: str,
    specimen: str,
    rig: str,
    *,
    quick: bool,
    seed: int,
    force: bool,
    progress: Progress,
) -> Demonstration:
    """Acquire a dataset on a virtual rig, find the edges, fit laws, write the report, and compare with the true law.

    Parameters
    ----------
    folder : Path
        The folder for the files.
    material : str
        Name of a silicone, such as `Dragon Skin 10`, or of its protocol, such as `dragon_skin_10`.
    specimen, rig : str
        Names or paths of the specimen and of a virtual rig.
    quick : bool
        Whether to fit only one law to a few load steps.
    seed : int
        Seed of the random numbers of the searches.
    force : bool
        Whether to replace existing files.
    progress : callable
        Receives a title and the number of steps, and returns a context manager. The context manager yields a function
        that is called after each step.

    Returns
    -------
    Demonstration
        The files, the true law and the fits.

    Raises
    ------
    InputError
        If an input cannot be used, or if the folder is not empty and `force` is false.
    """
    protocol_name = re.sub(r"\W+", "_", material.strip().lower())
    protocol = load_protocol(f"{protocol_name}_quick" if quick else protocol_name)
    beam = _cast(load_specimen(specimen), protocol.material)
    bench_rig = load_rig(rig)
    if not bench_rig.simulated:
        raise InputError(f"{rig}: is a real rig; the demonstration needs a virtual rig (use `eimi acquire`)")
    new_folder(folder, force)
    dataset, fits_file, report = folder / "dataset.h5", folder / "fits.json", folder / "report.html"
    _acquire(protocol, beam, bench_rig, dataset, force, progress)
    forget_solids()
    with progress("segment", len(protocol.currents_A)) as step_done:
        evidence = load_evidence(dataset, report=step_done)
    models = ["neo-hookean"] if quick else list(LAWS)
    tasks = grid(models, [evidence], [seed])
    with progress("fit", len(models)) as step_done:
        fits = fit_grid(tasks, {}, executor=executor_for(len(models), None), report=step_done)
    Fits.of(fits).write(fits_file, force)
    write_report(report, [dataset], [fits_file], force=force, progress=progress)
    with open_dataset(dataset) as opened:
        truth = opened.truth()
    if truth is None:
        raise InputError(f"{dataset}: does not contain the true law of a virtual rig")
    law, parameters = LAWS[truth["model"]], truth["parameters"]
    true_modulus = float(law.initial_shear_modulus(np.array(list(parameters.values()))))
    scores = tuple(Score(fit, true_modulus) for fit in fits)
    return Demonstration(dataset, fits_file, report, truth["model"], parameters, scores)


def _acquire(protocol: Protocol, beam: SpecimenFile, rig: Rig, output: Path, force: bool, progress: Progress) -> None:
    with (
        open_bench(rig, beam, protocol.limits, rate_Hz=protocol.rate_Hz) as bench,
        progress("acquire", protocol.recordings) as step_done,
    ):
        acquire(protocol, beam, rig, bench, output, on_terminal(step_done), force)


def _cast(beam: SpecimenFile, material: str) -> SpecimenFile:
    """Return a copy of a specimen with another material."""
    # The dataset stores the TOML text of the specimen.
    text = re.sub(r"(?m)^material = .*$", f'material = "{material}"', beam.text)
    return parse(SpecimenFile, text, f"specimen {beam.specimen.name}")

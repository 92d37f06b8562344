"""The whole chain on the virtual rig: acquire, segment, fit, report, and then score against the truth.

This is the one place outside the virtual rig that looks at the truth, and it does so after the last fit is written.
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
from eimi_lab.fits.fits_file import write_fits
from eimi_lab.fits.records import FitRecord
from eimi_lab.process.errors import InputError
from eimi_lab.process.outputs import new_folder
from eimi_lab.process.workers import executor_for
from eimi_lab.reporting.page import write_report

Progress = Callable[[str, int], AbstractContextManager[Callable[[str], None]]]


@dataclass(frozen=True)
class Score:
    """One fit beside the truth: initial shear moduli in Pa, difference in percent."""

    fit: FitRecord
    truth_Pa: float

    @property
    def difference_percent(self) -> float:
        """Identified over true, minus one."""
        return 100 * (self.fit.initial_shear_modulus.value / self.truth_Pa - 1)


@dataclass(frozen=True)
class Demonstration:
    """What a demonstration left behind."""

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
    """Run the chain into a folder. ``material`` is a silicone's name or its protocol's. Raises InputError."""
    named = re.sub(r"\W+", "_", material.strip().lower())
    protocol = load_protocol(f"{named}_quick" if quick else named)
    beam = _cast(load_specimen(specimen), protocol.material)
    bench_rig = load_rig(rig)
    if not bench_rig.simulated:
        raise InputError(f"{rig}: is a real rig; the demonstration runs on a virtual one, `eimi acquire` on a real one")
    new_folder(folder, force)
    dataset, fits_file, report = folder / "dataset.h5", folder / "fits.json", folder / "report.html"
    _acquire(protocol, beam, bench_rig, dataset, force, progress)
    with progress("segment", len(protocol.currents_A)) as told:
        evidence = load_evidence(dataset, report=told)
    models = ["neo-hookean"] if quick else list(LAWS)
    tasks = grid(models, [evidence], [seed])
    with progress("fit", len(models)) as told:
        fits = fit_grid(tasks, {}, executor=executor_for(len(models), None), report=told)
    write_fits(fits_file, fits, force)
    write_report(report, [dataset], [fits_file], force=force, progress=progress)
    with open_dataset(dataset) as opened:
        truth = opened.truth()
    if truth is None:
        raise InputError(f"{dataset}: holds no truth to score against")
    law, parameters = LAWS[truth["model"]], truth["parameters"]
    true_modulus = float(law.initial_shear_modulus(np.array(list(parameters.values()))))
    return Demonstration(
        dataset,
        fits_file,
        report,
        truth["model"],
        parameters,
        tuple(Score(fit, true_modulus) for fit in fits),
    )


def _acquire(protocol: Protocol, beam: SpecimenFile, rig: Rig, output: Path, force: bool, progress: Progress) -> None:
    with (
        open_bench(rig, beam, protocol.limits) as bench,
        progress("acquire", len(protocol.currents_A)) as told,
    ):
        acquire(protocol, beam, rig, bench, output, on_terminal(told), force)


def _cast(beam: SpecimenFile, material: str) -> SpecimenFile:
    """The same specimen, cast in another silicone; its text says so too, for that is what the dataset keeps."""
    text = re.sub(r"(?m)^material = .*$", f'material = "{material}"', beam.text)
    return parse(SpecimenFile, text, f"specimen {beam.specimen.name}")

"""Functions that use a law or a fit: simulate, validate, plan, report, export and publish."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from eimi_fitting.laws import LAWS
from eimi_fitting.suggestion import suggestion
from eimi_lab.config.people import load_people
from eimi_lab.config.protocol import Protocol
from eimi_lab.face.given import (
    AnyDataset,
    AnyPath,
    AnyProtocol,
    AnyRig,
    AnySpecimen,
    SectionName,
    closed_meanwhile,
    files,
    named_options,
    output_of,
    protocol_of,
    rig_of,
    several,
    specimen_of,
)
from eimi_lab.face.identifying import AnyFit, fits_of
from eimi_lab.face.results import Plan, Report, Validations
from eimi_lab.fits import planning
from eimi_lab.fits.evidence import load_evidence
from eimi_lab.fits.export import bulk_modulus_Pa, card, check_solver, choose_fit
from eimi_lab.fits.fits_file import Fits
from eimi_lab.fits.fitting import check_models, check_section
from eimi_lab.fits.prediction import predict
from eimi_lab.fits.records import FitRecord
from eimi_lab.fits.simulated_fit import FittedLaw, Prediction
from eimi_lab.fits.tensile_record import TensileRecord
from eimi_lab.fits.time_records import RingDownRecord
from eimi_lab.process.errors import InputError
from eimi_lab.process.outputs import check_distinct, write_file
from eimi_lab.process.progress import progress
from eimi_lab.publishing.archive import Publication
from eimi_lab.publishing.archive import publish as archive_of
from eimi_lab.virtual.simulation import Simulation, keys_of, parse_parameters
from eimi_lab.virtual.simulation import simulate as simulated

_DRAWS = 60  # samples of the fitted parameters, for the intervals of a simulation


@named_options
def simulate(
    protocol: AnyProtocol | Sequence[float],
    specimen: AnySpecimen,
    model: str | None = None,
    *,
    parameter: Mapping[str, float] | Sequence[str] = (),
    fit: AnyFit | None = None,
    index: int | None = None,
    coil_constant: float = 4.7,
    gravity_angle: float = 0.0,
    field_angle: float = 90.0,
    bulk_modulus_kPa: float | None = None,
    output: AnyPath | None = None,
    force: bool = False,
) -> Simulation:
    """Simulate a specimen in all states (load steps) of a protocol.

    Parameters
    ----------
    protocol : str, Path or Protocol, or sequence of float
        A TOML file, the name of a shipped file, or a loaded protocol. A sequence of numbers gives the currents in A.
    specimen : str, Path or SpecimenFile
        The beam.
    model : str
        Name of a law, which is a key of `LAWS`. It is not needed if ``fit`` contains only one law, or with ``index``.
    parameter : mapping, or sequence of str
        Parameters of the law, moduli in Pa: ``{"mu": 46390.0}`` or ``["mu_Pa=46390"]``.
    fit : FitRecord, Fits, str or Path
        Fit that gives the parameters if ``parameter`` is not given.
    index : int
        Number of the fit, from 0, if ``fit`` contains several fits of the law.
    coil_constant : float
        Field at the magnet divided by the current, mT/A.
    gravity_angle, field_angle : float
        Directions of gravity, and of the field of a positive current, degrees from +x (along the straight beam from the
        clamp) toward +y (across the beam).
    bulk_modulus_kPa : float
        Bulk modulus, kPa, for the sections "solid" and "plane-strain". By default the material is incompressible.
    output : str or Path
        Folder to write with tables, a figure and files for ParaView.
    force : bool
        Replace an existing folder.

    Returns
    -------
    Simulation
        The simulated states, with ``tip_mm``, ``tip_angle_deg``, ``edges_mm``, ``max_stretch`` and ``plot()``.

    Raises
    ------
    InputError
        If a law, a parameter or a file does not exist, or if the beam has no equilibrium in a state.
    """
    if fit is None:
        if model is None:
            raise InputError(f"simulate: model is missing; {suggestion('', LAWS)}")
        if index is not None:
            raise InputError(f"simulate: index = {index} is the number of a fit; leave it out, or give fit")
        (name,) = check_models([model])
        (law, values), drawn = parse_parameters(name, _parameter_texts(name, parameter)), None
    elif parameter:
        raise InputError("simulate: fit and parameter both give the parameters; leave one of them out")
    else:
        fitted_laws = fits_of(fit)
        records = [fitted_law.fit for fitted_law in fitted_laws]
        chosen = choose_fit(fitted_laws[0].path, records, _law_among(fitted_laws, model, index), index)
        law, values, drawn = LAWS[chosen.model], np.array(chosen.values()), chosen.drawn(_DRAWS)
    currents_A = protocol_of(protocol).currents_A if isinstance(protocol, str | Path | Protocol) else protocol
    field_mT = coil_constant * np.asarray(currents_A, dtype=float)
    beam = specimen_of(specimen)
    result = simulated(beam, law, values, field_mT, gravity_angle, field_angle, bulk_modulus_kPa, drawn)
    if output is not None:
        result.write(output, force)
    return result


def _law_among(fitted_laws: Sequence[FittedLaw], model: str | None, index: int | None) -> str:
    """Return the name of the law to use: the given name, or the only law of the fits, or the law of one of the fits."""
    laws = [fitted_law.fit.model for fitted_law in fitted_laws]
    if model is not None:
        return model
    if index is not None and 0 <= index < len(laws):
        return laws[index]
    if len(set(laws)) > 1:
        names = ", ".join(dict.fromkeys(laws))
        raise InputError(f"{fitted_laws[0].path}: holds several laws; give --model with one of {names}")
    return laws[0]


def _parameter_texts(model: str, parameter: Mapping[str, float] | Sequence[str]) -> list[str]:
    """Return the parameters of a law as texts in the form that the option `--parameter` takes."""
    if not isinstance(parameter, Mapping):
        return several(parameter)
    law = LAWS[model]
    keys = {**dict(zip(law.parameter_names, keys_of(law), strict=True)), **{key: key for key in keys_of(law)}}
    for name in parameter:
        if name not in keys:
            raise InputError(f"{model} has no parameter {name!r}; {suggestion(name, law.parameter_names)}")
    return [f"{keys[name]}={float(value)!r}" for name, value in parameter.items()]


@named_options
def validate(
    datasets: AnyDataset | Sequence[AnyDataset],
    fit: AnyFit | Sequence[AnyFit],
    *,
    section: SectionName | None = None,
    include_flagged: bool = False,
    output: AnyPath | None = None,
    force: bool = False,
) -> Validations:
    """Simulate the states (load steps) of datasets with fitted laws, and compare simulated and measured edges.

    Parameters
    ----------
    datasets : str, Path or Dataset, or a sequence of these types
        Measured datasets, preferably not those of the fits.
    fit : FitRecord, Fits, str or Path, or a sequence of these types
        Fits, or paths of files fits.json.
    section : "solid", "plane-strain" or "plane-stress"
        How the cross-section of the beam is modelled; by default as in the specimen file.
    include_flagged : bool
        Use also the states that failed a quality check.
    output : str or Path
        File validation.json to write.
    force : bool
        Replace an existing file.

    Returns
    -------
    Validations
        One `Validation` for each dataset and fit, and the methods ``residuals()``, ``to_pandas()`` and ``plot()``.

    Raises
    ------
    InputError
        If a section or a file does not exist, or if a fit used one of these datasets with another ``section``.
    """
    chosen = check_section(section)
    predictions: list[Prediction[FittedLaw]] = []
    with closed_meanwhile(several(datasets)) as paths:
        to_write = output_of(output, [*paths, *files(*several(fit))], force)
        fits = fits_of(fit)
        evidence = [load_evidence(path, section=chosen, flagged=include_flagged) for path in paths]
        with progress("validate", len(evidence)) as report:
            for measured in evidence:
                predictions += predict([(law, measured) for law in fits])
                report(f"{measured.path}, {len(fits)} fits")
    validations = Validations(tuple(predictions))
    if to_write:
        validations.write(to_write, force)
    return validations


@named_options
def plan(
    fits: AnyFit,
    protocol: AnyProtocol,
    specimen: AnySpecimen | Sequence[AnySpecimen],
    rig: AnyRig,
    *,
    states: int | None = None,
    goal: str = "modulus",
    model: str | None = None,
    gravity_angle: float | Sequence[float] = (),
    tip_weight: float | Sequence[float] = (),
    both_polarities: bool = False,
    output: AnyPath | None = None,
    force: bool = False,
) -> Plan:
    """Choose the states (load steps) to measure in the next run, and predict the accuracy of the result.

    Parameters
    ----------
    fits : FitRecord, Fits, str or Path
        Fits of an earlier run, which give the law and the noise of the measurement.
    protocol : str, Path or Protocol
        Protocol that gives the limits, the rate of the current and the wait for rest.
    specimen : str, Path or SpecimenFile, or a sequence of these types
        Specimen to measure, or several specimens to compare.
    rig : str, Path or Rig
        Rig whose limits and uncertainties are used.
    states : int
        Number of states, at least 2; by default as in the protocol. With ``both_polarities`` an even number, at least
        4.
    goal : str
        What the run should determine: ``"modulus"``, the name of a parameter, or the name of a law to rule out.
    model : str
        Name of the law to use, if the fits have several laws.
    gravity_angle : float or sequence of float
        Directions of gravity to compare, degrees from the axis of the straight beam: 0 for a beam that hangs down; by
        default as in the rig file.
    tip_weight : float or sequence of float
        Weights at the tip to compare, grams.
    both_polarities : bool
        Consider also runs that repeat each state with the opposite current.
    output : str or Path
        File to write with the protocol of the best run.
    force : bool
        Replace an existing file.

    Returns
    -------
    Plan
        The ``protocol`` of the best run, and all planned runs with their predicted intervals.

    Raises
    ------
    InputError
        If a law, a goal or a file does not exist, if ``states`` is no possible number, or if the beam has an
        equilibrium in too few states.
    """
    path = output_of(output, files(fits, protocol, rig, *several(specimen)), force)
    base, bench = protocol_of(protocol), rig_of(rig)
    beams = [specimen_of(specimen_or_path) for specimen_or_path in several(specimen)]
    fitted_laws = fits_of(fits)
    aim = planning.Goal.of(fitted_laws[0].path, [fitted_law.fit for fitted_law in fitted_laws], model, goal)
    choice = planning.mountings(beams, bench, several(gravity_angle), several(tip_weight), both_polarities)
    count = planning.number_of_states(states, base, both_polarities)
    runs = planning.plan(aim, choice, bench, base, count)
    planned = Plan(aim, tuple(runs), base)
    if path:
        planned.write(path, force)
    return planned


@named_options
def report(
    datasets: AnyDataset | Sequence[AnyDataset],
    output: AnyPath,
    *,
    fit: AnyFit | Sequence[AnyFit] = (),
    assets: AnyPath | None = None,
    workers: int = 1,
    force: bool = False,
) -> Report:
    """Write a report as one HTML file that contains all figures.

    Parameters
    ----------
    datasets : str, Path or Dataset, or a sequence of these types
        Measured datasets.
    output : str or Path
        HTML file to write.
    fit : FitRecord, Fits, str or Path, or a sequence of these types
        Fits of these datasets.
    assets : str or Path
        Folder for the figures (SVG, PDF) and the tables (CSV, LaTeX).
    workers : int
        Number of parallel processes for several datasets.
    force : bool
        Replace existing files.

    Returns
    -------
    Report
        Paths of the HTML file and of the folder.

    Raises
    ------
    InputError
        If a file cannot be used.
    """
    from eimi_lab.process.workers import executor_for
    from eimi_lab.reporting.page import write_report

    given = several(fit)
    folder = None if assets is None else Path(assets)
    with closed_meanwhile(several(datasets)) as paths, TemporaryDirectory() as memory:
        stored = files(*given)
        in_memory = fits_of([source for source in given if not isinstance(source, str | Path)])
        loaded = [fitted_law.fit for fitted_law in in_memory]
        check_distinct([*paths, *stored], [Path(output)])
        if loaded:
            stored.append(Fits.of(loaded).write(Path(memory) / "fits.json"))
        executor = executor_for(min(workers, len(paths)), None) if stored else None
        write_report(Path(output), paths, stored, force=force, assets=folder, executor=executor, progress=progress)
    return Report(Path(output), folder)


@named_options
def publish(
    runs: AnyPath | Sequence[AnyPath],
    output: AnyPath,
    *,
    title: str | None = None,
    people: AnyPath | None = None,
    licence: str | None = None,
    force: bool = False,
) -> Publication:
    """Write datasets, results and other files to a zip archive of the format RO-Crate 1.1, and check every hash in it.

    Parameters
    ----------
    runs : str or Path, or a sequence of these types
        Files, or folders of files.
    output : str or Path
        The archive; its name ends in ``.eln``.
    title : str
        Title of the archive; by default the name of the file without its ending.
    people : str or Path
        The file people.toml with the authors.
    licence : str
        SPDX identifier such as ``"CC-BY-4.0"``, or a URL.
    force : bool
        Replace an existing file.

    Returns
    -------
    Publication
        The archive, its files, and information that is missing for a reader of the archive.

    Raises
    ------
    InputError
        If a file cannot be read, is given twice, or belongs to a run that is not complete.
    OSError
        If a file changes while the archive is written, or if the disk is full.
    """
    authors = load_people(people) if people is not None else None
    paths = [Path(runs)] if isinstance(runs, str | Path) else [Path(run) for run in runs]
    return archive_of(paths, Path(output), title=title, people=authors, licence=licence, force=force)


@named_options
def export(
    fits: AnyFit,
    model: str | None = None,
    *,
    to: str,
    index: int | None = None,
    bulk_modulus_kPa: float | None = None,
    bulk_ratio: float | None = None,
    output: AnyPath | None = None,
    force: bool = False,
) -> str:
    """Return a fit as a material card for another finite-element program.

    Parameters
    ----------
    fits : FitRecord, Fits, str or Path
        Fits of datasets or of a tensile test.
    model : str
        Name of a law. It is not needed if ``fits`` contains only one law, or with ``index``.
    to : str
        Program that reads the card: ``"abaqus"``, ``"calculix"``, ``"ansys"``, ``"comsol"``, ``"febio"`` or
        ``"sofa"``.
    index : int
        Number of the fit, from 0, if several fits have this law.
    bulk_modulus_kPa : float
        Bulk modulus in the material card, kPa.
    bulk_ratio : float
        Bulk modulus divided by initial shear modulus, to be given in place of ``bulk_modulus_kPa``.
    output : str or Path
        File to write with the card.
    force : bool
        Replace an existing file.

    Returns
    -------
    str
        The text of the card.

    Raises
    ------
    InputError
        If a law or a file does not exist, or if the program does not support the law.
    """
    text, _ = card_of(fits, model, to, index, bulk_modulus_kPa, bulk_ratio)
    if output is not None:
        write_file(Path(output), text, force)
    return text


def card_of(
    fits: AnyFit,
    model: str | None,
    to: str,
    index: int | None,
    bulk_modulus_kPa: float | None,
    bulk_ratio: float | None,
) -> tuple[str, FitRecord | TensileRecord | RingDownRecord]:
    """Return the text of a material card and the fit that the card contains; for parameters and errors see `export`."""
    solver, fitted_laws = check_solver(to), fits_of(fits)
    records = [fitted_law.fit for fitted_law in fitted_laws]
    (name,) = check_models([_law_among(fitted_laws, model, index)])
    chosen = choose_fit(fitted_laws[0].path, records, name, index)
    bulk_Pa = bulk_modulus_Pa(chosen, solver, bulk_modulus_kPa, bulk_ratio)
    return card(fitted_laws[0].path, chosen, solver, bulk_Pa), chosen

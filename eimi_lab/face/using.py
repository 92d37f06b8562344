"""What a law or a fit is used for: simulation, validation, the next run, a report, a material card."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from eimi_fitting.laws import LAWS
from eimi_fitting.suggestion import suggestion
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
from eimi_lab.fits.simulated_fit import FittedLaw, Prediction
from eimi_lab.process.errors import InputError
from eimi_lab.process.outputs import check_distinct, refuse_existing, write_file
from eimi_lab.process.progress import progress
from eimi_lab.virtual.simulation import Simulation, keys_of, parse_parameters
from eimi_lab.virtual.simulation import simulate as simulated

_DRAWS = 60  # of a fit's, for the intervals of a simulation


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
    """Simulate a specimen of a known law in all states of a protocol.

    Parameters
    ----------
    protocol : str, Path or Protocol, or sequence of float
        A TOML file, the name of a shipped one, or what was loaded from one; or currents in A.
    specimen : str, Path or SpecimenFile
        The beam.
    model : str
        A law, a key of `LAWS`; not needed with a ``fit`` that holds one law.
    parameter : mapping, or sequence of str
        The law's parameters, moduli in Pa: ``{"mu": 46390.0}`` or ``["mu_Pa=46390"]``.
    fit : FitRecord, Fits, str or Path
        In place of parameters: the tip then has intervals.
    index : int
        Which fit of several.
    coil_constant : float
        Field for each ampere, mT.
    gravity_angle, field_angle : float
        In the beam frame, degrees from +x toward +y; gravity at 0 hangs, a field at 90 is across the beam.
    bulk_modulus_kPa : float
        Of a solid or in plane strain; incompressible without it.
    output : str or Path
        A folder to fill with tables, a figure and files for ParaView.
    force : bool
        Replace a folder that exists.

    Returns
    -------
    Simulation
        ``tip_mm``, ``tip_angle_deg``, ``edges_mm``, ``max_stretch`` and ``plot()``.

    Raises
    ------
    InputError
        For a name that does not exist, and for a state without an equilibrium.
    """
    if fit is None:
        if model is None:
            raise InputError(f"simulate: model is missing; {suggestion('', LAWS)}")
        (name,) = check_models([model])
        (law, values), drawn = parse_parameters(name, _parameter_texts(name, parameter)), None
    elif parameter:
        raise InputError("simulate: a fit contains the parameters; leave out fit or parameter")
    else:
        found = fits_of(fit)
        every = [one.fit for one in found]
        name = model or every[0].model
        chosen = choose_fit(found[0].path, every, name, index if index is not None or model or len(every) > 1 else 0)
        law, values, drawn = LAWS[chosen.model], np.array(chosen.values()), chosen.drawn(_DRAWS)
    currents_A = protocol_of(protocol).currents_A if isinstance(protocol, str | Path | Protocol) else protocol
    field_mT = coil_constant * np.asarray(currents_A, dtype=float)
    beam = specimen_of(specimen)
    result = simulated(beam, law, values, field_mT, gravity_angle, field_angle, bulk_modulus_kPa, drawn)
    if output is not None:
        result.write(output, force)
    return result


def _parameter_texts(model: str, parameter: Mapping[str, float] | Sequence[str]) -> list[str]:
    """As `--parameter` takes them. Raises InputError for a name that the law does not have."""
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
    """Compare fits with datasets that they have not seen, or with any others.

    Parameters
    ----------
    datasets : str, Path or Dataset, or a sequence of them
        What was measured.
    fit : FitRecord, Fits, str or Path, or a sequence of them
        Fits, or files of them.
    section : "solid", "plane-strain" or "plane-stress"
        In place of the specimen's.
    include_flagged : bool
        Use flagged states too.
    output : str or Path
        A validation.json to write.
    force : bool
        Replace a file that exists.

    Returns
    -------
    Validations
        A `Validation` for each dataset and fit, by its number; ``residuals()``, ``to_pandas()`` and ``plot()``.

    Raises
    ------
    InputError
        For a name that does not exist, and for a fit of this dataset under another section assumption.
    """
    chosen = check_section(section)
    fits = fits_of(fit)
    found: list[Prediction[FittedLaw]] = []
    with closed_meanwhile(several(datasets)) as paths:
        check_distinct([*paths, *files(*several(fit))], [] if output is None else [Path(output)])
        if output is not None:
            refuse_existing(Path(output), force)
        evidence = [load_evidence(path, section=chosen, flagged=include_flagged) for path in paths]
        with progress("validate", len(evidence)) as report:
            for seen in evidence:
                found += predict([(law, seen) for law in fits])
                report(f"{seen.path}, {len(fits)} fits")
    validations = Validations(tuple(found))
    if output is not None:
        validations.write(output, force)
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
    output: AnyPath | None = None,
    force: bool = False,
) -> Plan:
    """Choose the states to measure next, and say how narrow an interval to expect of them.

    Parameters
    ----------
    fits : FitRecord, Fits, str or Path
        Of an earlier run: its law and its noise.
    protocol : str, Path or Protocol
        Whose limits, ramp and settling the new one takes.
    specimen : str, Path or SpecimenFile, or a sequence of them
        Several, to have a choice.
    rig : str, Path or Rig
        Its limits and uncertainties.
    states : int
        How many; without it as many as the protocol has.
    goal : str
        ``"modulus"``, a parameter to narrow down, or a law to rule out.
    model : str
        Which law of the fits, where there are several.
    gravity_angle : float or sequence of float
        Mountings to choose from, degrees in the beam frame; without it the rig's.
    tip_weight : float or sequence of float
        Weights at the tip to choose from, grams.
    output : str or Path
        A protocol to write.
    force : bool
        Replace a file that exists.

    Returns
    -------
    Plan
        ``protocol`` of the best run, and all runs with what to expect of them.

    Raises
    ------
    InputError
        For a name that does not exist, and where too few states have an equilibrium.
    """
    base, bench, beams = protocol_of(protocol), rig_of(rig), [specimen_of(one) for one in several(specimen)]
    check_distinct(files(fits, protocol, rig, *several(specimen)), [] if output is None else [Path(output)])
    if output is not None:
        refuse_existing(Path(output), force)
    found = fits_of(fits)
    aim = planning.Goal.of(found[0].path, [one.fit for one in found], model, goal)
    choice = planning.mountings(beams, bench, several(gravity_angle), several(tip_weight))
    runs = planning.plan(aim, choice, bench, base, states or len(base.currents_A))
    planned = Plan(aim, tuple(runs), base)
    if output is not None:
        planned.write(output, force)
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
    """Write one self-contained HTML file: the number and what limits it, laws, errors, frames, residuals, methods.

    Parameters
    ----------
    datasets : str, Path or Dataset, or a sequence of them
        What was measured.
    output : str or Path
        The page to write.
    fit : FitRecord, Fits, str or Path, or a sequence of them
        Fits to lay over the datasets.
    assets : str or Path
        A folder for each figure as SVG and PDF, each table as CSV and LaTeX.
    workers : int
        Processes that share the work on several datasets.
    force : bool
        Replace files that exist.

    Returns
    -------
    Report
        The path of the page.

    Raises
    ------
    InputError
        For files that cannot be used.
    """
    from eimi_lab.process.workers import executor_for
    from eimi_lab.reporting.page import write_report

    given = several(fit)
    folder = None if assets is None else Path(assets)
    with closed_meanwhile(several(datasets)) as paths, TemporaryDirectory() as memory:
        stored = files(*given)
        loaded = [one.fit for one in fits_of([one for one in given if not isinstance(one, str | Path)])]
        check_distinct([*paths, *stored], [Path(output)])
        if loaded:
            stored.append(Fits.of(loaded).write(Path(memory) / "fits.json"))
        executor = executor_for(min(workers, len(paths)), None) if stored else None
        write_report(Path(output), paths, stored, force=force, assets=folder, executor=executor, progress=progress)
    return Report(Path(output), folder)


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
    """Return a fit as a material card of another finite-element program.

    Parameters
    ----------
    fits : FitRecord, Fits, str or Path
        Of datasets or of a tensile test.
    model : str
        A law; not needed for a single fit.
    to : str
        The program: ``"abaqus"``, ``"calculix"``, ``"ansys"``, ``"comsol"``, ``"febio"`` or ``"sofa"``.
    index : int
        Which fit, where several have the law.
    bulk_modulus_kPa, bulk_ratio : float
        One of the two: the bulk modulus, which no fit identifies, or its ratio to the initial shear modulus.
    output : str or Path
        A file to write as well.
    force : bool
        Replace a file that exists.

    Returns
    -------
    str
        The card.

    Raises
    ------
    InputError
        For a name that does not exist, and for a law that the program does not have.
    """
    solver, found = check_solver(to), fits_of(fits)
    every = [one.fit for one in found]
    (name,) = check_models([model or every[0].model])
    chosen = choose_fit(found[0].path, every, name, index)
    text = card(found[0].path, chosen, solver, bulk_modulus_Pa(chosen, bulk_modulus_kPa, bulk_ratio))
    if output is not None:
        write_file(Path(output), text, force)
    return text

"""Identify the parameters of material laws from datasets and tensile tests."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias, overload

from eimi_fitting.beam.specimen import Section
from eimi_fitting.inference.evidence.parameter_priors import Prior
from eimi_lab.face.given import AnyDataset, AnyPath, SectionName, closed_meanwhile, named_options, output_of, several
from eimi_lab.fits.evidence import Evidence
from eimi_lab.fits.fits_file import Fits, read_fits_file
from eimi_lab.fits.fitting import check_models, check_section
from eimi_lab.fits.options import FitOptions
from eimi_lab.fits.records import FitRecord
from eimi_lab.fits.simulated_fit import FittedLaw
from eimi_lab.fits.tensile_record import TensileRecord
from eimi_lab.fits.time_records import RingDownRecord
from eimi_lab.process.errors import InputError
from eimi_lab.process.outputs import check_distinct, refuse_existing
from eimi_lab.process.progress import progress
from eimi_lab.process.stopping import Stopped

if TYPE_CHECKING:
    from eimi_lab.fits.recorded_motions import MotionEvidence

AnyFit: TypeAlias = AnyPath | FitRecord | TensileRecord | RingDownRecord | Fits
"""Path of a fits.json, the fits of such a file, or one fit."""

IN_MEMORY = Path("(in memory)")
"""Path that is shown for a fit that was not read from a file."""


@named_options
def open_fits(path: AnyPath) -> Fits:
    """Read the fits of a file fits.json.

    Parameters
    ----------
    path : str or Path
        A file that was written by `fit`, `tensile`, ``eimi fit`` or ``eimi tensile``.

    Returns
    -------
    Fits
        The fits. A fit is selected by its number or by the name of its law: ``fits[0]``, ``fits["yeoh"]``.

    Raises
    ------
    InputError
        If the file cannot be read.
    """
    return read_fits_file(Path(path))


def fits_of(given: AnyFit | Sequence[AnyFit]) -> list[FittedLaw]:
    """Return all given fits, each fit with the path of its file and its number in the file.

    Raises InputError if a file cannot be read.
    """
    laws: list[FittedLaw] = []
    for source in several(given):
        if isinstance(source, FitRecord | TensileRecord | RingDownRecord):
            laws.append(FittedLaw(IN_MEMORY, len(laws), source))
        elif isinstance(source, Fits):
            laws += [FittedLaw(IN_MEMORY, len(laws) + index, fit) for index, fit in enumerate(source.fits)]
        else:
            path = Path(source)
            laws += [FittedLaw(path, index, fit) for index, fit in enumerate(read_fits_file(path).fits)]
    return laws


@overload
def fit(
    datasets: AnyDataset | Sequence[AnyDataset],
    model: str,
    *,
    prior: Prior | str | Sequence[Prior | str] = (),
    section: SectionName | None = None,
    include_flagged: bool = False,
    free: str | Sequence[str] = (),
    tensile: AnyPath | Sequence[AnyPath] = (),
    tensile_window: float | str | None = None,
    tensile_weight: float | None = None,
    restarts: int = 0,
    bipop: bool = False,
    time: Literal["none"] = "none",
    seed: int = 1,
    bootstrap: int = 0,
    workers: int = 1,
    scheduler: str | None = None,
    checkpoint: AnyPath | None = None,
    resume: bool = False,
    output: AnyPath | None = None,
    force: bool = False,
) -> FitRecord: ...
@overload
def fit(
    datasets: AnyDataset | Sequence[AnyDataset],
    model: str,
    *,
    prior: Prior | str | Sequence[Prior | str] = (),
    section: SectionName | None = None,
    include_flagged: bool = False,
    free: str | Sequence[str] = (),
    tensile: AnyPath | Sequence[AnyPath] = (),
    tensile_window: float | str | None = None,
    tensile_weight: float | None = None,
    restarts: int = 0,
    bipop: bool = False,
    time: Literal["prony"],
    seed: int = 1,
    bootstrap: int = 0,
    workers: int = 1,
    scheduler: str | None = None,
    checkpoint: AnyPath | None = None,
    resume: bool = False,
    output: AnyPath | None = None,
    force: bool = False,
) -> FitRecord | RingDownRecord: ...
@overload
def fit(
    datasets: AnyDataset | Sequence[AnyDataset],
    model: list[str] | tuple[str, ...],
    *,
    prior: Prior | str | Sequence[Prior | str] = (),
    section: SectionName | None = None,
    include_flagged: bool = False,
    free: str | Sequence[str] = (),
    tensile: AnyPath | Sequence[AnyPath] = (),
    tensile_window: float | str | None = None,
    tensile_weight: float | None = None,
    restarts: int = 0,
    bipop: bool = False,
    time: Literal["none", "prony"] = "none",
    seed: int | Sequence[int] = 1,
    each: bool = False,
    bootstrap: int = 0,
    workers: int = 1,
    scheduler: str | None = None,
    checkpoint: AnyPath | None = None,
    resume: bool = False,
    output: AnyPath | None = None,
    force: bool = False,
) -> Fits: ...
@named_options
def fit(
    datasets: AnyDataset | Sequence[AnyDataset],
    model: str | list[str] | tuple[str, ...],
    *,
    prior: Prior | str | Sequence[Prior | str] = (),
    section: SectionName | None = None,
    include_flagged: bool = False,
    free: str | Sequence[str] = (),
    tensile: AnyPath | Sequence[AnyPath] = (),
    tensile_window: float | str | None = None,
    tensile_weight: float | None = None,
    restarts: int = 0,
    bipop: bool = False,
    time: Literal["none", "prony"] = "none",
    seed: int | Sequence[int] = 1,
    each: bool = False,
    bootstrap: int = 0,
    workers: int = 1,
    scheduler: str | None = None,
    checkpoint: AnyPath | None = None,
    resume: bool = False,
    output: AnyPath | None = None,
    force: bool = False,
) -> FitRecord | RingDownRecord | Fits:
    """Identify the parameters of one or several laws from one or several datasets.

    If a dataset of frames has no edges yet, its edges are found first.

    Parameters
    ----------
    datasets : str, Path or Dataset, or a sequence of these types
        Measured datasets. Several datasets are fitted together.
    model : str, or a list of str
        Name of a law, which is a key of `LAWS`, or a list of names.
    prior : Prior or str, or a sequence of these types
        Gaussian prior of a parameter: ``Prior("C10", 20e3, 500.0)`` or ``"C10=20000,500"``. The numbers are the mean
        and the standard deviation in the unit of the parameter.
    section : "solid", "plane-strain" or "plane-stress"
        How the cross-section of the beam is modelled; by default as in the specimen file.
    include_flagged : bool
        Use also the states (load steps) that failed a quality check.
    free : str or sequence of str
        Uncertain quantity that is estimated together with the law, such as ``"width=0.02"``. The number is the standard
        deviation in mm, in degrees or as a fraction; by default the standard uncertainty in the input files.
        ``"bulk"`` estimates the bulk modulus.
    tensile : str or Path, or a sequence of these types
        Tensile curves that are fitted together with the datasets.
    tensile_window : float or str
        Largest strain of the tensile curves in per cent, or ``"full"`` for the whole curves. The default is 50.
    tensile_weight : float
        Factor that multiplies the weight of the tensile curves.
    restarts : int
        Number of restarts of the search. Each restart has twice the population (candidates per generation) of the
        previous search.
    bipop : bool
        Insert searches with a small population between the restarts.
    time : {"none", "prony"}
        ``"prony"`` also identifies a Prony series (viscoelasticity) from the recorded ring-downs (free vibrations) and
        creep. From a dataset without states, the dynamic modulus is identified.
    seed : int, or with a list of laws a sequence of int
        Seed of the random numbers of the search.
    each : bool
        Fit every dataset separately. This needs a list of laws. With ``time="prony"``, a dataset that holds recorded
        motions and no states is used in the fit of every dataset with states.
    bootstrap : int
        Number of bootstrap samples of the states; the fit is repeated on every sample.
    workers : int
        Number of parallel processes.
    scheduler : str
        Address of a dask cluster that computes the fit.
    checkpoint : str or Path
        File that stores every generation of the search, so that an interrupted fit can be continued.
    resume : bool
        Continue from the checkpoint, if this file exists.
    output : str or Path
        File fits.json to write.
    force : bool
        Replace existing files.

    Returns
    -------
    FitRecord, RingDownRecord or Fits
        For one law: a record with the parameters and the initial shear modulus, their intervals, and the methods
        ``residuals()``, ``to_pandas()``, ``to_xarray()`` and ``plot()``. It is a `RingDownRecord` if the datasets have
        motions but no states. For a list of laws: `Fits` with one record for each law.

    Raises
    ------
    InputError
        If a law or option does not exist, if a list is empty, or if no material explains the data.
    """
    if isinstance(model, str) and (each or not isinstance(seed, int)):
        raise InputError(
            "fit: each = True (a fit for each dataset) and several seeds give several fits of a law; give the law as a "
            f"list, model = [{model!r}], to get all of them"
        )
    for name, given in (("datasets", datasets), ("model", model), ("seed", seed)):
        if not several(given):
            raise InputError(f"fit: {name} is an empty list; give at least one element")
    if min(several(seed)) < 0:
        raise InputError(f"fit: seed = {min(several(seed))} should be 0 or more")
    options = FitOptions(
        section=section,
        include_flagged=include_flagged,
        free=several(free) or None,
        prior=[_prior_text(law_prior) for law_prior in several(prior)] or None,
        tensile=[Path(path) for path in several(tensile)] or None,
        tensile_window=None if tensile_window is None else f"{tensile_window}",
        tensile_weight=tensile_weight,
        restarts=restarts,
        bipop=bipop,
        time=time,
    )
    with closed_meanwhile(several(datasets)) as paths:
        fits, _ = identify_laws(
            paths,
            several(model),
            options,
            seeds=several(seed),
            each=each,
            bootstrap=bootstrap,
            workers=workers,
            scheduler=scheduler,
            checkpoint=None if checkpoint is None else Path(checkpoint),
            resume=resume,
            output=None if output is None else Path(output),
            force=force,
        )
    first = fits[0]
    return first if isinstance(model, str) and isinstance(first, FitRecord | RingDownRecord) else fits


def _prior_text(prior: Prior | str) -> str:
    """Return a prior as the text that the option `--prior` expects."""
    return prior if isinstance(prior, str) else f"{prior.parameter}={prior.mean!r},{prior.standard_deviation!r}"


def identify_laws(
    datasets: Sequence[Path],
    models: Sequence[str],
    options: FitOptions,
    *,
    seeds: Sequence[int] = (1,),
    each: bool = False,
    bootstrap: int = 0,
    workers: int = 1,
    scheduler: str | None = None,
    checkpoint: Path | None = None,
    resume: bool = False,
    output: Path | None = None,
    force: bool = False,
) -> tuple[Fits, list[Evidence]]:
    """Fit laws to datasets, and write the fits to ``output`` if it is given.

    The parameters are those of `fit`.

    Returns
    -------
    fits, evidence
        The fits, and for each dataset with states (load steps) the measured edges and loads.

    Raises
    ------
    InputError
        For the same reasons as `fit`.
    """
    from eimi_lab.fits.checkpoint import Checkpoint, Head
    from eimi_lab.fits.fit_grid import fit_grid, grid
    from eimi_lab.fits.records import package_versions
    from eimi_lab.process.workers import executor_for

    laws = check_models(models)
    section = check_section(options.section)
    options.check_laws(laws)
    check_distinct([*datasets, *(options.tensile or [])], [path for path in (output, checkpoint) if path])
    for_identify = options.for_identify()
    executor = executor_for(workers, scheduler)
    if output:
        refuse_existing(output, force)
    motions = _motions_of(datasets, section, each) if options.has_law_of_time else []
    with_states = [path for path, one in zip(datasets, motions, strict=True) if one.has_states] if motions else datasets
    if motions and not with_states:
        options.check_motions(datasets, {"--bootstrap": bootstrap, "--checkpoint": checkpoint, "--resume": resume})
        return _fits_of_motions(laws, motions, seeds, each, output, force), []
    evidence = [options.load(path) for path in with_states]
    options.check(evidence)
    tasks = grid(laws, evidence, seeds, each=each, bootstrap=bootstrap)
    log = None
    if checkpoint or resume:
        head = Head(
            fits=tuple(map(str, tasks)),
            datasets=tuple(e.sha256 for e in evidence),
            options=options.head(),
            versions=package_versions(),
        )
        log = Checkpoint.of(checkpoint, head, resume=resume, force=force)
    with _stopped_with(checkpoint), progress("fit", len(tasks)) as report:
        fits = fit_grid(
            tasks,
            for_identify,
            executor=executor,
            checkpoint=log,
            share_checkpoint=scheduler is None,
            report=report,
            underway=report.underway,
        )
    if motions:
        from eimi_lab.fits.time_fits import with_law_of_time

        motions = _motions_of(datasets, section, each)  # the edges of recorded frames may have been found just now
        fits = [with_law_of_time(record, evidence, motions) for record in fits]
    content = Fits.of(fits)
    if output:
        content.write(output, force)
    return content, evidence


def _motions_of(datasets: Sequence[Path], section: Section | None, each: bool) -> list[MotionEvidence]:
    """Return the recorded ring-downs (free vibrations) and creep of each dataset."""
    from eimi_lab.fits.recorded_motions import load_motions, with_ring_downs

    return with_ring_downs([load_motions(path, section) for path in datasets], each)


def _fits_of_motions(
    laws: Sequence[str],
    motions: Sequence[MotionEvidence],
    seeds: Sequence[int],
    each: bool,
    output: Path | None,
    force: bool,
) -> Fits:
    """Return the fits to datasets that have ring-downs (free vibrations) but no states (load steps at rest)."""
    from eimi_lab.fits.recorded_motions import fitted_together
    from eimi_lab.fits.time_fits import fit_motions

    groups = fitted_together(motions, each)
    content = Fits.of([fit_motions(law, group, seed) for group in groups for law in laws for seed in seeds])
    if output:
        content.write(output, force)
    return content


@contextmanager
def _stopped_with(checkpoint: Path | None) -> Iterator[None]:
    """Raise `Stopped` with advice on how to continue the fit, if a signal interrupts the ``with`` block."""
    try:
        yield
    except Stopped as stopped:
        left = (
            f"{checkpoint} contains all generations so far; the same command with --resume continues the fit"
            if checkpoint
            else "nothing of the fit is stored; a fit with --checkpoint FILE can be continued after an interruption"
        )
        raise Stopped(stopped.number, left) from stopped


@named_options
def tensile(
    curve: AnyPath,
    model: str | Sequence[str],
    *,
    window: float | str | Sequence[float | str] = (20, 50, 100, "full"),
    relative: bool = False,
    output: AnyPath | None = None,
    force: bool = False,
) -> Fits:
    """Fit laws to a tensile test by least squares of the stress.

    Parameters
    ----------
    curve : str or Path
        CSV file with strain and stress: a file of the Soft Robotics Materials Database, or two columns with a header.
    model : str, or a sequence of str
        Names of laws, which are keys of `LAWS`.
    window : float or str, or a sequence of these types
        Largest strains in per cent, or ``"full"`` for the whole curve. Each window gives a fit.
    relative : bool
        Minimise the differences of the stress divided by the measured stress.
    output : str or Path
        File fits.json to write.
    force : bool
        Replace an existing file.

    Returns
    -------
    Fits
        One fit for each window and law.

    Raises
    ------
    InputError
        If a law does not exist, or if the curve cannot be used.
    """
    from eimi_lab.fits.tensile_files import check_windows, read_tensile
    from eimi_lab.fits.tensile_fits import fit_window

    models, windows = check_models(several(model)), check_windows([f"{percent}" for percent in several(window)])
    path = output_of(output, [Path(curve)], force)
    test = read_tensile(Path(curve))
    fits = Fits.of([fit_window(test, name, percent, relative) for percent in windows for name in models])
    if path:
        fits.write(path, force)
    return fits

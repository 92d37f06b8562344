"""From datasets and tensile tests to laws."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TypeAlias, overload

from eimi_fitting.inference.evidence.parameter_priors import Prior
from eimi_lab.face.given import AnyDataset, AnyPath, SectionName, closed_meanwhile, named_options, several
from eimi_lab.face.results import Discovered
from eimi_lab.fits.evidence import Evidence, load_evidence
from eimi_lab.fits.fits_file import Fits, read_fits_file
from eimi_lab.fits.fitting import check_models, check_section
from eimi_lab.fits.options import FitOptions
from eimi_lab.fits.records import FitRecord, TensileRecord
from eimi_lab.fits.simulated_fit import FittedLaw
from eimi_lab.process.errors import InputError
from eimi_lab.process.outputs import check_distinct, refuse_existing
from eimi_lab.process.progress import progress

AnyFit: TypeAlias = AnyPath | FitRecord | TensileRecord | Fits
"""A path of fits.json, all that one holds, or a fit."""

IN_MEMORY = Path("(in memory)")
"""In place of the path of a fit that comes from no file."""


@named_options
def open_fits(path: AnyPath) -> Fits:
    """Read the fits of a fits.json.

    Parameters
    ----------
    path : str or Path
        What `fit` or `tensile` wrote, or `eimi fit` or `eimi tensile`.

    Returns
    -------
    Fits
        Had by number or by law: ``fits[0]``, ``fits["yeoh"]``.

    Raises
    ------
    InputError
        For a file that cannot be read, in one line that names it and the key.
    """
    return read_fits_file(Path(path))


def fits_of(given: AnyFit | Sequence[AnyFit]) -> list[FittedLaw]:
    """Return all fits with their file and their place in it. Raises InputError."""
    found: list[FittedLaw] = []
    for one in several(given):
        if isinstance(one, FitRecord | TensileRecord):
            found.append(FittedLaw(IN_MEMORY, len(found), one))
        elif isinstance(one, Fits):
            found += [FittedLaw(IN_MEMORY, len(found) + index, fit) for index, fit in enumerate(one.fits)]
        else:
            path = Path(one)
            found += [FittedLaw(path, index, fit) for index, fit in enumerate(read_fits_file(path).fits)]
    return found


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
    seed: int | Sequence[int] = 1,
    each: bool = False,
    bootstrap: int = 0,
    workers: int = 1,
    scheduler: str | None = None,
    checkpoint: AnyPath | None = None,
    resume: bool = False,
    output: AnyPath | None = None,
    force: bool = False,
) -> FitRecord | Fits:
    """Identify the parameters of a law, or of several, from one dataset or from several together.

    A dataset of frames that has no edges yet is segmented first.

    Parameters
    ----------
    datasets : str, Path or Dataset, or a sequence of them
        What was measured; several are fitted together.
    model : str, or a list of str
        A law, a key of `LAWS`; or laws, which gives `Fits`.
    prior : Prior or str, or a sequence of them
        What is known of the law's parameters: ``Prior("C10", 20e3, 500.0)`` or ``"C10=20000,500"``, mean and standard
        deviation in the parameter's unit.
    section : "solid", "plane-strain" or "plane-stress"
        In place of the specimen's.
    include_flagged : bool
        Fit flagged states too.
    free : str or sequence of str
        What is uncertain as one more unknown, with its standard deviation in mm, degrees or as a share, such as
        ``"width=0.02"``; without one it is what the files state; or ``"bulk"``.
    tensile : str or Path, or a sequence of them
        Tensile curves that the law has to follow as well.
    tensile_window : float or str
        Their largest strain in per cent, or ``"full"``; 50 without it.
    tensile_weight : float
        Multiplies what a curve's own noise makes it count.
    restarts, bipop
        Of the search: restarts with twice the population, and runs of a small one between them.
    seed : int, or with a list of laws a sequence of int
        Of the search.
    each : bool
        With a list of laws: fit every dataset apart.
    bootstrap : int
        Repeat each fit on so many replicates of its states.
    workers, scheduler
        Processes that share the work, or the address of a dask cluster.
    checkpoint, resume
        The log of all generations, and whether to go on with the one that is there.
    output : str or Path
        A fits.json to write.
    force : bool
        Replace files that exist.

    Returns
    -------
    FitRecord
        With one law: parameters and initial shear modulus with their intervals; ``residuals()``, ``to_pandas()``,
        ``to_xarray()`` and ``plot()``. With a list of laws `Fits`, which hold one for each.

    Raises
    ------
    InputError
        For a name that does not exist, and for data that no material explains, in one line that says what would be
        right.
    """
    if isinstance(model, str) and (each or not isinstance(seed, int)):
        raise InputError(f"fit: each and several seeds give several fits; give model = [{model!r}]")
    options = FitOptions(
        section=section,
        include_flagged=include_flagged,
        free=several(free) or None,
        prior=[_prior_text(one) for one in several(prior)] or None,
        tensile=[Path(path) for path in several(tensile)] or None,
        tensile_window=None if tensile_window is None else f"{tensile_window}",
        tensile_weight=tensile_weight,
        restarts=restarts,
        bipop=bipop,
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
    return first if isinstance(model, str) and isinstance(first, FitRecord) else fits


def _prior_text(prior: Prior | str) -> str:
    """As `--prior` takes it; every digit of the numbers is kept."""
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
    """Fit laws to datasets, write fits.json if it has a name, and return the fits and their evidence.

    Raises InputError as `fit` does.
    """
    from eimi_lab.fits.checkpoint import Checkpoint, Head
    from eimi_lab.fits.fit_grid import fit_grid, grid
    from eimi_lab.fits.records import package_versions
    from eimi_lab.process.workers import executor_for

    laws = check_models(models)
    check_section(options.section)
    options.check_laws(laws)
    check_distinct([*datasets, *(options.tensile or [])], [path for path in (output, checkpoint) if path])
    for_identify = options.for_identify()
    executor = executor_for(workers, scheduler)
    if output:
        refuse_existing(output, force)
    evidence = [options.load(path) for path in datasets]
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
    with progress("fit", len(tasks)) as report:
        fits = fit_grid(
            tasks,
            for_identify,
            executor=executor,
            checkpoint=log,
            share_checkpoint=scheduler is None,
            report=report,
            underway=report.underway,
        )
    content = Fits.of(fits)
    if output:
        content.write(output, force)
    return content, evidence


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
    """Fit laws to a tensile test, the conventional route.

    Parameters
    ----------
    curve : str or Path
        Strain and stress: the materials database's CSV, or two columns with a header.
    model : str, or a sequence of str
        Laws, keys of `LAWS`.
    window : float or str, or a sequence of them
        Largest strains in per cent, or ``"full"``.
    relative : bool
        Least squares on the relative error of the stress.
    output : str or Path
        A fits.json to write.
    force : bool
        Replace a file that exists.

    Returns
    -------
    Fits
        One fit for each window and law.

    Raises
    ------
    InputError
        For a name that does not exist and for a curve that cannot be used.
    """
    from eimi_lab.fits.tensile_files import check_windows, read_tensile
    from eimi_lab.fits.tensile_fits import fit_window

    models, windows = check_models(several(model)), check_windows([f"{one}" for one in several(window)])
    check_distinct([Path(curve)], [] if output is None else [Path(output)])
    if output is not None:
        refuse_existing(Path(output), force)
    test = read_tensile(Path(curve))
    fits = Fits.of([fit_window(test, name, percent, relative) for percent in windows for name in models])
    if output is not None:
        fits.write(Path(output), force)
    return fits


@named_options
def discover(
    datasets: AnyDataset | Sequence[AnyDataset],
    *,
    tensile: AnyPath | Sequence[AnyPath] = (),
    tensile_window: float | str = "full",
    term: str | Sequence[str] = (),
    most_terms: int = 3,
    lot: float = 0.02,
    section: SectionName | None = None,
    include_flagged: bool = False,
    seed: int = 1,
    output: AnyPath | None = None,
    force: bool = False,
) -> Discovered:
    """Find the terms of which a law is made, by the error of what was left out.

    Parameters
    ----------
    datasets : str, Path or Dataset, or a sequence of them
        Bending datasets of one material.
    tensile : str or Path, or a sequence of them
        Tensile curves of it.
    tensile_window : float or str
        Their largest strain in per cent, or ``"full"``.
    term : str or sequence of str
        The library: ``"i1"``, ``"i2"``, ``"i1^2"``, ``"gent=20"``, ``"fung=0.2"``, ``"ogden=-4"`` and so on.
    most_terms : int
        Of a law.
    lot : float
        By how much all moduli of beam and curve may differ, as a share; one standard deviation.
    section, include_flagged, seed
        See `fit`.
    output : str or Path
        A discovery.json to write.
    force : bool
        Replace a file that exists.

    Returns
    -------
    Discovered
        The statement, and the sets of terms that the data cannot tell apart.

    Raises
    ------
    InputError
        For a name that does not exist, and for data that cannot be used.
    """
    from eimi_lab.fits.discovering import content, discovered, library_of
    from eimi_lab.fits.tensile_files import check_windows, read_curve

    library, chosen = library_of(several(term)), check_section(section)
    (percent,) = check_windows([f"{tensile_window}"], "--tensile-window")
    curve_paths = [Path(path) for path in several(tensile)]
    with closed_meanwhile(several(datasets)) as paths:
        check_distinct([*paths, *curve_paths], [] if output is None else [Path(output)])
        if output is not None:
            refuse_existing(Path(output), force)
        curves = tuple(read_curve(path, percent, 1.0) for path in curve_paths)
        evidence = tuple(load_evidence(path, section=chosen, flagged=include_flagged) for path in paths)
        numbers = {"most_terms": most_terms, "lot": lot, "seed": seed}
        found = discovered(evidence, curves, library=library, **numbers)
    result = Discovered(found, content(found, evidence, curves, **numbers))
    if output is not None:
        result.write(output, force)
    return result

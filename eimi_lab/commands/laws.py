"""Commands about laws: identified, fitted to tensile tests, validated, exported, simulated."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eimi_lab.commands.options import Force, Output, Specimen


def fit(
    datasets: Annotated[list[Path], typer.Argument(help="one dataset or several, fitted together")],
    model: Annotated[list[str], typer.Option(help="neo-hookean, mooney-rivlin, yeoh or ogden; may be repeated")],
    output: Output,
    seed: Annotated[
        list[int] | None, typer.Option(help="of the search; stored in the result; may be repeated [1]", min=1)
    ] = None,
    section: Annotated[
        str | None, typer.Option(help="plane-strain or plane-stress, in place of the specimen's")
    ] = None,
    include_flagged: Annotated[bool, typer.Option("--include-flagged", help="fit flagged states too")] = False,
    free: Annotated[
        list[str] | None,
        typer.Option(help="known to a standard deviation only: moment=0.02, coil=0.01, roll=0.1, clamp=0.05; or bulk"),
    ] = None,
    tensile: Annotated[
        list[Path] | None, typer.Option(help="a tensile curve that the law has to follow as well; may be repeated")
    ] = None,
    tensile_window: Annotated[str | None, typer.Option(help="its largest strain in percent, or full [50]")] = None,
    tensile_weight: Annotated[
        float | None, typer.Option(help="multiplies what its own noise makes it count [1]")
    ] = None,
    each: Annotated[bool, typer.Option("--each", help="fit every dataset apart")] = False,
    bootstrap: Annotated[
        int, typer.Option(help="repeat each fit on so many replicates of its states", min=0, max=9999)
    ] = 0,
    restarts: Annotated[int, typer.Option(help="of the search, each with twice the population", min=0, max=9)] = 0,
    bipop: Annotated[bool, typer.Option("--bipop", help="between restarts, also runs of a small population")] = False,
    workers: Annotated[int, typer.Option(help="processes that share the fits, at most one a processor", min=1)] = 1,
    scheduler: Annotated[str | None, typer.Option(help="of a dask cluster, such as tcp://host:8786")] = None,
    checkpoint: Annotated[
        Path | None, typer.Option(help="the log of all generations, to go on from if this is killed")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="go on with the checkpoint, if there is one")] = False,
    force: Force = False,
) -> None:
    """Identify the parameters of one law or several; datasets without edges are segmented first."""
    from eimi_lab.identification.workers import executor_for, one_thread_each

    one_thread_each()
    from eimi_lab.identification.auxiliary import read_auxiliary
    from eimi_lab.identification.checkpoint import Checkpoint, Head
    from eimi_lab.identification.experiments import load_evidence
    from eimi_lab.identification.fit_summary import comparison_table, remarks
    from eimi_lab.identification.fits import write_fits
    from eimi_lab.identification.fitting import check_models, check_section
    from eimi_lab.identification.grid import fit_grid, grid
    from eimi_lab.identification.records import package_versions
    from eimi_lab.outputs import check_distinct, refuse_existing
    from eimi_lab.progress import progress

    models, chosen = check_models(model), check_section(section)
    check_distinct([*datasets, *(tensile or [])], [output, *([checkpoint] if checkpoint else [])])
    auxiliary = read_auxiliary(free or [], tensile or [], tensile_window, tensile_weight)
    executor = executor_for(workers, scheduler)
    refuse_existing(output, force)
    evidence = [load_evidence(path, section=chosen, flagged=include_flagged) for path in datasets]
    auxiliary.check(evidence)
    tasks = grid(models, evidence, seed or [1], each=each, bootstrap=bootstrap)
    options = {"restarts": restarts, "bipop": bipop}
    log = None
    if checkpoint or resume:
        head = Head(
            fits=tuple(map(str, tasks)),
            datasets=tuple(e.sha256 for e in evidence),
            options={**options, **auxiliary.head(), "section": section, "include_flagged": include_flagged},
            versions=package_versions(),
        )
        log = Checkpoint.of(checkpoint, head, resume=resume, force=force)
    with progress("fit", len(tasks)) as report:
        fits = fit_grid(
            tasks,
            {**options, **auxiliary.options()},
            executor=executor,
            checkpoint=log,
            share_checkpoint=scheduler is None,
            report=report,
        )
    write_fits(output, fits, force)
    for found in fits:
        print(found.summary())
        print("\n".join(f"  {line}" for line in remarks(found)))
    for line in comparison_table(fits):
        print(line)


def validate(
    datasets: Annotated[list[Path], typer.Argument(help="datasets that the fits have not seen, or any others")],
    fit: Annotated[list[Path], typer.Option(help="fits.json, of datasets or tensile tests; may be repeated")],
    output: Output,
    section: Annotated[
        str | None, typer.Option(help="plane-strain or plane-stress, in place of the specimen's")
    ] = None,
    include_flagged: Annotated[bool, typer.Option("--include-flagged", help="use flagged states too")] = False,
    by_state: Annotated[bool, typer.Option("--by-state", help="print error and deviation of every state")] = False,
    force: Force = False,
) -> None:
    """Every fit on every dataset: error and deviation by state, best fit first, then fits against specimens."""
    from eimi_lab.identification.experiments import load_evidence
    from eimi_lab.identification.fits import read_any_fits
    from eimi_lab.identification.fitting import check_section
    from eimi_lab.identification.validation import validate as simulate
    from eimi_lab.identification.validation import write_validation
    from eimi_lab.identification.validation_tables import by_dataset, matrix
    from eimi_lab.identification.validation_tables import by_state as state_tables
    from eimi_lab.outputs import check_distinct, refuse_existing
    from eimi_lab.progress import progress

    chosen = check_section(section)
    check_distinct([*datasets, *fit], [output])
    refuse_existing(output, force)
    fits = [(path, index, found) for path in fit for index, found in enumerate(read_any_fits(path))]
    evidence = [load_evidence(path, section=chosen, flagged=include_flagged) for path in datasets]
    validations = []
    with progress("validate", len(evidence)) as report:
        for seen in evidence:
            validations += [simulate(seen, found, path, index) for path, index, found in fits]
            report(f"{seen.path}, {len(fits)} fits")
    write_validation(output, validations, force)
    tables = by_dataset(validations) + (state_tables(validations) if by_state else [])
    if len(evidence) > 1:
        tables += matrix(validations)
    print("\n".join(tables))


def tensile(
    curve: Annotated[Path, typer.Argument(help="strain and stress: the materials database's CSV, or two columns")],
    model: Annotated[list[str], typer.Option(help="neo-hookean, mooney-rivlin, yeoh or ogden; may be repeated")],
    output: Output,
    window: Annotated[
        list[str] | None, typer.Option(help="largest strain in percent, or full; may be repeated [20 50 100 full]")
    ] = None,
    relative: Annotated[
        bool, typer.Option("--relative", help="least squares on the relative error of the stress")
    ] = False,
    force: Force = False,
) -> None:
    """Fit laws to a tensile test, the conventional route."""
    from eimi_lab.identification.fits import write_fits
    from eimi_lab.identification.fitting import check_models
    from eimi_lab.identification.tensile import WINDOWS, check_windows, fit_window, read_tensile
    from eimi_lab.outputs import check_distinct, refuse_existing

    models, windows = check_models(model), check_windows(window or list(WINDOWS))
    check_distinct([curve], [output])
    refuse_existing(output, force)
    test = read_tensile(curve)
    fits = [fit_window(test, name, percent, relative) for percent in windows for name in models]
    write_fits(output, fits, force)
    for found in fits:
        print(found.summary())


def export(
    fits: Annotated[Path, typer.Argument(help="fits.json, of datasets or of a tensile test")],
    model: Annotated[str, typer.Option(help="neo-hookean, mooney-rivlin, yeoh or ogden")],
    to: Annotated[str, typer.Option(help="abaqus, calculix, ansys, comsol, febio or sofa")],
    output: Annotated[Path | None, typer.Option("-o", "--output", help="the file to write; else it is printed")] = None,
    index: Annotated[int | None, typer.Option(help="which fit of the file, from 0, where several have the law")] = None,
    bulk_modulus_kPa: Annotated[
        float | None, typer.Option("--bulk-modulus-kPa", help="no fit identifies it, so state it")
    ] = None,
    bulk_ratio: Annotated[
        float | None, typer.Option("--bulk-ratio", help="in its place: bulk over initial shear modulus")
    ] = None,
    force: Force = False,
) -> None:
    """Write a fit as a material card of another finite-element program."""
    from eimi_lab.identification.cards import bulk_modulus_Pa, card, check_solver, choose_fit
    from eimi_lab.identification.fits import read_any_fits
    from eimi_lab.identification.fitting import check_models
    from eimi_lab.outputs import check_distinct, whole_file

    solver = check_solver(to)
    check_distinct([fits], [output] if output else [])
    (law,) = check_models([model])
    chosen = choose_fit(fits, read_any_fits(fits), law, index)
    text = card(fits, chosen, solver, bulk_modulus_Pa(chosen, bulk_modulus_kPa, bulk_ratio))
    if output is None:
        print(text, end="")
        return
    with whole_file(output, force) as temporary:
        temporary.write_text(text, encoding="utf-8")
    print(output)


def simulate(
    protocol: Annotated[str, typer.Argument(help="protocol.toml, or a shipped one such as dragon_skin_10")],
    specimen: Specimen,
    model: Annotated[str, typer.Option(help="neo-hookean, mooney-rivlin, yeoh or ogden")],
    parameter: Annotated[list[str], typer.Option(help="KEY=NUMBER such as mu_Pa=46390; once for each of the law's")],
    output: Annotated[Path, typer.Option("-o", "--output", help="the folder to fill")],
    coil_constant: Annotated[float, typer.Option(help="mT for each ampere")] = 4.7,
    gravity_angle: Annotated[float, typer.Option(help="in the beam frame, degrees from +x toward +y; 0 hangs")] = 0.0,
    field_angle: Annotated[float, typer.Option(help="in the beam frame, as gravity's; 90 is across the beam")] = 90.0,
    bulk_modulus_kPa: Annotated[
        float | None, typer.Option("--bulk-modulus-kPa", help="of plane strain; incompressible without it")
    ] = None,
    force: Force = False,
) -> None:
    """Simulate a specimen of a known law: shapes, tip curve and stretch as CSV, figure and VTU for ParaView."""
    import numpy as np

    from eimi_lab.config.protocol import load_protocol
    from eimi_lab.config.specimen import load_specimen
    from eimi_lab.outputs import whole_folder
    from eimi_lab.simulation import parse_parameters, write_simulation
    from eimi_lab.simulation import simulate as run

    law, values = parse_parameters(model, parameter)
    beam, field_mT = load_specimen(specimen), coil_constant * np.array(load_protocol(protocol).currents_A)
    result = run(beam, law, values, field_mT, gravity_angle, field_angle, bulk_modulus_kPa)
    with whole_folder(output, force) as unfinished:
        write_simulation(unfinished, result)
    print(f"{output}: {len(field_mT)} states, tip at {result.model.tip_angle_deg(result.shapes)[0, -1]:.2f} degrees")

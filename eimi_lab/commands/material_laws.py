"""Commands about laws: identified, fitted to tensile tests, validated, exported, simulated."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eimi_lab.commands.result import Result
from eimi_lab.commands.shared_options import Force, Output, Specimen, Workers, with_fields
from eimi_lab.fits.options import FitOptions

_DRAWS = 60  # of a fit's, for the intervals of a simulation


@with_fields(FitOptions)
def fit(
    datasets: Annotated[list[Path], typer.Argument(help="one dataset or several, fitted together")],
    model: Annotated[list[str], typer.Option(help="neo-hookean, mooney-rivlin, yeoh or ogden; may be repeated")],
    output: Output,
    options: FitOptions,
    seed: Annotated[
        list[int] | None, typer.Option(help="of the search; stored in the result; may be repeated [1]", min=1)
    ] = None,
    each: Annotated[bool, typer.Option("--each", help="fit every dataset apart")] = False,
    bootstrap: Annotated[
        int, typer.Option(help="repeat each fit on so many replicates of its states", min=0, max=9999)
    ] = 0,
    workers: Workers = 1,
    scheduler: Annotated[str | None, typer.Option(help="of a dask cluster, such as tcp://host:8786")] = None,
    checkpoint: Annotated[
        Path | None, typer.Option(help="the log of all generations, to go on from if this is killed")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="go on with the checkpoint, if there is one")] = False,
    force: Force = False,
) -> Result:
    """Identify the parameters of one law or several; datasets without edges are segmented first."""
    from eimi_lab.face.identifying import identify_laws
    from eimi_lab.fits.fit_summary import comparison_table, remarks, section_remarks
    from eimi_lab.fits.records import FitRecord

    content, evidence = identify_laws(
        datasets,
        model,
        options,
        seeds=seed or [1],
        each=each,
        bootstrap=bootstrap,
        workers=workers,
        scheduler=scheduler,
        checkpoint=checkpoint,
        resume=resume,
        output=output,
        force=force,
    )
    fits = [found for found in content if isinstance(found, FitRecord)]
    lines = list(dict.fromkeys(dataset.in_words() for found in fits for dataset in found.datasets))
    for found in fits:
        lines += [found.summary(), *(f"  {line}" for line in remarks(found))]
    return Result(
        [*lines, *comparison_table(content.comparison), *section_remarks(evidence)], content.model_dump(mode="json")
    )


def validate(
    datasets: Annotated[list[Path], typer.Argument(help="datasets that the fits have not seen, or any others")],
    fit: Annotated[list[Path], typer.Option(help="fits.json, of datasets or tensile tests; may be repeated")],
    output: Output,
    section: Annotated[
        str | None, typer.Option(metavar="solid|plane-strain|plane-stress", help="in place of the specimen's")
    ] = None,
    include_flagged: Annotated[bool, typer.Option("--include-flagged", help="use flagged states too")] = False,
    by_state: Annotated[bool, typer.Option("--by-state", help="print error and deviation of every state")] = False,
    force: Force = False,
) -> Result:
    """Every fit on every dataset: error and deviation by state, best fit first, then fits against specimens."""
    from eimi_lab.fits.evidence import load_evidence
    from eimi_lab.fits.fit_summary import section_remarks
    from eimi_lab.fits.fits_file import read_any_fits
    from eimi_lab.fits.fitting import check_section
    from eimi_lab.fits.prediction import predict
    from eimi_lab.fits.simulated_fit import FittedLaw
    from eimi_lab.fits.validation import write_validation
    from eimi_lab.fits.validation_tables import by_dataset, matrix
    from eimi_lab.fits.validation_tables import by_state as state_tables
    from eimi_lab.process.outputs import check_distinct, refuse_existing
    from eimi_lab.process.progress import progress

    chosen = check_section(section)
    check_distinct([*datasets, *fit], [output])
    refuse_existing(output, force)
    fits = [FittedLaw(path, index, found) for path in fit for index, found in enumerate(read_any_fits(path))]
    evidence = [load_evidence(path, section=chosen, flagged=include_flagged) for path in datasets]
    validations = []
    with progress("validate", len(evidence)) as report:
        for seen in evidence:
            validations += [prediction.validation for prediction in predict([(law, seen) for law in fits])]
            report(f"{seen.path}, {len(fits)} fits")
    content = write_validation(output, validations, force)
    tables = by_dataset(validations) + (state_tables(validations) if by_state else [])
    if len(evidence) > 1:
        tables += matrix(validations)
    return Result([*tables, *section_remarks(evidence)], content.model_dump(mode="json"))


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
) -> Result:
    """Fit laws to a tensile test, the conventional route."""
    from eimi_lab.fits.fit_summary import tensile_remarks
    from eimi_lab.fits.fits_file import write_fits
    from eimi_lab.fits.fitting import check_models
    from eimi_lab.fits.tensile_files import WINDOWS, check_windows, read_tensile
    from eimi_lab.fits.tensile_fits import fit_window
    from eimi_lab.process.outputs import check_distinct, refuse_existing

    models, windows = check_models(model), check_windows(window or list(WINDOWS))
    check_distinct([curve], [output])
    refuse_existing(output, force)
    test = read_tensile(curve)
    fits = [fit_window(test, name, percent, relative) for percent in windows for name in models]
    content = write_fits(output, fits, force)
    lines = []
    for found in fits:
        lines += [found.summary(), *(f"  {line}" for line in tensile_remarks(found))]
    return Result(lines, content.model_dump(mode="json"))


def export(
    fits: Annotated[Path, typer.Argument(help="fits.json, of datasets or of a tensile test")],
    model: Annotated[str, typer.Option(help="neo-hookean, mooney-rivlin, yeoh or ogden")],
    to: Annotated[str, typer.Option(metavar="abaqus|calculix|ansys|comsol|febio|sofa", help="which program's")],
    output: Annotated[Path | None, typer.Option("-o", "--output", help="the file to write; else it is printed")] = None,
    index: Annotated[int | None, typer.Option(help="which fit of the file, from 0, where several have the law")] = None,
    bulk_modulus_kPa: Annotated[
        float | None, typer.Option("--bulk-modulus-kPa", help="no fit identifies it, so state it")
    ] = None,
    bulk_ratio: Annotated[
        float | None, typer.Option("--bulk-ratio", help="in its place: bulk over initial shear modulus")
    ] = None,
    force: Force = False,
) -> Result:
    """Write a fit as a material card of another finite-element program."""
    from eimi_lab.fits.export import bulk_modulus_Pa, card, check_solver, choose_fit
    from eimi_lab.fits.fits_file import read_any_fits
    from eimi_lab.fits.fitting import check_models
    from eimi_lab.process.errors import tell
    from eimi_lab.process.outputs import check_distinct, write_file

    solver = check_solver(to)
    check_distinct([fits], [output] if output else [])
    (law,) = check_models([model])
    chosen = choose_fit(fits, read_any_fits(fits), law, index)
    text = card(fits, chosen, solver, bulk_modulus_Pa(chosen, bulk_modulus_kPa, bulk_ratio))
    for words in chosen.caveats():
        tell(f"{fits}: {law}: {words}")
    if output is None:
        return Result([text.removesuffix("\n")], {"card": text})
    write_file(output, text, force)
    return Result([output], {"card": text, "file": output})


def simulate(
    protocol: Annotated[str, typer.Argument(help="protocol.toml, or a shipped one such as dragon_skin_10")],
    specimen: Specimen,
    model: Annotated[str, typer.Option(help="neo-hookean, mooney-rivlin, yeoh or ogden")],
    output: Annotated[Path, typer.Option("-o", "--output", help="the folder to fill")],
    parameter: Annotated[
        list[str] | None, typer.Option(help="KEY=NUMBER such as mu_Pa=46390; once for each of the law's")
    ] = None,
    fit: Annotated[
        Path | None, typer.Option(help="fits.json in place of parameters: the tip gets its intervals")
    ] = None,
    index: Annotated[int | None, typer.Option(help="which fit of the file, from 0, where several have the law")] = None,
    coil_constant: Annotated[float, typer.Option(help="mT for each ampere")] = 4.7,
    gravity_angle: Annotated[float, typer.Option(help="in the beam frame, degrees from +x toward +y; 0 hangs")] = 0.0,
    field_angle: Annotated[float, typer.Option(help="in the beam frame, as gravity's; 90 is across the beam")] = 90.0,
    bulk_modulus_kPa: Annotated[
        float | None,
        typer.Option("--bulk-modulus-kPa", help="of a solid or in plane strain; incompressible without it"),
    ] = None,
    force: Force = False,
) -> Result:
    """Simulate a specimen of a known law: shapes, tip curve and stretch as CSV, figure and VTU for ParaView."""
    import numpy as np

    from eimi_fitting.laws import LAWS
    from eimi_lab.config.protocol import load_protocol
    from eimi_lab.config.specimen import load_specimen
    from eimi_lab.fits.export import choose_fit
    from eimi_lab.fits.fits_file import read_any_fits
    from eimi_lab.process.errors import InputError
    from eimi_lab.process.outputs import whole_folder
    from eimi_lab.virtual.simulation import parse_parameters, write_simulation
    from eimi_lab.virtual.simulation import simulate as run

    if fit is None:
        (law, values), drawn = parse_parameters(model, parameter or []), None
    elif parameter:
        raise InputError(f"--fit {fit}: has its parameters; give it or --parameter {parameter[0]}, not both")
    else:
        chosen = choose_fit(fit, read_any_fits(fit), model, index)
        law, values, drawn = LAWS[chosen.model], np.array(chosen.values()), chosen.drawn(_DRAWS)
    beam, field_mT = load_specimen(specimen), coil_constant * np.array(load_protocol(protocol).currents_A)
    result = run(beam, law, values, field_mT, gravity_angle, field_angle, bulk_modulus_kPa, drawn)
    with whole_folder(output, force) as unfinished:
        write_simulation(unfinished, result)
    low_high = "" if result.tips is None else " [{:.2f}, {:.2f}]".format(*result.tips[-1, 2])
    angle = result.model.tip_angle_deg(result.shapes)[0, -1]
    return Result(
        [f"{output}: {len(field_mT)} states, tip at {angle:.2f}{low_high} degrees"],
        {
            "folder": output,
            "field_mT": field_mT.tolist(),
            "tip_angle_deg": result.model.tip_angle_deg(result.shapes)[0].tolist(),
        },
    )

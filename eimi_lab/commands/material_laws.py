"""Commands for laws: fit, validate, tensile, export and simulate."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eimi_lab.commands.result import Result
from eimi_lab.commands.shared_options import Force, Output, Specimen, Workers, with_fields
from eimi_lab.fits.options import FitOptions

_DRAWS = 60  # parameter sets drawn from a fit, for the intervals of a simulation


@with_fields(FitOptions)
def fit(
    datasets: Annotated[list[Path], typer.Argument(help="one or more datasets, fitted together")],
    model: Annotated[
        list[str], typer.Option(metavar="LAW", help="neo-hookean, mooney-rivlin, yeoh or ogden; may be repeated")
    ],
    output: Output,
    options: FitOptions,
    seed: Annotated[
        list[int] | None,
        typer.Option(
            metavar="SEED",
            help="seed of the search, stored in the result; may be repeated",
            min=1,
            show_default="1",
        ),
    ] = None,
    each: Annotated[bool, typer.Option("--each", help="fit every dataset separately")] = False,
    bootstrap: Annotated[
        int, typer.Option(help="number of bootstrap replicates on which each fit is repeated", min=0, max=9999)
    ] = 0,
    workers: Workers = 1,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="scheduler of a dask cluster, such as tcp://host:8786")
    ] = None,
    checkpoint: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="log of all generations, from which --resume continues an interrupted fit"),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="continue from the checkpoint, if it exists")] = False,
    force: Force = False,
) -> Result:
    """Identify the parameters of one law or of several laws.

    Datasets without edges are segmented first.
    """
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
    fits = [record for record in content if isinstance(record, FitRecord)]
    lines = list(dict.fromkeys(dataset.in_words() for record in fits for dataset in record.datasets))
    for record in fits:
        lines += [record.summary(), *(f"  {line}" for line in remarks(record))]
    return Result(
        [*lines, *comparison_table(content.comparison), *section_remarks(evidence)], content.model_dump(mode="json")
    )


def validate(
    datasets: Annotated[
        list[Path], typer.Argument(help="datasets to predict, preferably datasets that were not fitted")
    ],
    fit: Annotated[
        list[Path], typer.Option(metavar="FILE", help="fits.json of datasets or of tensile tests; may be repeated")
    ],
    output: Output,
    section: Annotated[
        str | None,
        typer.Option(metavar="solid|plane-strain|plane-stress", help="section model, instead of the specimen's"),
    ] = None,
    include_flagged: Annotated[bool, typer.Option("--include-flagged", help="use flagged states as well")] = False,
    by_state: Annotated[
        bool, typer.Option("--by-state", help="also print the error and the deviation of every state")
    ] = False,
    force: Force = False,
) -> Result:
    """Compare the predictions of fits with measured datasets.

    Every fit predicts every dataset. The tables list the fits of each dataset, best first; for several datasets a
    matrix of fits and specimens follows.
    """
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
    fits = [FittedLaw(path, index, record) for path in fit for index, record in enumerate(read_any_fits(path))]
    evidence = [load_evidence(path, section=chosen, flagged=include_flagged) for path in datasets]
    validations = []
    with progress("validate", len(evidence)) as report:
        for measured in evidence:
            validations += [prediction.validation for prediction in predict([(law, measured) for law in fits])]
            report(f"{measured.path}, {len(fits)} fits")
    content = write_validation(output, validations, force)
    tables = by_dataset(validations) + (state_tables(validations) if by_state else [])
    if len(evidence) > 1:
        tables += matrix(validations)
    return Result([*tables, *section_remarks(evidence)], content.model_dump(mode="json"))


def tensile(
    curve: Annotated[
        Path, typer.Argument(help="CSV of strain and stress: two columns, or a Soft Robotics Materials Database file")
    ],
    model: Annotated[
        list[str], typer.Option(metavar="LAW", help="neo-hookean, mooney-rivlin, yeoh or ogden; may be repeated")
    ],
    output: Output,
    window: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PERCENT|full", help="largest strain that is fitted; may be repeated", show_default="20 50 100 full"
        ),
    ] = None,
    relative: Annotated[
        bool, typer.Option("--relative", help="minimise the relative error of the stress instead of the absolute error")
    ] = False,
    force: Force = False,
) -> Result:
    """Fit laws to a tensile test."""
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
    for tensile_fit in fits:
        lines += [tensile_fit.summary(), *(f"  {line}" for line in tensile_remarks(tensile_fit))]
    return Result(lines, content.model_dump(mode="json"))


def export(
    fits: Annotated[Path, typer.Argument(help="fits.json of datasets or of a tensile test")],
    model: Annotated[str, typer.Option(metavar="LAW", help="neo-hookean, mooney-rivlin, yeoh or ogden")],
    to: Annotated[
        str, typer.Option(metavar="abaqus|calculix|ansys|comsol|febio|sofa", help="program that reads the card")
    ],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE", help="file to write", show_default="print the card"),
    ] = None,
    index: Annotated[
        int | None, typer.Option(help="index of the fit in the file, from 0, if several fits have this law")
    ] = None,
    bulk_modulus_kPa: Annotated[
        float | None, typer.Option("--bulk-modulus-kPa", help="bulk modulus of the card; it is never taken from a fit")
    ] = None,
    bulk_ratio: Annotated[
        float | None, typer.Option("--bulk-ratio", help="instead: bulk modulus divided by initial shear modulus")
    ] = None,
    force: Force = False,
) -> Result:
    """Write a fit as a material card for a finite-element program."""
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
    protocol: Annotated[
        str, typer.Argument(help="protocol.toml, or the name of a shipped protocol such as dragon_skin_10")
    ],
    specimen: Specimen,
    model: Annotated[str, typer.Option(metavar="LAW", help="neo-hookean, mooney-rivlin, yeoh or ogden")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FOLDER", help="folder to write")],
    parameter: Annotated[
        list[str] | None,
        typer.Option(metavar="KEY=NUMBER", help="parameter of the law, such as mu_Pa=46390; once for each"),
    ] = None,
    fit: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="fits.json, instead of --parameter; the tip curve then has intervals"),
    ] = None,
    index: Annotated[
        int | None, typer.Option(help="index of the fit in the file, from 0, if several fits have this law")
    ] = None,
    coil_constant: Annotated[float, typer.Option(help="field per current, in mT/A")] = 4.7,
    gravity_angle: Annotated[
        float,
        typer.Option(
            metavar="DEG", help="direction of gravity in the beam frame, from +x toward +y; 0 if the beam hangs"
        ),
    ] = 0.0,
    field_angle: Annotated[
        float,
        typer.Option(
            metavar="DEG", help="direction of the field in the beam frame, from +x toward +y; 90 is across it"
        ),
    ] = 90.0,
    bulk_modulus_kPa: Annotated[
        float | None,
        typer.Option(
            "--bulk-modulus-kPa",
            help="bulk modulus, for a solid or for plane strain",
            show_default="incompressible",
        ),
    ] = None,
    force: Force = False,
) -> Result:
    """Simulate a specimen with a known law.

    The folder contains the shapes, the tip curve and the stretch as CSV, a figure, and VTU files for ParaView.
    """
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
        raise InputError(f"--fit {fit}: contains the parameters; leave out --fit or --parameter {parameter[0]}")
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

"""The commands `fit`, `validate`, `tensile`, `export` and `simulate`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from eimi_lab.commands.result import Result
from eimi_lab.commands.shared_options import Force, Output, Protocol, Specimen, Workers, with_fields
from eimi_lab.fits.options import FitOptions, IncludeFlagged, Section

Laws = Annotated[
    list[str],
    typer.Option(metavar="LAW", help="law to fit: neo-hookean, mooney-rivlin, yeoh or ogden; may be repeated"),
]
FitIndex = Annotated[
    int | None, typer.Option(help="index of the fit in the file (0 for the first fit), if several fits have this law")
]


@with_fields(FitOptions)
def fit(
    datasets: Annotated[
        list[Path], typer.Argument(help="one or more datasets, which are fitted together unless --each is given")
    ],
    model: Laws,
    output: Output,
    options: FitOptions,
    seed: Annotated[
        list[int] | None,
        typer.Option(
            metavar="SEED",
            help="seed of the random numbers of the search; each seed gives a fit; may be repeated",
            min=1,
            show_default="1",
        ),
    ] = None,
    each: Annotated[bool, typer.Option("--each", help="fit every dataset separately")] = False,
    bootstrap: Annotated[
        int,
        typer.Option(
            help="number of bootstrap samples: sets of states (load steps) that are drawn at random with replacement; "
            "each fit is repeated on every sample",
            min=0,
            max=9999,
        ),
    ] = 0,
    workers: Workers = 1,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS", help="address of a dask cluster that computes the fits, such as tcp://host:8786"
        ),
    ] = None,
    checkpoint: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="file that stores the progress of the search; --resume continues an interrupted fit from this file",
        ),
    ] = None,
    resume: Annotated[
        bool,
        typer.Option("--resume", help="continue the interrupted fit in the file of --checkpoint, if it exists"),
    ] = False,
    force: Force = False,
) -> Result:
    """Identify the parameters of one law or of several laws.

    If a dataset has no edges yet, its edges are found first.
    """
    from eimi_lab.face.identifying import identify_laws
    from eimi_lab.fits.fit_summary import comparison_table, evidence_remarks, remarks
    from eimi_lab.fits.records import FitRecord
    from eimi_lab.fits.time_records import RingDownRecord, time_lines

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
        if record.time is not None:
            lines += [f"  {line}" for line in time_lines(record.time)]
    for motion_record in (record for record in content if isinstance(record, RingDownRecord)):
        lines += [dataset.in_words() for dataset in motion_record.datasets]
        lines += [motion_record.summary(), *(f"  {line}" for line in time_lines(motion_record.time)[1:])]
    return Result(
        [*lines, *comparison_table(content.comparison), *evidence_remarks(evidence)], content.model_dump(mode="json")
    )


def validate(
    datasets: Annotated[
        list[Path],
        typer.Argument(help="datasets to compare with the fits, preferably datasets that were not used for the fits"),
    ],
    fit: Annotated[
        list[Path],
        typer.Option(metavar="FILE", help="fits.json with fits of datasets or of tensile tests; may be repeated"),
    ],
    output: Output,
    section: Section = None,
    include_flagged: IncludeFlagged = False,
    by_state: Annotated[
        bool,
        typer.Option(
            "--by-state",
            help="also print the error (root mean square distance between measured and simulated edges) of every state "
            "(load step)",
        ),
    ] = False,
    force: Force = False,
) -> Result:
    """Compare the predictions of fits with measured datasets.

    Every dataset is simulated with every fit. For each dataset, a table lists the fits, and the fit with the smallest
    error comes first. If there are several datasets, another table gives the errors of all fits for all datasets.
    """
    from eimi_lab.face.using import validate as validate_fits
    from eimi_lab.fits.fit_summary import evidence_remarks
    from eimi_lab.fits.fitting import check_section
    from eimi_lab.fits.validation_tables import by_dataset, matrix
    from eimi_lab.fits.validation_tables import by_state as state_tables

    judged = validate_fits(
        datasets, fit, section=check_section(section), include_flagged=include_flagged, output=output, force=force
    )
    validations = list(judged)
    tables = by_dataset(validations) + (state_tables(validations) if by_state else [])
    if len(datasets) > 1:
        tables += matrix(validations)
    return Result([*tables, *evidence_remarks(judged.evidence)], judged.content)


def tensile(
    curve: Annotated[
        Path,
        typer.Argument(
            help="CSV file with the column strain or strain_percent and the column stress_Pa, stress_kPa or stress_MPa "
            "(engineering strain and stress), or a file of the Soft Robotics Materials Database"
        ),
    ],
    model: Laws,
    output: Output,
    window: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PERCENT|full",
            help='largest strain that is fitted, in per cent, or "full"; repeat the option for several fits',
            show_default="20 50 100 full",
        ),
    ] = None,
    relative: Annotated[
        bool,
        typer.Option(
            "--relative", help="minimise the relative differences of the stress instead of the absolute differences"
        ),
    ] = False,
    force: Force = False,
) -> Result:
    """Fit laws to a tensile test."""
    from eimi_lab.face.identifying import tensile as fit_tensile_test
    from eimi_lab.fits.fit_summary import tensile_remarks
    from eimi_lab.fits.tensile_files import WINDOWS
    from eimi_lab.fits.tensile_record import TensileRecord

    fits = fit_tensile_test(curve, model, window=window or WINDOWS, relative=relative, output=output, force=force)
    lines = []
    for record in fits:
        assert isinstance(record, TensileRecord)
        lines += [record.summary(), *(f"  {line}" for line in tensile_remarks(record))]
    return Result(lines, fits.model_dump(mode="json"))


def export(
    fits: Annotated[Path, typer.Argument(help="fits.json with fits of datasets or of a tensile test")],
    model: Annotated[str, typer.Option(metavar="LAW", help="law to export: neo-hookean, mooney-rivlin, yeoh or ogden")],
    to: Annotated[
        str,
        typer.Option(
            metavar="abaqus|calculix|ansys|comsol|febio|sofa",
            help="finite-element program that reads the material card",
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE", help="file to write", show_default="print the card"),
    ] = None,
    index: FitIndex = None,
    bulk_modulus_kPa: Annotated[
        float | None,
        typer.Option(
            "--bulk-modulus-kPa",
            help="bulk modulus in the card, in kPa. Give this option or --bulk-ratio; a bulk modulus in fits.json is "
            "not used",
        ),
    ] = None,
    bulk_ratio: Annotated[
        float | None,
        typer.Option(
            "--bulk-ratio",
            help="instead of --bulk-modulus-kPa: bulk modulus in the card divided by the initial shear modulus",
        ),
    ] = None,
    force: Force = False,
) -> Result:
    """Write a fit as a material card for a finite-element program."""
    from eimi_lab.face.using import card_of
    from eimi_lab.process.errors import tell
    from eimi_lab.process.outputs import check_distinct, write_file

    check_distinct([fits], [output] if output else [])
    text, chosen = card_of(fits, model, to, index, bulk_modulus_kPa, bulk_ratio)
    for words in chosen.caveats():
        tell(f"{fits}: {model}: {words}")
    if output is None:
        return Result([text.removesuffix("\n")], {"card": text})
    write_file(output, text, force)
    return Result([output], {"card": text, "file": output})


def simulate(
    protocol: Protocol,
    specimen: Specimen,
    model: Annotated[
        str, typer.Option(metavar="LAW", help="law of the material: neo-hookean, mooney-rivlin, yeoh or ogden")
    ],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FOLDER", help="folder to write")],
    parameter: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=NUMBER",
            help="parameter of the law: mu_Pa for neo-hookean; C10_Pa and C01_Pa for mooney-rivlin; C10_Pa, C20_Pa and "
            "C30_Pa for yeoh; mu1_Pa, alpha1, ..., mu3_Pa and alpha3 for ogden; may be repeated",
        ),
    ] = None,
    fit: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="fits.json whose parameters are used instead of --parameter; the positions of the tip then have 95 % "
            "intervals",
        ),
    ] = None,
    index: FitIndex = None,
    coil_constant: Annotated[float, typer.Option(help="field of the coil at the magnet, in mT for each ampere")] = 4.7,
    gravity_angle: Annotated[
        float,
        typer.Option(
            metavar="DEG",
            help="direction of gravity, from +x (along the straight beam) toward +y (across); 0 for a beam that hangs "
            "down",
        ),
    ] = 0.0,
    field_angle: Annotated[
        float,
        typer.Option(
            metavar="DEG",
            help="direction of the field of a positive current, from +x (along the straight beam) toward +y (across); "
            "90 is across the beam",
        ),
    ] = 90.0,
    bulk_modulus_kPa: Annotated[
        float | None,
        typer.Option(
            "--bulk-modulus-kPa",
            help="bulk modulus in kPa; only if the section in the specimen file is solid or plane-strain",
            show_default="incompressible",
        ),
    ] = None,
    force: Force = False,
) -> Result:
    """Simulate a specimen with a known law.

    The output folder contains CSV files (shapes, position of the tip as a function of the field, stretches), a figure,
    and VTU files for ParaView.
    """
    from eimi_lab.face.using import simulate as simulate_beam

    result = simulate_beam(
        protocol,
        specimen,
        model,
        parameter=parameter or (),
        fit=fit,
        index=index,
        coil_constant=coil_constant,
        gravity_angle=gravity_angle,
        field_angle=field_angle,
        bulk_modulus_kPa=bulk_modulus_kPa,
        output=output,
        force=force,
    )
    low_high = ""
    if result.tips is not None and math.isfinite(result.tips[-1, 2, 0]):
        low_high = " [{:.2f}, {:.2f}]".format(*result.tips[-1, 2])
    angles, remarks = result.tip_angle_deg.tolist(), list(result.remarks)
    return Result(
        [*remarks, f"{output}: {len(angles)} states, tip at {angles[-1]:.2f}{low_high} degrees"],
        {"folder": output, "field_mT": result.field_mT.tolist(), "tip_angle_deg": angles, "told": remarks},
    )

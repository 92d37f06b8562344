"""The commands `discover`, which finds the terms of a law, and `study`, which evaluates the method."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eimi_lab.commands.result import Result
from eimi_lab.commands.shared_options import Force, Output


def discover(
    datasets: Annotated[list[Path], typer.Argument(help="bending datasets of one material")],
    output: Output,
    tensile: Annotated[
        list[Path] | None, typer.Option(metavar="FILE", help="tensile curve of the same material; may be repeated")
    ] = None,
    tensile_window: Annotated[
        str, typer.Option(metavar="PERCENT|full", help="largest strain of the tensile curves that is used")
    ] = "full",
    term: Annotated[
        list[str] | None,
        typer.Option(
            metavar="i1|i2|i1^2|i1^3|gent=JM|fung=B|ogden=ALPHA",
            help="term of the library; may be repeated",
            show_default="i1 i2 i1^2 i1^3 gent=20 fung=0.2 ogden=-4 ogden=8",
        ),
    ] = None,
    most_terms: Annotated[int, typer.Option(help="largest number of terms in a law", min=1, max=5)] = 3,
    lot: Annotated[
        float,
        typer.Option(
            help="relative standard deviation by which the moduli of beam and tensile specimen differ", min=0.0
        ),
    ] = 0.02,
    section: Annotated[
        str | None,
        typer.Option(
            metavar="solid|plane-strain|plane-stress",
            help="section assumption; default: the section in the specimen file",
        ),
    ] = None,
    include_flagged: Annotated[bool, typer.Option("--include-flagged", help="use flagged states as well")] = False,
    seed: Annotated[int, typer.Option(help="seed of the search for the starting modulus", min=1)] = 1,
    force: Force = False,
) -> Result:
    """Find the terms of the law that the data support.

    Laws are compared by their error on data that were left out of their fit. If the data do not distinguish the laws,
    the result says so.
    """
    from eimi_lab.face.discovering import discover as discover_terms
    from eimi_lab.fits.discovering import lines
    from eimi_lab.fits.fitting import check_section

    discovered = discover_terms(
        datasets,
        tensile=tensile or (),
        tensile_window=tensile_window,
        term=term or (),
        most_terms=most_terms,
        lot=lot,
        section=check_section(section),
        include_flagged=include_flagged,
        seed=seed,
        output=output,
        force=force,
    )
    return Result(lines(discovered.discovery, output), discovered.content)


def study(
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="FOLDER", help="folder to write, or to continue")
    ] = Path("study"),
    quick: Annotated[
        bool, typer.Option("--quick", help="study one material, two specimen types, two laws and six states")
    ] = False,
    tensile_data: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="folder with published tensile tests: dragon*.csv and ecoflex*.csv"),
    ] = None,
    seed: Annotated[int, typer.Option(help="seed of the searches")] = 1,
    force: Force = False,
) -> Result:
    """Evaluate the method on virtual specimens of hidden materials.

    The study repeats the evaluation by Di Lecce et al. (2022). The same command continues a study that was interrupted.
    """
    from dataclasses import asdict

    from eimi_lab.process.progress import progress
    from eimi_lab.study.claims import verdicts
    from eimi_lab.study.extent import QUICK, WHOLE
    from eimi_lab.study.pages import write_pages
    from eimi_lab.study.stored_parts import StoredParts
    from eimi_lab.study.whole_study import StudyInputs, compute_all, steps

    inputs = StudyInputs.of(QUICK if quick else WHOLE, seed, tensile_data)
    parts = StoredParts.of(output, inputs.head(), force)
    with progress("study", steps(inputs.extent)) as report:
        findings = compute_all(inputs, parts, report)
    lines = write_pages(output, findings)
    return Result(lines, {"page": output / "study.md", "claims": [asdict(v) for v in verdicts(findings)]})

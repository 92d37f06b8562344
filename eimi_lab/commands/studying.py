"""The commands `discover`, which selects the terms of a law, and `study`, which evaluates the method."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eimi_lab.commands.result import Result
from eimi_lab.commands.shared_options import Force, Output
from eimi_lab.fits.options import IncludeFlagged, Section


def discover(
    datasets: Annotated[list[Path], typer.Argument(help="datasets of beams of one material")],
    output: Output,
    tensile: Annotated[
        list[Path] | None,
        typer.Option(metavar="FILE", help="tensile curve of the same material (CSV); may be repeated"),
    ] = None,
    tensile_window: Annotated[
        str,
        typer.Option(
            metavar="PERCENT|full",
            help="largest strain of the tensile curves that is fitted, in per cent; full for the whole curves",
        ),
    ] = "full",
    term: Annotated[
        list[str] | None,
        typer.Option(
            metavar="i1|i2|i1^2|i1^3|gent=JM|fung=B|ogden=ALPHA",
            help="one term of the strain energy that the program may select: I1 - 3 or a power of it (i1, i1^2, i1^3), "
            "I2 - 3 (i2), or a Gent, Fung or Ogden term with its fixed constant Jm, b or alpha, such as gent=20; "
            "repeat the option for each term",
            show_default="i1 i2 i1^2 i1^3 gent=20 fung=0.2 ogden=-4 ogden=8",
        ),
    ] = None,
    most_terms: Annotated[int, typer.Option(help="largest number of terms in a law", min=1, max=5)] = 3,
    lot: Annotated[
        float,
        typer.Option(
            help="how much the moduli of beam and tensile specimen may differ because they come from different lots "
            "(castings): standard deviation of the difference, as a fraction of the modulus",
            min=0.0,
        ),
    ] = 0.02,
    section: Section = None,
    include_flagged: IncludeFlagged = False,
    seed: Annotated[
        int,
        typer.Option(
            help="seed of the random numbers of the first (neo-hookean) fit, which gives the initial value of the "
            "modulus",
            min=1,
        ),
    ] = 1,
    force: Force = False,
) -> Result:
    """Select the terms of a material's law by cross-validation.

    A law is a sum of terms. Each law is fitted to a part of the data, and the laws are compared by their error on the
    other data. The result says whether the data distinguish the laws.
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
        Path,
        typer.Option("-o", "--output", metavar="FOLDER", help="folder to write, or folder of an interrupted study"),
    ] = Path("study"),
    quick: Annotated[
        bool, typer.Option("--quick", help="study only one material, two types of specimen, two laws and six states")
    ] = False,
    tensile_data: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="folder with published tensile tests (dragon*.csv and ecoflex*.csv), to which the laws are fitted too",
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="seed of the random numbers of all searches")] = 1,
    force: Force = False,
) -> Result:
    """Evaluate fits of virtual specimens whose law is known.

    The fits receive only edges and tensile curves. The true material is used only to simulate these data and to compute
    the errors of the fits. The study repeats the evaluation by Di Lecce et al. (2022, doi 10.3389/frobt.2021.790571).
    After an interruption, the same command continues the study.
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

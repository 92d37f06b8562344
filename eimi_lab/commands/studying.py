"""Commands that ask about laws and methods themselves: of what terms a law is, and what the method is worth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eimi_lab.commands.result import Result
from eimi_lab.commands.shared_options import Force, Output


def discover(
    datasets: Annotated[list[Path], typer.Argument(help="bending datasets of one material")],
    output: Output,
    tensile: Annotated[list[Path] | None, typer.Option(help="a tensile curve of it; may be repeated")] = None,
    tensile_window: Annotated[str, typer.Option(help="its largest strain in percent, or full")] = "full",
    term: Annotated[
        list[str] | None,
        typer.Option(
            metavar="i1|i2|i1^2|i1^3|gent=JM|fung=B|ogden=ALPHA",
            help="of the library; may be repeated [i1 i2 i1^2 i1^3 gent=20 fung=0.2 ogden=-4 ogden=8]",
        ),
    ] = None,
    most_terms: Annotated[int, typer.Option(help="of a law", min=1, max=5)] = 3,
    lot: Annotated[
        float, typer.Option(help="by how much all moduli of beam and curve may differ, one standard deviation", min=0.0)
    ] = 0.02,
    section: Annotated[
        str | None, typer.Option(metavar="solid|plane-strain|plane-stress", help="in place of the specimen's")
    ] = None,
    include_flagged: Annotated[bool, typer.Option("--include-flagged", help="use flagged states too")] = False,
    seed: Annotated[int, typer.Option(help="of the search for the modulus that begins it", min=1)] = 1,
    force: Force = False,
) -> Result:
    """Which terms a law is made of, by the error of what was left out; or that the data do not tell."""
    from eimi_lab.face.identifying import discover as discover_terms
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
    return Result(lines(discovered.found, output), discovered.content)


def study(
    output: Annotated[Path, typer.Option("-o", "--output", help="the folder to fill, or to go on with")] = Path(
        "study"
    ),
    quick: Annotated[bool, typer.Option("--quick", help="one material, two types, two laws, six states")] = False,
    tensile_data: Annotated[
        Path | None, typer.Option(help="a folder with published tensile tests, dragon*.csv and ecoflex*.csv")
    ] = None,
    seed: Annotated[int, typer.Option(help="of the searches")] = 1,
    force: Force = False,
) -> Result:
    """Evaluate the method as Di Lecce et al. 2022 did, on virtual specimens of hidden materials.

    A study that was ended goes on where it was.
    """
    from dataclasses import asdict

    from eimi_lab.process.progress import progress
    from eimi_lab.study.claims import verdicts
    from eimi_lab.study.extent import QUICK, WHOLE
    from eimi_lab.study.pages import write_pages
    from eimi_lab.study.stored_parts import StoredParts
    from eimi_lab.study.whole_study import StudyInputs, find, steps

    inputs = StudyInputs.of(QUICK if quick else WHOLE, seed, tensile_data)
    parts = StoredParts.of(output, inputs.head(), force)
    with progress("study", steps(inputs.extent)) as report:
        findings = find(inputs, parts, report)
    lines = write_pages(output, findings)
    return Result(lines, {"page": output / "study.md", "claims": [asdict(v) for v in verdicts(findings)]})

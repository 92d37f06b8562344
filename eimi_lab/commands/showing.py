"""Commands that show what was found: the report and the demonstration."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eimi_lab.commands.options import Force, Output, Specimen


def report(
    datasets: Annotated[list[Path], typer.Argument(help="the datasets to show")],
    output: Output,
    fit: Annotated[
        list[Path] | None,
        typer.Option(help="fits.json, of datasets or tensile tests, to lay over them; may be repeated"),
    ] = None,
    force: Force = False,
) -> None:
    """Write one self-contained HTML file: laws, stress-strain curves, errors, frames, simulated edges, convergence."""
    from eimi_lab.outputs import check_distinct, refuse_existing
    from eimi_lab.report.page import write_report

    check_distinct([*datasets, *(fit or [])], [output])
    refuse_existing(output, force)
    write_report(output, datasets, fit or [], force=force)
    print(output)


def demo(
    material: Annotated[
        str, typer.Option(help="dragon_skin_10 or ecoflex_00_50: what the hidden specimen is cast from")
    ] = "dragon_skin_10",
    specimen: Specimen = "type1",
    quick: Annotated[bool, typer.Option("--quick", help="one law on fewer states")] = False,
    seed: Annotated[int, typer.Option(help="of the search", min=1)] = 1,
    rig: Annotated[str, typer.Option(help="a virtual rig")] = "virtual",
    output: Annotated[Path, typer.Option("-o", "--output", help="the folder to fill")] = Path("eimi-demo"),
    force: Force = False,
) -> None:
    """Run the whole chain on the virtual rig and compare what it identifies with the hidden truth."""
    from eimi_lab.demonstration import demonstrate
    from eimi_lab.progress import progress

    done = demonstrate(output, material, specimen, rig, quick=quick, seed=seed, force=force, progress=progress)
    truth = ", ".join(f"{name} {value:g}" for name, value in done.true_parameters.items())
    print(f"truth: {done.true_model}, {truth}; initial shear modulus {done.scores[0].truth_Pa:.0f} Pa")
    for score in done.scores:
        print(f"{score.fit.summary()}; {score.difference_percent:+.2f} % from the truth")
    print(f"{done.dataset}\n{done.fits}\n{done.report}")

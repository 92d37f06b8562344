"""The command that evaluates the method itself."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eimi_lab.commands.result import Result
from eimi_lab.commands.shared_options import Force


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

    from eimi_lab.progress import progress
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

"""Commands that show what was found: the report and the demonstration."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer

from eimi_lab.commands.result import Result
from eimi_lab.commands.shared_options import Force, Output, Specimen

# Beside Python, what a result may depend on.
_PACKAGES = ("numpy", "scipy", "cma", "h5py", "opencv-python-headless")

_UNASKED = 4  # processes at most: each takes some hundred megabytes


def print_versions(asked: bool) -> None:
    """What `eimi --version` prints: the suite's version, Python's and those of the packages that matter."""
    if asked:
        import platform
        from importlib.metadata import version

        print(f"eimi-lab {version('eimi-lab')}")
        print(", ".join([f"python {platform.python_version()}", *(f"{name} {version(name)}" for name in _PACKAGES)]))
        raise typer.Exit


def report(
    datasets: Annotated[list[Path], typer.Argument(help="the datasets to show")],
    output: Output,
    fit: Annotated[
        list[Path] | None,
        typer.Option(help="fits.json, of datasets or tensile tests, to lay over them; may be repeated"),
    ] = None,
    assets: Annotated[
        Path | None, typer.Option(help="a folder for each figure as SVG and PDF, each table as CSV and LaTeX")
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(
            help="processes that share the work on several datasets, one a processor at most [default: to 4]",
            min=1,
        ),
    ] = None,
    force: Force = False,
) -> Result:
    """Write one self-contained HTML file: the number and what limits it, laws, errors, frames, residuals, methods."""
    from eimi_lab.process.outputs import check_distinct, refuse_existing
    from eimi_lab.process.progress import progress
    from eimi_lab.process.workers import executor_for, started

    check_distinct([*datasets, *(fit or [])], [output])
    refuse_existing(output, force)
    command = shlex.join(["eimi", *sys.argv[1:]])
    shared = min(workers or _UNASKED, len(datasets)) if fit else 1
    with started(executor_for(shared, None), shared, "eimi_lab.fits.prediction") as executor:
        from eimi_lab.reporting.page import write_report  # slow to load, as what the workers load meanwhile

        write_report(
            output,
            datasets,
            fit or [],
            force=force,
            assets=assets,
            command=command,
            executor=executor,
            progress=progress,
        )
    return Result([output, *([assets] if assets else [])], {"report": output, "assets": assets})


def demo(
    material: Annotated[
        str, typer.Option(metavar="dragon_skin_10|ecoflex_00_50", help="what the hidden specimen is cast from")
    ] = "dragon_skin_10",
    specimen: Specimen = "type1",
    quick: Annotated[bool, typer.Option("--quick", help="one law on fewer states")] = False,
    seed: Annotated[int, typer.Option(help="of the search", min=1)] = 1,
    rig: Annotated[str, typer.Option(help="a virtual rig")] = "virtual",
    output: Annotated[Path, typer.Option("-o", "--output", help="the folder to fill")] = Path("eimi-demo"),
    force: Force = False,
) -> Result:
    """Run the whole chain on the virtual rig and compare what it identifies with the hidden truth."""
    from eimi_lab.demonstration import demonstrate
    from eimi_lab.process.progress import progress

    done = demonstrate(output, material, specimen, rig, quick=quick, seed=seed, force=force, progress=progress)
    truth = ", ".join(f"{name} {value:g}" for name, value in done.true_parameters.items())
    first, files = done.scores[0], {"dataset": done.dataset, "fits": done.fits, "report": done.report}
    return Result(
        [
            f"truth: {done.true_model}, {truth}; initial shear modulus {first.truth_Pa:.0f} Pa",
            *(seen.in_words() for seen in first.fit.datasets),
            *(f"{score.fit.summary()}; {score.difference_percent:+.2f} % from the truth" for score in done.scores),
            *files.values(),
        ],
        {
            "truth": {"model": done.true_model, "parameters": done.true_parameters, "shear_modulus_Pa": first.truth_Pa},
            "fits": [
                {**score.fit.model_dump(mode="json"), "difference_percent": score.difference_percent}
                for score in done.scores
            ],
            "files": files,
        },
    )

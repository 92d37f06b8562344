"""The commands `report` and `demo`, and the text of `eimi --version`."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer

from eimi_lab.commands.result import Result
from eimi_lab.commands.shared_options import Force, Output, Specimen

# The packages on which results depend.
_PACKAGES = ("numpy", "scipy", "cma", "h5py", "opencv-python-headless")

_DEFAULT_WORKERS = 4  # largest number without --workers, because each process needs some hundred megabytes


def print_versions(asked: bool) -> None:
    """If ``asked`` is True, print the versions of eimi-lab, Python and some packages, and end the program."""
    if asked:
        import platform
        from importlib.metadata import version

        print(f"eimi-lab {version('eimi-lab')}")
        print(", ".join([f"python {platform.python_version()}", *(f"{name} {version(name)}" for name in _PACKAGES)]))
        raise typer.Exit


def report(
    datasets: Annotated[list[Path], typer.Argument(help="datasets to show in the report")],
    output: Output,
    fit: Annotated[
        list[Path] | None,
        typer.Option(metavar="FILE", help="fits.json with fits of the datasets or of tensile tests; may be repeated"),
    ] = None,
    assets: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="folder for all figures as SVG and PDF, and all tables as CSV and LaTeX"),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(
            help="number of processes that compute in parallel if there are several datasets; at most the number of "
            "processors",
            min=1,
            show_default="up to 4",
        ),
    ] = None,
    force: Force = False,
) -> Result:
    """Write an HTML report of datasets and their fits.

    The report is one HTML file. It shows the modulus and the main sources of its uncertainty. It also shows the laws,
    errors, frames, residuals and methods.
    """
    from eimi_lab.process.outputs import check_distinct, refuse_existing
    from eimi_lab.process.progress import progress
    from eimi_lab.process.workers import executor_for, started

    check_distinct([*datasets, *(fit or [])], [output])
    refuse_existing(output, force)
    command = shlex.join(["eimi", *sys.argv[1:]])
    shared = min(workers or _DEFAULT_WORKERS, len(datasets)) if fit else 1
    with started(executor_for(shared, None), shared, "eimi_lab.fits.prediction") as executor:
        from eimi_lab.reporting.page import (
            write_report,
        )  # slow to import; the workers import their modules at the same time

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
        str, typer.Option(metavar="dragon_skin_10|ecoflex_00_50", help="material of the virtual specimen")
    ] = "dragon_skin_10",
    specimen: Specimen = "type1",
    quick: Annotated[
        bool,
        typer.Option("--quick", help="save time: measure fewer states of the beam, and fit only neo-hookean"),
    ] = False,
    seed: Annotated[int, typer.Option(help="seed of the random numbers of the fits", min=1)] = 1,
    rig: Annotated[
        str,
        typer.Option(
            metavar="FILE", help="rig.toml of a virtual rig, or the name of a virtual rig that comes with the program"
        ),
    ] = "virtual",
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FOLDER", help="folder to write")] = Path(
        "eimi-demo"
    ),
    force: Force = False,
) -> Result:
    """Measure and fit a virtual specimen, whose true law is known.

    The program acquires a dataset on a virtual rig, finds the edges, fits laws and writes the report. None of these
    steps uses the true law of the specimen. The program then prints the difference of each fitted modulus from the true
    modulus.
    """
    from eimi_lab.face.demonstrating import demonstrate
    from eimi_lab.process.progress import progress

    done = demonstrate(output, material, specimen, rig, quick=quick, seed=seed, force=force, progress=progress)
    truth = ", ".join(f"{name} {value:g}" for name, value in done.true_parameters.items())
    first, files = done.scores[0], {"dataset": done.dataset, "fits": done.fits, "report": done.report}
    return Result(
        [
            f"truth: {done.true_model}, {truth}; initial shear modulus {first.truth_Pa:.0f} Pa",
            *(dataset.in_words() for dataset in first.fit.datasets),
            *(f"{score.fit.summary()}; {score.difference_percent:+.2f} % from the truth" for score in done.scores),
            *files.values(),
        ],
        {
            "truth": {"model": done.true_model, "parameters": done.true_parameters, "shear_modulus_Pa": first.truth_Pa},
            "fits": [{**score.fit.content(), "difference_percent": score.difference_percent} for score in done.scores],
            "files": files,
        },
    )

"""The command line: reads arguments, calls the suite, prints. `eimi --help` lists the commands.

Every command is a small function; what it needs is imported inside it, so that `eimi --help` is quick.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from eimi_lab.errors import InputError
from eimi_lab.stopping import Stopped, unwind_on_termination

app = typer.Typer(
    name="eimi",
    help="Measure a soft material in the deformation in which the robot will use it.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

Specimen = Annotated[str, typer.Option(help="specimen.toml, or the name of a shipped one such as type1")]
Output = Annotated[Path, typer.Option("-o", "--output", help="the file to write")]
Force = Annotated[bool, typer.Option("--force", help="replace files that exist")]


def main() -> None:
    """Run the command line and exit: 0 done, 2 bad input, 1 another failure, 128 + n stopped by signal n."""
    unwind_on_termination()
    sys.exit(_status())


def _status() -> int:
    """The exit status; whatever went wrong has then been told in one line on stderr."""
    try:
        return app(sys.argv[1:] or ["--help"], standalone_mode=False) or 0
    except InputError as error:
        return _tell(str(error), 2)
    except (KeyboardInterrupt, typer.Abort):
        return _tell("stopped by SIGINT", 130)
    except Stopped as stopped:
        return _tell(str(stopped), 128 + stopped.number)
    except Exception as error:
        from eimi_drivers.interfaces import InstrumentError, SwitchOffFailed

        if isinstance(error, SwitchOffFailed):
            return _tell(f"THE COIL MAY STILL BE ON, switch it off by hand: {error}", 1)
        if isinstance(error, InstrumentError | OSError):
            return _tell(str(error), 1)
        if hasattr(error, "format_message"):  # an unknown option, a missing argument: whichever click typer brings
            return _tell(f"{error.format_message()} (eimi --help lists commands, eimi COMMAND --help options)", 2)
        raise


def _tell(message: str, status: int) -> int:
    print("eimi: " + " ".join(message.split()), file=sys.stderr)
    return status


@app.command()
def acquire(
    protocol: Annotated[str, typer.Argument(help="protocol.toml, or a shipped one such as dragon_skin_10")],
    specimen: Specimen,
    rig: Annotated[str, typer.Option(help="rig.toml, or a shipped one such as virtual")],
    output: Annotated[Path | None, typer.Option("-o", "--output", help="the dataset to write")] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="tell what would be done, and do nothing")] = False,
    force: Force = False,
) -> None:
    """Run a protocol: currents, frames, dataset."""
    from eimi_lab.acquisition.bench import open_bench
    from eimi_lab.acquisition.run import acquire as run
    from eimi_lab.acquisition.run import check_request
    from eimi_lab.config.protocol import load_protocol
    from eimi_lab.config.rig import load_rig
    from eimi_lab.config.specimen import load_specimen
    from eimi_lab.outputs import refuse_existing
    from eimi_lab.progress import progress

    chosen, beam, bench_rig = load_protocol(protocol), load_specimen(specimen), load_rig(rig)
    check_request(chosen, beam, bench_rig)
    if dry_run:
        from eimi_lab.acquisition.dry_run import dry_run as tell_steps

        tell_steps(chosen, beam, bench_rig, print)
        return
    if output is None:
        raise InputError("-o FILE.h5 is missing: the dataset to write; only --dry-run does without")
    refuse_existing(output, force)
    with (
        open_bench(bench_rig, beam, chosen.limits) as bench,
        progress("acquire", len(chosen.currents_A)) as report,
    ):
        run(chosen, beam, bench_rig, bench, output, report, force)
    print(f"{output}: {len(chosen.currents_A)} states")


@app.command("import")
def import_(
    source: Annotated[Path, typer.Argument(help="folder of images, or points.csv with tracked points")],
    states: Annotated[Path, typer.Option(help="states.csv: frame (or state), current_A or field_mT, tip_force_N")],
    specimen: Specimen,
    output: Output,
    calibration: Annotated[Path | None, typer.Option(help="calibration.toml, for images")] = None,
    gravity_angle: Annotated[
        float | None,
        typer.Option(help="for tracked points: gravity in the beam frame, degrees from +x toward +y; 0 hangs down"),
    ] = None,
    force: Force = False,
) -> None:
    """Make a dataset of images or tracked points that a lab already has."""
    from eimi_lab.config.calibration import load_calibration
    from eimi_lab.config.specimen import load_specimen
    from eimi_lab.dataset.importing import import_frames, import_points

    if not source.exists():
        raise InputError(f"{source}: no such folder of images or table of points")
    beam = load_specimen(specimen)
    if source.is_dir():
        if calibration is None or gravity_angle is not None:
            raise InputError(f"{source}: images need --calibration, which holds the direction of gravity as well")
        count = import_frames(source, states, beam, load_calibration(calibration), output, force)
    else:
        if gravity_angle is None or calibration is not None:
            raise InputError(f"{source}: tracked points need --gravity-angle and no --calibration")
        count = import_points(source, states, beam, gravity_angle, output, force)
    print(f"{output}: {count} states")


@app.command()
def recover(
    crashed: Annotated[Path, typer.Argument(help="the dataset whose writer crashed")],
    output: Output,
    force: Force = False,
) -> None:
    """Bring back every state that a crashed run had acknowledged."""
    from eimi_lab.dataset.recovery import recover as copy_acknowledged

    print(f"{output}: {copy_acknowledged(crashed, output, force)} states")


@app.command()
def segment(
    dataset: Annotated[Path, typer.Argument(help="a dataset of frames")],
    csv: Annotated[Path | None, typer.Option(help="folder for the edges as CSV and quality.json")] = None,
    overlay: Annotated[Path | None, typer.Option(help="folder for pictures of the edges on the frames")] = None,
    force: Force = False,
) -> None:
    """Find the beam's edges in every state and store them in the dataset."""
    from eimi_lab.dataset.reading import open_dataset
    from eimi_lab.outputs import new_folder
    from eimi_lab.progress import progress
    from eimi_lab.segmentation import segment as find
    from eimi_lab.segmentation import write_csv, write_overlays

    with open_dataset(dataset) as opened:
        total = len(opened.states)
    for folder in (csv, overlay):
        if folder:
            new_folder(folder, force)
    with progress("segment", total) as report:
        edge_sets = find(dataset, report)
    if csv:
        write_csv(csv, edge_sets)
    if overlay:
        write_overlays(overlay, dataset, edge_sets)
    flagged = sum(bool(edge_set.flags) for edge_set in edge_sets)
    print(f"{dataset}: edges of {total} states, {flagged} with flags")


@app.command()
def instruments() -> None:
    """List supplies and cameras that are attached, and the driver that would serve each."""
    from eimi_drivers.discovery import discover

    result = discover()
    for found in result.found:
        print(f"{found.kind}: driver = {found.driver}, address or source = {found.address} ({found.text})")
    if not result.found:
        print("no supply and no camera found; `eimi emulate korad` serves an emulated supply")
    for note in result.notes:
        print(f"note: {note}")


@app.command()
def emulate(
    supply: Annotated[str, typer.Argument(help="the language of the emulated supply: korad or scpi")],
    tcp: Annotated[int | None, typer.Option(help="serve on this TCP port (0: any free one), not a terminal")] = None,
) -> None:
    """Serve an emulated supply with a coil on it, until Ctrl-C."""
    import threading

    from eimi_drivers.clock import WallClock
    from eimi_drivers.emulators.serve import DIALECTS, serve_pty, serve_tcp
    from eimi_drivers.emulators.serve import emulate as put_language_on
    from eimi_drivers.emulators.supply import CoilSupply

    if supply not in DIALECTS:
        raise InputError(f"SUPPLY = {supply!r} should be one of {', '.join(DIALECTS)}")
    instrument = put_language_on(supply, CoilSupply(WallClock()))
    with serve_pty(instrument) if tcp is None else serve_tcp(instrument, port=tcp) as address:
        print(f'driver = "{supply}"\naddress = "{address}"', flush=True)
        threading.Event().wait()


@app.command()
def fit(
    datasets: Annotated[list[Path], typer.Argument(help="one dataset or several, fitted together")],
    model: Annotated[list[str], typer.Option(help="neo-hookean, mooney-rivlin, yeoh or ogden; may be repeated")],
    output: Output,
    seed: Annotated[int, typer.Option(help="of the search; stored in the result", min=1)] = 1,
    section: Annotated[
        str | None, typer.Option(help="plane-strain or plane-stress, in place of the specimen's")
    ] = None,
    include_flagged: Annotated[bool, typer.Option("--include-flagged", help="fit flagged states too")] = False,
    force: Force = False,
) -> None:
    """Identify the parameters of one law or several; datasets without edges are segmented first."""
    from eimi_lab.identification.experiments import load_evidence
    from eimi_lab.identification.fits import write_fits
    from eimi_lab.identification.fitting import check_models, check_section, fit_evidence
    from eimi_lab.outputs import refuse_existing
    from eimi_lab.progress import progress

    models, chosen = check_models(model), check_section(section)
    refuse_existing(output, force)
    evidence = [load_evidence(path, section=chosen, flagged=include_flagged) for path in datasets]
    fits = []
    with progress("fit", len(models)) as report:
        for name in models:
            fits.append(fit_evidence(evidence, name, seed))
            report(f"{name}, mean error {1e3 * fits[-1].mean_error_mm:.2f} µm")
    write_fits(output, fits, force)
    for found in fits:
        print(found.summary())


@app.command()
def report(
    datasets: Annotated[list[Path], typer.Argument(help="the datasets to show")],
    output: Output,
    fit: Annotated[list[Path] | None, typer.Option(help="fits.json to lay over them; may be repeated")] = None,
    force: Force = False,
) -> None:
    """Write one self-contained HTML file: frames, simulated edges, errors, parameters, convergence."""
    from eimi_lab.identification.fits import read_fits
    from eimi_lab.outputs import refuse_existing
    from eimi_lab.report.page import write_report

    refuse_existing(output, force)
    write_report(output, datasets, [record for path in fit or [] for record in read_fits(path)], force=force)
    print(output)


@app.command()
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

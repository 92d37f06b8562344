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
    resume: Annotated[bool, typer.Option("--resume", help="go on with the run that the dataset holds")] = False,
    take_over: Annotated[
        bool, typer.Option("--take-over", help="switch off a supply whose output is found on, not refuse it")
    ] = False,
    note: Annotated[str, typer.Option(help="what you want the dataset to tell of this run")] = "",
    force: Force = False,
) -> None:
    """Run a protocol: currents, frames, dataset."""
    from eimi_lab.acquisition.bench import open_bench
    from eimi_lab.acquisition.run import acquire as run
    from eimi_lab.acquisition.run import check_request
    from eimi_lab.config.protocol import load_protocol
    from eimi_lab.config.rig import load_rig
    from eimi_lab.config.specimen import load_specimen
    from eimi_lab.dataset.file_system import network_file_system
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
    if not resume:
        refuse_existing(output, force)
    elif force or note:
        raise InputError("--resume goes on with what the dataset holds: give neither --force nor --note with it")
    if kind := network_file_system(output.parent):
        _tell(f"warning: {output} is on a network ({kind}): a crash may cost stored states; a local disk is safer", 0)
    with (
        open_bench(bench_rig, beam, chosen.limits) as bench,
        progress("acquire", len(chosen.currents_A)) as report,
    ):
        run(chosen, beam, bench_rig, bench, output, report, force, resume=resume, take_over=take_over, note=note)
    print(f"{output}: {len(chosen.currents_A)} states")


@app.command("import")
def import_(
    source: Annotated[Path, typer.Argument(help="folder of images, video, or points.csv with tracked points")],
    states: Annotated[Path, typer.Option(help="states.csv: frame (or state), current_A or field_mT, tip_force_N")],
    specimen: Specimen,
    output: Output,
    calibration: Annotated[Path | None, typer.Option(help="calibration.toml, for images")] = None,
    gravity_angle: Annotated[
        float | None,
        typer.Option(help="for tracked points: gravity in the beam frame, degrees from +x toward +y; 0 hangs down"),
    ] = None,
    average: Annotated[bool, typer.Option("--average", help="keep the mean of a state's frames, not each")] = False,
    force: Force = False,
) -> None:
    """Make a dataset of images, a video or tracked points that a lab already has."""
    from eimi_lab.config.calibration import load_calibration
    from eimi_lab.config.specimen import load_specimen
    from eimi_lab.dataset.importing import VIDEOS, import_frames, import_points
    from eimi_lab.progress import progress

    if not source.exists():
        raise InputError(f"{source}: no such folder of images, video or table of points")
    beam = load_specimen(specimen)
    if source.is_dir() or source.suffix.lower() in VIDEOS:
        if calibration is None or gravity_angle is not None:
            raise InputError(f"{source}: images need --calibration, which holds the direction of gravity as well")
        count = import_frames(source, states, beam, load_calibration(calibration), output, force, average, progress)
    else:
        if gravity_angle is None or calibration is not None:
            raise InputError(f"{source}: tracked points need --gravity-angle and no --calibration")
        count = import_points(source, states, beam, gravity_angle, output, force)
    print(f"{output}: {count} states")


@app.command()
def calibrate(
    output: Annotated[Path, typer.Option("-o", "--output", help="calibration.toml, or the board's PDF")],
    images: Annotated[list[Path] | None, typer.Argument(help="of a board; or one, of the beam or of a ruler")] = None,
    board: Annotated[str | None, typer.Option(help="charuco, checkerboard or circles")] = None,
    columns: Annotated[int, typer.Option(help="squares (or circles) in a row of the board")] = 20,
    rows: Annotated[int, typer.Option(help="rows of the board")] = 16,
    square_mm: Annotated[float, typer.Option(help="side of a square, or distance of the circles' centres")] = 2.0,
    board_error_percent: Annotated[float, typer.Option(help="by how much the print's scale may be wrong", min=0)] = 0.1,
    print_board: Annotated[
        bool, typer.Option("--print-board", help="write the board as a PDF to scale, no more")
    ] = False,
    mid_plane: Annotated[
        Path | None, typer.Option(help="image of the board in the beam's middle plane; else the first")
    ] = None,
    specimen: Annotated[
        str | None, typer.Option(help="without a board: specimen.toml of the beam that hangs at rest in the image")
    ] = None,
    width_tolerance_mm: Annotated[float, typer.Option(help="by how much its width may be wrong", min=0)] = 0.05,
    ruler_px: Annotated[
        tuple[float, float, float, float] | None, typer.Option(help="without a board: x y of both ends of a length")
    ] = None,
    ruler_mm: Annotated[float, typer.Option(help="that length")] = 0.0,
    coil_constant: Annotated[float | None, typer.Option(help="mT per ampere at the specimen")] = None,
    clamp_midpoint_px: Annotated[
        tuple[float, float] | None, typer.Option(help="x y of the middle of the clamp line, where the beam comes out")
    ] = None,
    axis_angle: Annotated[float, typer.Option(help="undeformed beam, degrees clockwise from the image's +x")] = 90.0,
    gravity_angle: Annotated[float | None, typer.Option(help="gravity; else along the beam")] = None,
    field_angle: Annotated[float | None, typer.Option(help="positive coil field; else 90 degrees less")] = None,
    telecentric: Annotated[bool, typer.Option("--telecentric", help="the lens is telecentric")] = False,
    force: Force = False,
) -> None:
    """Scale, distortion and orientation from images of a board, of the beam itself, or of a ruler."""
    from eimi_lab import calibrating
    from eimi_lab.config.specimen import load_specimen
    from eimi_lab.outputs import refuse_existing, whole_file
    from eimi_lab.vision.board import Board
    from eimi_lab.vision.board import print_board as write_board

    refuse_existing(output, force)
    if sum(way is not None for way in (board, specimen, ruler_px)) != 1:
        raise InputError("calibrate needs one of --board, --specimen and --ruler-px, and not more than one")
    try:
        pattern = Board(board, columns, rows, square_mm) if board else None  # type: ignore[arg-type]
    except ValueError as error:
        raise InputError(f"--board, --columns, --rows, --square-mm: {error}") from None
    if print_board:
        if pattern is None:
            raise InputError("--print-board needs --board: charuco, checkerboard or circles")
        with whole_file(output, force) as temporary:
            write_board(pattern, temporary)
        print(output)
        return
    if not images or (pattern is None and len(images) > 1):
        raise InputError("IMAGES: give the images of the board, or the one image of the beam or the ruler")
    if coil_constant is None or coil_constant <= 0 or clamp_midpoint_px is None:
        raise InputError("--coil-constant (greater than 0) and --clamp-midpoint-px are missing: no image tells them")
    gravity = axis_angle if gravity_angle is None else gravity_angle
    field = axis_angle - 90.0 if field_angle is None else field_angle
    setting = calibrating.Setting(coil_constant, clamp_midpoint_px, axis_angle, gravity, field, telecentric)
    if pattern:
        found, told = calibrating.from_board(
            images, mid_plane or images[0], pattern, setting, board_error_percent / 100.0
        )
    elif specimen:
        found, told = calibrating.from_beam(images[0], load_specimen(specimen), setting, width_tolerance_mm)
    else:
        found, told = calibrating.from_ruler(images[0], ruler_px or (0.0, 0.0, 0.0, 0.0), ruler_mm, setting)
    calibrating.write_calibration(found, output, force)
    uncertain = found.uncertainty
    for line in told:
        print(line)
    if uncertain:
        print(f"{found.pixels_per_mm:.4f} ± {uncertain.pixels_per_mm:.2g} px/mm")
        print(f"axis at {found.axis_angle_deg:.3f} ± {uncertain.axis_angle_deg:.2g} degrees")
    print(output)


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
    dark: Annotated[Path | None, typer.Option(help="image taken without light, to take off every frame")] = None,
    flat: Annotated[Path | None, typer.Option(help="image of the bare back-light, to even out the light")] = None,
    force: Force = False,
) -> None:
    """Find the beam's edges in every state and store them in the dataset."""
    from eimi_lab.dataset.reading import open_dataset
    from eimi_lab.outputs import new_folder
    from eimi_lab.progress import progress
    from eimi_lab.segmentation import read_correction, write_csv, write_overlays
    from eimi_lab.segmentation import segment as find

    with open_dataset(dataset) as opened:
        total = len(opened.states)
    correction = read_correction(dark, flat)
    for folder in (csv, overlay):
        if folder:
            new_folder(folder, force)
    with progress("segment", total) as report:
        edge_sets = find(dataset, report, correction)
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
def tensile(
    curve: Annotated[Path, typer.Argument(help="strain and stress: the materials database's CSV, or two columns")],
    model: Annotated[list[str], typer.Option(help="neo-hookean, mooney-rivlin, yeoh or ogden; may be repeated")],
    output: Output,
    window: Annotated[
        list[str] | None, typer.Option(help="largest strain in percent, or full; may be repeated [20 50 100 full]")
    ] = None,
    relative: Annotated[
        bool, typer.Option("--relative", help="least squares on the relative error of the stress")
    ] = False,
    force: Force = False,
) -> None:
    """Fit laws to a tensile test, the conventional route."""
    from eimi_lab.identification.fits import write_fits
    from eimi_lab.identification.fitting import check_models
    from eimi_lab.identification.tensile import WINDOWS, check_windows, fit_window, read_tensile
    from eimi_lab.outputs import refuse_existing

    models, windows = check_models(model), check_windows(window or list(WINDOWS))
    refuse_existing(output, force)
    test = read_tensile(curve)
    fits = [fit_window(test, name, percent, relative) for percent in windows for name in models]
    write_fits(output, fits, force)
    for found in fits:
        print(found.summary())


@app.command()
def validate(
    datasets: Annotated[list[Path], typer.Argument(help="datasets that the fits have not seen, or any others")],
    fit: Annotated[list[Path], typer.Option(help="fits.json, of datasets or tensile tests; may be repeated")],
    output: Output,
    section: Annotated[
        str | None, typer.Option(help="plane-strain or plane-stress, in place of the specimen's")
    ] = None,
    include_flagged: Annotated[bool, typer.Option("--include-flagged", help="use flagged states too")] = False,
    force: Force = False,
) -> None:
    """Every fit on every dataset: error and deviation by state, and a table with the best fit first."""
    from eimi_lab.identification.experiments import load_evidence
    from eimi_lab.identification.fits import read_any_fits
    from eimi_lab.identification.fitting import check_section
    from eimi_lab.identification.validation import table, write_validation
    from eimi_lab.identification.validation import validate as simulate
    from eimi_lab.outputs import refuse_existing
    from eimi_lab.progress import progress

    chosen = check_section(section)
    refuse_existing(output, force)
    fits = [(path, index, found) for path in fit for index, found in enumerate(read_any_fits(path))]
    evidence = [load_evidence(path, section=chosen, flagged=include_flagged) for path in datasets]
    validations = []
    with progress("validate", len(evidence)) as report:
        for seen in evidence:
            validations += [simulate(seen, found, path, index) for path, index, found in fits]
            report(f"{seen.path}, {len(fits)} fits")
    write_validation(output, validations, force)
    print("\n".join(table(validations)))


@app.command()
def export(
    fits: Annotated[Path, typer.Argument(help="fits.json, of datasets or of a tensile test")],
    model: Annotated[str, typer.Option(help="neo-hookean, mooney-rivlin, yeoh or ogden")],
    to: Annotated[str, typer.Option(help="abaqus, calculix, ansys, comsol, febio or sofa")],
    output: Annotated[Path | None, typer.Option("-o", "--output", help="the file to write; else it is printed")] = None,
    index: Annotated[int | None, typer.Option(help="which fit of the file, from 0, where several have the law")] = None,
    bulk_modulus_kPa: Annotated[
        float | None, typer.Option("--bulk-modulus-kPa", help="no fit identifies it, so state it")
    ] = None,
    bulk_ratio: Annotated[
        float | None, typer.Option("--bulk-ratio", help="in its place: bulk over initial shear modulus")
    ] = None,
    force: Force = False,
) -> None:
    """Write a fit as a material card of another finite-element program."""
    from eimi_lab.identification.cards import bulk_modulus_Pa, card, check_solver, choose_fit
    from eimi_lab.identification.fits import read_any_fits
    from eimi_lab.identification.fitting import check_models
    from eimi_lab.outputs import whole_file

    solver = check_solver(to)
    (law,) = check_models([model])
    chosen = choose_fit(fits, read_any_fits(fits), law, index)
    text = card(fits, chosen, solver, bulk_modulus_Pa(chosen, bulk_modulus_kPa, bulk_ratio))
    if output is None:
        print(text, end="")
        return
    with whole_file(output, force) as temporary:
        temporary.write_text(text, encoding="utf-8")
    print(output)


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


@app.command()
def simulate(
    protocol: Annotated[str, typer.Argument(help="protocol.toml, or a shipped one such as dragon_skin_10")],
    specimen: Specimen,
    model: Annotated[str, typer.Option(help="neo-hookean, mooney-rivlin, yeoh or ogden")],
    parameter: Annotated[list[str], typer.Option(help="KEY=NUMBER such as mu_Pa=46390; once for each of the law's")],
    output: Annotated[Path, typer.Option("-o", "--output", help="the folder to fill")],
    coil_constant: Annotated[float, typer.Option(help="mT for each ampere")] = 4.7,
    gravity_angle: Annotated[float, typer.Option(help="in the beam frame, degrees from +x toward +y; 0 hangs")] = 0.0,
    force: Force = False,
) -> None:
    """Simulate a specimen of a known law: shapes, tip curve and stretch as CSV, figure and VTU for ParaView."""
    import numpy as np

    from eimi_lab.config.protocol import load_protocol
    from eimi_lab.config.specimen import load_specimen
    from eimi_lab.outputs import new_folder
    from eimi_lab.simulation import parse_parameters, write_simulation
    from eimi_lab.simulation import simulate as run

    law, values = parse_parameters(model, parameter)
    beam, field_mT = load_specimen(specimen), coil_constant * np.array(load_protocol(protocol).currents_A)
    result = run(beam, law, values, field_mT, gravity_angle)
    new_folder(output, force)
    write_simulation(output, result)
    print(f"{output}: {len(field_mT)} states, tip at {result.model.tip_angle_deg(result.shapes)[0, -1]:.2f} degrees")

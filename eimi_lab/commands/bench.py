"""Commands at the bench: instruments, a run, and what is left of one that crashed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eimi_lab.commands.options import Force, Output, Specimen
from eimi_lab.errors import InputError, tell


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


def emulate(
    supply: Annotated[str, typer.Argument(help="which supply, by the name of its driver: korad, scpi, ...")],
    tcp: Annotated[
        int | None, typer.Option(help="serve on this TCP port (0: any free one), not a terminal", min=0, max=65535)
    ] = None,
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
        tell(f"warning: {output} is on a network ({kind}): a crash may cost stored states; a local disk is safer")
    with (
        open_bench(bench_rig, beam, chosen.limits) as bench,
        progress("acquire", len(chosen.currents_A)) as report,
    ):
        run(chosen, beam, bench_rig, bench, output, report, force, resume=resume, take_over=take_over, note=note)
    print(f"{output}: {len(chosen.currents_A)} states")


def recover(
    crashed: Annotated[Path, typer.Argument(help="the dataset whose writer crashed")],
    output: Output,
    force: Force = False,
) -> None:
    """Bring back every state that a crashed run had acknowledged, without the frames that are damaged."""
    from eimi_lab.dataset.recovery import recover as copy_acknowledged

    print(f"{output}: {copy_acknowledged(crashed, output, force)} states")

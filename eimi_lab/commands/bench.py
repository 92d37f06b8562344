"""Commands at the bench: instruments, a run, and what is left of one that crashed."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from eimi_lab.commands.result import Result
from eimi_lab.commands.shared_options import Force, Output, Specimen
from eimi_lab.process.errors import InputError


def instruments() -> Result:
    """List supplies and cameras that are attached, and the driver that would serve each."""
    from eimi_drivers.discovery import discover

    result = discover()
    lines = [
        f"{found.kind}: driver = {found.driver}, address or source = {found.address} ({found.text})"
        for found in result.found
    ] or ["no supply and no camera found; `eimi emulate korad` serves an emulated supply"]
    lines += [f"note: {note}" for note in result.notes]
    return Result(lines, {"found": [asdict(found) for found in result.found], "notes": result.notes})


def emulate(
    supply: Annotated[str, typer.Argument(help="which supply, by the name of its driver: korad, scpi, ...")],
    tcp: Annotated[
        int | None, typer.Option(help="serve on this TCP port (0: any free one), not a terminal", min=0, max=65535)
    ] = None,
) -> None:
    """Serve an emulated supply with a coil on it, until Ctrl-C."""
    import threading

    from eimi_drivers.clock import WallClock
    from eimi_drivers.emulators.coil_line import serve_coil
    from eimi_drivers.emulators.serve import DIALECTS, serve_pty, serve_tcp
    from eimi_drivers.emulators.serve import emulate as put_language_on
    from eimi_drivers.emulators.supply import CoilSupply

    if supply not in DIALECTS:
        raise InputError(f"SUPPLY = {supply!r} should be one of {', '.join(DIALECTS)}")
    coil = CoilSupply(WallClock())
    instrument = put_language_on(supply, coil)
    with serve_pty(instrument) if tcp is None else serve_tcp(instrument, port=tcp) as address, serve_coil(coil) as line:
        print(f'driver = "{supply}"\naddress = "{address}"')
        print(f'# and for a virtual beam in its coil: camera = {{ driver = "virtual", source = "{line}" }}', flush=True)
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
    transcript: Annotated[
        Path | None, typer.Option(help="write every exchange with the supply into this new file")
    ] = None,
    events: Annotated[
        bool, typer.Option("--events", help="print what happens on standard output, a JSON object a line")
    ] = False,
    force: Force = False,
    watched_by: Annotated[str | None, typer.Option(hidden=True, help="descriptors that a page reads")] = None,
) -> Result:
    """Run a protocol: currents, frames, dataset."""
    from eimi_lab.config.protocol import load_protocol
    from eimi_lab.config.rig import load_rig
    from eimi_lab.config.specimen import load_specimen
    from eimi_lab.face.acquiring import dry_steps, run_protocol
    from eimi_lab.process.outputs import check_distinct

    read = list(dict.fromkeys(map(Path, (protocol, specimen, rig))))
    if output is not None and not dry_run:
        check_distinct(read, [output])
    chosen, beam, bench_rig = load_protocol(protocol), load_specimen(specimen), load_rig(rig)
    if dry_run:
        if events:
            raise InputError("--dry-run begins no run and has no events: leave out --events")
        steps = dry_steps(chosen, beam, bench_rig)
        return Result(steps, {"dry_run": steps})
    if output is None:
        raise InputError("-o FILE.h5 is missing: the dataset to write; only --dry-run does without")
    stored = run_protocol(
        chosen,
        beam,
        bench_rig,
        output,
        resume=resume,
        take_over=take_over,
        note=note,
        transcript=transcript,
        events=events,
        force=force,
        watched_by=watched_by,
    )
    states = len(chosen.currents_A)
    lines = [] if events else [f"{stored}: {states} states"]  # the events alone are on standard output
    return Result(lines, {"dataset": stored, "states": states})


def recover(
    crashed: Annotated[Path, typer.Argument(help="the dataset of a run that died, or one that is damaged")],
    output: Output,
    force: Force = False,
) -> Result:
    """Bring back every state that a crashed run had acknowledged, without the frames that are damaged."""
    from eimi_lab.dataset.recovery import recover as copy_acknowledged

    states = copy_acknowledged(crashed, output, force)
    return Result([f"{output}: {states} states"], {"dataset": output, "states": states})

"""A dataset opened, and one taken on the bench."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, overload

from eimi_lab.config.protocol import Protocol
from eimi_lab.config.rig import Rig
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.dataset.reading import Dataset, open_dataset
from eimi_lab.face.given import (
    AnyDataset,
    AnyPath,
    AnyProtocol,
    AnyRig,
    AnySpecimen,
    files,
    named_options,
    protocol_of,
    rig_of,
    specimen_of,
)
from eimi_lab.process.errors import InputError, tell

STANDARD_OUTPUT = 1  # the number of its descriptor


@named_options
def open(path: AnyDataset) -> Dataset:
    """Open a dataset to read, also one that is being written or whose writer crashed.

    Parameters
    ----------
    path : str, Path or Dataset
        An HDF5 file; a dataset that is open is returned as it is.

    Returns
    -------
    Dataset
        Its states, images and edges. It closes at the end of a ``with``, by ``close()``, or when nobody has it.

    Raises
    ------
    InputError
        For a file that cannot be read, in one line that names it.
    """
    return path if isinstance(path, Dataset) else open_dataset(Path(path))


@dataclass(frozen=True)
class DryRun:
    """What a run would do, a line each, down to the messages to the supply; nothing was done."""

    lines: tuple[str, ...]

    def __repr__(self) -> str:
        return "\n".join(self.lines)


@overload
def acquire(
    protocol: AnyProtocol,
    specimen: AnySpecimen,
    rig: AnyRig,
    output: AnyPath,
    *,
    dry_run: Literal[False] = False,
    resume: bool = False,
    take_over: bool = False,
    note: str = "",
    transcript: AnyPath | None = None,
    force: bool = False,
) -> Dataset: ...
@overload
def acquire(
    protocol: AnyProtocol, specimen: AnySpecimen, rig: AnyRig, output: AnyPath | None = None, *, dry_run: Literal[True]
) -> DryRun: ...
@named_options
def acquire(
    protocol: AnyProtocol,
    specimen: AnySpecimen,
    rig: AnyRig,
    output: AnyPath | None = None,
    *,
    dry_run: bool = False,
    resume: bool = False,
    take_over: bool = False,
    note: str = "",
    transcript: AnyPath | None = None,
    force: bool = False,
) -> Dataset | DryRun:
    """Run a protocol on a rig: currents, frames, dataset. Ends with the coil off, whatever happens.

    Parameters
    ----------
    protocol, specimen, rig : str, Path or object
        TOML files, or names of shipped ones such as ``"dragon_skin_10"``, ``"type1"`` and ``"virtual"``; or what was
        loaded from one.
    output : str or Path
        The dataset to write.
    dry_run : bool
        Return what would be done, and do nothing.
    resume : bool
        Go on with the run that the dataset holds.
    take_over : bool
        Switch off a supply whose output is found on, instead of refusing it.
    note : str
        What the dataset is to tell of this run.
    transcript : str or Path
        A new file for every exchange with the supply.
    force : bool
        Replace a dataset that exists.

    Returns
    -------
    Dataset
        Open. With ``dry_run`` a `DryRun`.

    Raises
    ------
    InputError
        Before anything is switched on.
    InstrumentError
        For an instrument that does not do what it is told.
    """
    chosen, beam, bench_rig = protocol_of(protocol), specimen_of(specimen), rig_of(rig)
    if dry_run:
        return DryRun(tuple(dry_steps(chosen, beam, bench_rig)))
    if output is None:
        raise InputError("acquire: output is missing; give the dataset to write (only dry_run needs none)")
    stored = run_protocol(
        chosen,
        beam,
        bench_rig,
        Path(output),
        read=files(protocol, specimen, rig),
        resume=resume,
        take_over=take_over,
        note=note,
        transcript=None if transcript is None else Path(transcript),
        force=force,
    )
    return open_dataset(stored)


def dry_steps(protocol: Protocol, specimen: SpecimenFile, rig: Rig) -> list[str]:
    """Return what a run would do, a line each. Raises InputError."""
    from eimi_lab.acquisition.dry_run import dry_run
    from eimi_lab.acquisition.playback import pictures_needed
    from eimi_lab.acquisition.run import check_request

    check_request(protocol, specimen, rig)
    if words := pictures_needed(protocol, rig):
        tell(words)
    steps: list[str] = []
    dry_run(protocol, specimen, rig, steps.append)
    return steps


def run_protocol(
    protocol: Protocol,
    specimen: SpecimenFile,
    rig: Rig,
    output: Path,
    *,
    read: Sequence[Path] = (),
    resume: bool = False,
    take_over: bool = False,
    note: str = "",
    transcript: Path | None = None,
    events: bool = False,
    force: bool = False,
    watched_by: str | None = None,
) -> Path:
    """Run a protocol into a dataset and return where that is. Raises InputError and InstrumentError as `acquire` does.

    read: the files that protocol, specimen and rig came from, none of which may be the output; events: print what
    happens on standard output, a JSON object a line; watched_by: see `page.watched_run`.
    """
    from eimi_lab.acquisition.event_lines import heard_by
    from eimi_lab.acquisition.event_words import on_terminal
    from eimi_lab.acquisition.open_bench import open_bench
    from eimi_lab.acquisition.playback import pictures_needed
    from eimi_lab.acquisition.resuming import refuse_taken
    from eimi_lab.acquisition.run import acquire as run
    from eimi_lab.acquisition.run import check_request
    from eimi_lab.dataset.file_system import network_file_system
    from eimi_lab.page.watched_run import Descriptors, watched
    from eimi_lab.process.outputs import check_distinct, refuse_existing
    from eimi_lab.process.progress import progress
    from eimi_lab.process.writer_lock import only_writer

    check_distinct(read, [output])
    check_request(protocol, specimen, rig)
    if words := pictures_needed(protocol, rig):
        tell(words)
    if not resume:
        refuse_taken(output, force)
    elif force or note:
        raise InputError("--resume: continues the run in the dataset; leave out --force and --note")
    if transcript is not None:
        check_distinct([output], [transcript])
        refuse_existing(transcript, force=False)
        if rig.simulated:
            raise InputError("--transcript: a virtual supply exchanges no messages; leave it out")
    if kind := network_file_system(output.parent):
        tell(f"warning: {output} is on a network ({kind}): a crash may cost stored states; a local disk is safer")
    if sys.stdin is not None and sys.stdin.isatty():
        tell("p and Enter pause the run, with the coil off; Ctrl-C ends it")
    page = Descriptors.of(watched_by) if watched_by else None
    read_at = page.events if page else STANDARD_OUTPUT if events else None
    with (
        only_writer(output),
        progress("acquire", len(protocol.currents_A)) as report,
        heard_by(on_terminal(report), read_at) as on_event,
        open_bench(rig, specimen, protocol.limits, transcript, on_event=on_event, guardian_events=read_at) as bench,
        watched(page, bench, rig, on_event) as seen,
    ):
        return run(
            protocol,
            specimen,
            rig,
            seen.bench,
            output,
            on_event,
            force,
            resume=resume,
            take_over=take_over,
            note=note,
            show=seen.show,
            typed=seen.typed,
        )

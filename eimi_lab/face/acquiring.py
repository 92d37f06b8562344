"""Open a dataset, or acquire one on the bench."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, overload

from eimi_lab.acquisition.events import Event, OnEvent, ignore_event
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

STANDARD_OUTPUT = 1  # file descriptor


@named_options
def open(path: AnyDataset) -> Dataset:
    """Open a dataset for reading, even while a run writes it or after its writer crashed.

    Parameters
    ----------
    path : str, Path or Dataset
        An HDF5 file. A dataset that is open already is returned unchanged.

    Returns
    -------
    Dataset
        The dataset with its states, images and edges. It is closed at the end of a ``with`` block, by ``close()``, or
        when no variable refers to it any more.

    Raises
    ------
    InputError
        If the file cannot be read. The message names the file.
    """
    return path if isinstance(path, Dataset) else open_dataset(Path(path))


@dataclass(frozen=True)
class DryRun:
    """The steps of a run that was not carried out: one line for each step and for each message to the supply."""

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
    on_event: OnEvent = ignore_event,
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
    on_event: OnEvent = ignore_event,
    force: bool = False,
) -> Dataset | DryRun:
    """Run a protocol on a rig: set the currents, take frames and store them in a dataset.

    Every way out of the run, including errors and Ctrl-C, switches the coil off.

    Parameters
    ----------
    protocol, specimen, rig : str, Path or object
        TOML files, names of shipped files such as ``"dragon_skin_10"``, ``"type1"`` and ``"virtual"``, or objects
        loaded from such files.
    output : str or Path
        The dataset to write.
    dry_run : bool
        Return the steps of the run and do not carry them out.
    resume : bool
        Continue the run that the dataset holds.
    take_over : bool
        If the output of the supply is on before the run, switch it off. Otherwise the run is refused.
    note : str
        Text to store with the run in the dataset.
    transcript : str or Path
        New file that records every message to and from the supply.
    on_event : callable
        Receives every `Event` of the run, such as a stored state, in the thread of the run. An exception in it ends the
        run with the coil off.
    force : bool
        Replace an existing dataset.

    Returns
    -------
    Dataset
        The dataset, open for reading. With ``dry_run`` a `DryRun`.

    Raises
    ------
    InputError
        If protocol, specimen, rig or output cannot be used. The output of the supply was not switched on.
    InstrumentError
        If an instrument fails or does not follow a command.
    """
    chosen, beam, bench_rig = protocol_of(protocol), specimen_of(specimen), rig_of(rig)
    if dry_run:
        return DryRun(tuple(dry_steps(chosen, beam, bench_rig)[1]))
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
        on_event=on_event,
        force=force,
    )
    return open_dataset(stored)


def dry_steps(protocol: Protocol, specimen: SpecimenFile, rig: Rig) -> tuple[list[str], list[str]]:
    """Return the steps of a run that is not carried out: a summary, and all lines with every message to the supply.

    Raises InputError.
    """
    from eimi_lab.acquisition.dry_run import dry_run
    from eimi_lab.acquisition.playback import describe_recording_length
    from eimi_lab.acquisition.run import check_request

    check_request(protocol, specimen, rig)
    if length_in_words := describe_recording_length(protocol, rig):
        tell(length_in_words)
    summary: list[str] = []
    whole: list[str] = []

    def say(line: str) -> None:
        summary.append(line)
        if not line.startswith("…"):
            whole.append(line)

    dry_run(protocol, specimen, rig, say, whole.append)
    return summary, whole


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
    on_event: OnEvent = ignore_event,
    events: bool = False,
    force: bool = False,
    watched_by: str | None = None,
) -> Path:
    """Run a protocol, store its states in a dataset, and return the path of the dataset.

    The options that are not listed are those of `acquire`.

    Parameters
    ----------
    read : sequence of Path
        Files from which protocol, specimen and rig were loaded. None of them may be the output.
    events : bool
        Print the events of the run on standard output, one JSON object per line.
    watched_by : str or None
        File descriptors of the live page, see `page.watched_run`.

    Raises
    ------
    InputError, InstrumentError
        For the reasons given in `acquire`.
    """
    from eimi_lab.acquisition.event_lines import sending_events
    from eimi_lab.acquisition.event_words import on_terminal
    from eimi_lab.acquisition.open_bench import open_bench
    from eimi_lab.acquisition.playback import describe_recording_length
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
    if length_in_words := describe_recording_length(protocol, rig):
        tell(length_in_words)
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
    events_descriptor = page.events if page else STANDARD_OUTPUT if events else None
    with (
        only_writer(output),
        progress("acquire", protocol.recordings) as report,
        sending_events(_to_both(on_terminal(report), on_event), events_descriptor) as send,
        open_bench(
            rig,
            specimen,
            protocol.limits,
            transcript,
            on_event=send,
            guardian_events=events_descriptor,
            rate_Hz=protocol.rate_Hz,
        ) as bench,
        watched(page, bench, rig, send) as watched_run,
    ):
        return run(
            protocol,
            specimen,
            rig,
            watched_run.bench,
            output,
            send,
            force,
            resume=resume,
            take_over=take_over,
            note=note,
            show=watched_run.show,
            typed=watched_run.typed,
        )


def _to_both(first: OnEvent, second: OnEvent) -> OnEvent:
    def send(event: Event) -> None:
        first(event)
        second(event)

    return send

"""Open a dataset, or acquire a new dataset on the bench."""

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
    """Open a dataset for reading, even while a run writes it.

    Parameters
    ----------
    path : str, Path or Dataset
        Path of an HDF5 file. An open dataset is returned unchanged.

    Returns
    -------
    Dataset
        The dataset with its states (load steps), frames and edges. ``close()`` or the end of a ``with`` block closes
        the file.

    Raises
    ------
    InputError
        If the file cannot be read.
    """
    return path if isinstance(path, Dataset) else open_dataset(Path(path))


@dataclass(frozen=True)
class DryRun:
    """The steps of a dry run (a run without instruments), as lines of text."""

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
    """Run a protocol on a rig: set the currents, take frames, and store the frames in a dataset.

    The coil is switched off at the end of the run, also after an error or Ctrl-C.

    Parameters
    ----------
    protocol, specimen, rig : str, Path or object
        TOML files, names of shipped files such as ``"dragon_skin_10"``, ``"type1"`` and ``"virtual"``, or objects
        loaded from such files.
    output : str or Path
        The dataset to write.
    dry_run : bool
        Only return the steps of the run; no instrument is opened.
    resume : bool
        Continue the run that is stored in the dataset ``output``.
    take_over : bool
        Allow the run even if the output of the supply is on before the run; the output is then switched off first.
    note : str
        Text to store with the run in the dataset.
    transcript : str or Path
        New file for a record of every message to and from the supply.
    on_event : callable
        Function that gets every `Event` of the run, such as a stored state. An exception in this function ends the run.
    force : bool
        Replace an existing dataset.

    Returns
    -------
    Dataset
        The dataset, open for reading. With ``dry_run``, the result is a `DryRun`.

    Raises
    ------
    InputError
        If protocol, specimen, rig or output cannot be used. In this case the coil was not switched on.
    InstrumentError
        If an instrument fails or does not obey a command.
    """
    chosen, beam, bench_rig = protocol_of(protocol), specimen_of(specimen), rig_of(rig)
    if dry_run:
        return DryRun(tuple(dry_steps(chosen, beam, bench_rig)[1]))
    if output is None:
        raise InputError("acquire: output is missing; give the dataset to write, or dry_run = True")
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
    """Return the steps of a run without opening an instrument.

    Returns
    -------
    summary, lines
        A summary of the steps, and all steps with every message to the supply, as lines of text.

    Raises
    ------
    InputError
        If protocol, specimen and rig do not suit each other.
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
    """Run a protocol, store its states (load steps) in a dataset, and return the path of the dataset.

    The other parameters are those of `acquire`.

    Parameters
    ----------
    read : sequence of Path
        Files from which protocol, specimen and rig were loaded; the output must be another file.
    events : bool
        Print the events of the run on standard output, one JSON object in each line.
    watched_by : str or None
        File descriptors through which the live page and the run exchange messages; None without a page.

    Raises
    ------
    InputError, InstrumentError
        For the same reasons as `acquire`.
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
        raise InputError("--resume: continues the run in an existing dataset; leave out --force and --note")
    _check_note(note)
    if transcript is not None:
        check_distinct([output], [transcript])
        refuse_existing(transcript, force=False)
        if rig.simulated:
            raise InputError("--transcript: a virtual supply exchanges no messages; leave --transcript out")
    if kind := network_file_system(output.parent):
        tell(
            f"warning: {output} is on a network drive ({kind}): after a crash, stored states may be lost; a local disk "
            "is safer"
        )
    if sys.stdin is not None and sys.stdin.isatty():
        tell("press p and Enter to pause the run with the coil off; press Ctrl-C to end the run")
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


def _check_note(note: str) -> None:
    """Raise InputError if the note of a run cannot be stored, because it is not text in UTF-8."""
    try:
        note.encode()
    except UnicodeEncodeError as error:
        raise InputError(
            f"--note {note!a}: character {error.start + 1} is not text in UTF-8; write the note in UTF-8"
        ) from error


def _to_both(first: OnEvent, second: OnEvent) -> OnEvent:
    def send(event: Event) -> None:
        first(event)
        second(event)

    return send

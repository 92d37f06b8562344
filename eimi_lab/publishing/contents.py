"""The files of an archive, with the kind, size and hash of each file."""

from __future__ import annotations

import hashlib
import mimetypes
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath
from typing import Literal

from eimi_lab.config.toml import is_dataset
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.fits.fits_file import read_fits_file
from eimi_lab.fits.records import FitRecord
from eimi_lab.fits.tensile_record import TensileRecord
from eimi_lab.fits.time_records import RingDownRecord
from eimi_lab.process.errors import InputError
from eimi_lab.process.paths import followed

Kind = Literal["dataset", "fits", "text of a dataset", "other"]

TEXTS = ("specimen", "calibration", "protocol", "rig")
"""Names of the TOML files in the dataset of a run. The archive also contains each of them as a separate file."""

MEDIA_TYPES = {
    ".h5": "application/x-hdf5",
    ".toml": "application/toml",
    ".json": "application/json",
    ".inp": "text/plain",
    ".feb": "application/xml",
    ".html": "text/html",
}


@dataclass(frozen=True)
class PublishedFile:
    """A file of an archive, with its description.

    Parameters
    ----------
    place
        Path in the archive, with "/" between folders.
    source
        The file on the disk; None for a TOML text from a dataset.
    kind
        "dataset", "fits" for a result file, "text of a dataset" for a TOML text from a dataset, or "other".
    size_bytes, sha256
        Size and SHA-256 hash of the content.
    changed
        Time of the last change, or start of the run, in ISO 8601.
    about
        One sentence that describes the content.
    text
        The content of a TOML text from a dataset.
    fits
        The fits of a result file.
    """

    place: PurePosixPath
    source: Path | None
    kind: Kind
    size_bytes: int
    sha256: str
    changed: str
    about: str
    text: bytes = b""
    fits: tuple[FitRecord | TensileRecord | RingDownRecord, ...] = field(default=(), repr=False)

    @property
    def media_type(self) -> str:
        """The media type of the file, from the ending of its name."""
        suffix = self.place.suffix.lower()
        return MEDIA_TYPES.get(suffix) or mimetypes.types_map.get(suffix, "application/octet-stream")


def gather(runs: Sequence[Path]) -> tuple[PublishedFile, ...]:
    """Return the files of an archive with their descriptions.

    Parameters
    ----------
    runs
        Datasets, results and other files, or folders that contain such files. Hidden files in a folder are left out.

    Raises
    ------
    InputError
        If a file does not exist or cannot be read, if two files have the same path in the archive, or if a dataset is
        still being written.
    """
    files: dict[PurePosixPath, PublishedFile] = {}
    for run in runs:
        for source, place in _files_of(run):
            for file in _described(source, place):
                if file.place in files:
                    raise InputError(f"{run}: the archive has a file {file.place} already; rename one of the two files")
                files[file.place] = file
    return tuple(files.values())


def _files_of(run: Path) -> Iterator[tuple[Path, PurePosixPath]]:
    """Yield the files of a run (a file or a folder) with their paths in the archive."""
    if run.is_file():
        yield run, PurePosixPath(run.name)
        return
    if not run.is_dir():
        raise InputError(f"{run}: there is no such file or folder")
    inside = {path: path.relative_to(run).parts for path in sorted(run.rglob("*")) if path.is_file()}
    visible = {path: parts for path, parts in inside.items() if not any(part.startswith(".") for part in parts)}
    if not visible:
        raise InputError(f"{run}: the folder has no files")
    for path, parts in visible.items():
        yield path, PurePosixPath(followed(run).name, *parts)


def _described(source: Path, place: PurePosixPath) -> Iterator[PublishedFile]:
    """Yield a file with its description and, for a dataset, the TOML texts in it."""
    try:
        with source.open("rb") as opened:
            sha256 = hashlib.file_digest(opened, "sha256").hexdigest()
        status = source.stat()
    except OSError as error:
        raise InputError(f"{source}: cannot be read ({error.strerror})") from error
    changed = datetime.fromtimestamp(status.st_mtime, UTC).isoformat(timespec="seconds")
    if is_dataset(source):
        yield from _dataset(source, place, status.st_size, sha256)
        return
    fits = _fits_of(source)
    about = f"Identified laws: {', '.join(dict.fromkeys(fit.model for fit in fits))}." if fits else ""
    kind: Kind = "fits" if fits else "other"
    yield PublishedFile(place, source, kind, status.st_size, sha256, changed, about, fits=fits)


def _fits_of(source: Path) -> tuple[FitRecord | TensileRecord | RingDownRecord, ...]:
    """Return the fits of a result file; empty for any other file."""
    if source.suffix.lower() != ".json":
        return ()
    try:
        return tuple(read_fits_file(source))
    except InputError:
        return ()


def _dataset(source: Path, place: PurePosixPath, size_bytes: int, sha256: str) -> Iterator[PublishedFile]:
    with open_dataset(source) as dataset:
        if not dataset.finished:
            raise InputError(
                f"{source}: is still being written, or its run crashed; wait for the end of the run, or use "
                "`eimi recover`"
            )
        beam = dataset.specimen.specimen
        start = dataset.start_time().isoformat(timespec="seconds")
        recorded = "frames" if dataset.kind == "frames" else "tracked points"
        about = (
            f"The beam {beam.name} of {beam.material} in {len(dataset.states)} states: {recorded}, as NeXus in HDF5."
        )
        texts = {name: text for name in TEXTS if (text := dataset.text(name)) is not None}
    yield PublishedFile(place, source, "dataset", size_bytes, sha256, start, about)
    for name, text in texts.items():
        content = text.encode()
        yield PublishedFile(
            place.with_name(f"{place.stem}_{name}.toml"),
            None,
            "text of a dataset",
            len(content),
            hashlib.sha256(content).hexdigest(),
            start,
            f"{name}.toml of the run, as {place.name} contains it.",
            content,
        )


def without_dataset(files: Sequence[PublishedFile]) -> tuple[str, ...]:
    """Return one line for each fit whose dataset is not in the archive."""
    published = {file.sha256 for file in files if file.kind == "dataset"}
    lines: dict[str, None] = {}
    for file in files:
        for fit in file.fits:
            for reference in fit.datasets if isinstance(fit, FitRecord) else ():
                if reference.sha256 not in published:
                    lines[
                        f"{file.place}: the archive does not contain the dataset of this fit, {reference.path} with "
                        f"the SHA-256 {reference.sha256[:16]}..."
                    ] = None
    return tuple(lines)

"""Write an archive of runs and results, and check the size and the hash of every file in it."""

from __future__ import annotations

import hashlib
import json
import shutil
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from urllib.parse import unquote

from eimi_lab.config.people import People
from eimi_lab.process.errors import InputError
from eimi_lab.process.outputs import check_distinct, refuse_existing, whole_file
from eimi_lab.process.progress import progress
from eimi_lab.publishing.contents import PublishedFile, gather, without_dataset
from eimi_lab.publishing.metadata import NAME, metadata

_PACKED = {".h5", ".html", ".png", ".jpg", ".zip", ".gz", ".mp4"}  # endings of files that are already compressed
_BLOCK_BYTES = 1 << 20


@dataclass(frozen=True)
class Publication:
    """An archive that was written and checked.

    Parameters
    ----------
    path
        The archive.
    files
        The files in the archive, without ro-crate-metadata.json.
    remarks
        One line for each missing item: authors, licence, or the dataset of a fit.
    """

    path: Path
    files: tuple[PublishedFile, ...]
    remarks: tuple[str, ...]


def publish(
    runs: Sequence[Path],
    output: Path,
    *,
    title: str | None = None,
    people: People | None = None,
    licence: str | None = None,
    force: bool = False,
) -> Publication:
    """Write datasets, results and other files into an archive (RO-Crate 1.1 in a zip file), and check the archive.

    Parameters
    ----------
    runs
        Files, or folders that contain files.
    output
        The archive. Its name ends in ``.eln`` or ``.zip``.
    title
        Name of the archive; by default the name of the file without its ending.
    people
        The authors.
    licence
        SPDX identifier or URL of the licence.
    force
        Whether an existing file is replaced.

    Returns
    -------
    Publication
        The archive.

    Raises
    ------
    InputError
        If a file cannot be read, is a dataset that is still being written, or has the same path in the archive as
        another file; or if the ending of the name or the licence is wrong.
    OSError
        If a file changed while the archive was written, or if the disk is full.
    """
    root = output.stem
    if output.suffix.lower() not in (".eln", ".zip"):
        raise InputError(f"{output}: the name of an archive should end in .eln or .zip")
    refuse_existing(output, force)
    files = gather(runs)
    check_distinct([file.source for file in files if file.source is not None], [output])
    description = json.dumps(metadata(files, title or root, people, licence), indent=1, ensure_ascii=False).encode()
    with whole_file(output, force) as temporary:
        _write(temporary, root, files, description)
        check(temporary)
    remarks = without_dataset(files)
    if people is None:
        remarks += ("no authors are given; --people people.toml gives a file with their names",)
    if licence is None:
        remarks += ("no licence is given, so that nobody may use the data; --licence CC-BY-4.0 gives a licence",)
    return Publication(output, files, remarks)


def _write(path: Path, root: str, files: Sequence[PublishedFile], description: bytes) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, progress("publish", len(files)) as report:
        archive.writestr(f"{root}/{NAME}", description)
        for file in files:
            place = f"{root}/{file.place}"
            if file.source is None:
                archive.writestr(place, file.text)
            else:
                about = zipfile.ZipInfo.from_file(file.source, place, strict_timestamps=False)
                about.compress_type = zipfile.ZIP_STORED if _is_packed(file.place) else zipfile.ZIP_DEFLATED
                with file.source.open("rb") as content, archive.open(about, "w") as packed:
                    shutil.copyfileobj(content, packed, _BLOCK_BYTES)
            report(str(file.place))


def _is_packed(place: PurePosixPath) -> bool:
    return place.suffix.lower() in _PACKED


def check(path: Path) -> int:
    """Check the size and the hash of every file in an archive, and return the number of files.

    Parameters
    ----------
    path
        The archive.

    Raises
    ------
    OSError
        If a file is missing or not described, or if its size or hash is wrong.
    """
    with zipfile.ZipFile(path) as archive:
        (root,) = {name.split("/")[0] for name in archive.namelist()}
        graph = json.loads(archive.read(f"{root}/{NAME}"))["@graph"]
        described = {unquote(node["@id"].removeprefix("./")): node for node in graph if node["@type"] == "File"}
        stored = {name.removeprefix(f"{root}/") for name in archive.namelist()} - {NAME}
        if stored != described.keys():
            raise OSError(
                f"{path}: {sorted(stored ^ described.keys())[0]} is in the archive but not in its description, or the "
                "reverse; publish again"
            )
        for place, node in described.items():
            with archive.open(f"{root}/{place}") as content:
                digest, size_bytes = hashlib.sha256(), 0
                while block := content.read(_BLOCK_BYTES):
                    digest.update(block)
                    size_bytes += len(block)
            if (digest.hexdigest(), str(size_bytes)) != (node["sha256"], node["contentSize"]):
                raise OSError(f"{path}: {place} changed while the archive was written; publish again")
    return len(described)

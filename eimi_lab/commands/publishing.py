"""The command `publish`, which writes an archive of datasets and results for a repository."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eimi_lab.commands.result import Result
from eimi_lab.commands.shared_options import Force, Output


def publish(
    runs: Annotated[
        list[Path],
        typer.Argument(help="datasets, fits.json, reports, material cards and other files, or folders of such files"),
    ],
    output: Output,
    title: Annotated[str | None, typer.Option(help="title of the archive", show_default="the name of the file")] = None,
    people: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="people.toml with the authors, each author in a table [[person]]"),
    ] = None,
    licence: Annotated[
        str | None, typer.Option(metavar="ID", help="licence: an SPDX identifier such as CC-BY-4.0, or a URL")
    ] = None,
    force: Force = False,
) -> Result:
    """Archive datasets, results and material cards.

    The archive is a zip file with the ending .eln in the format RO-Crate 1.1 (files and their description), which
    electronic lab notebooks can read. It contains the given files, the TOML files of each run, the hash of every file
    and the versions of the programs. After writing, the archive is read again and every hash is checked.
    """
    from eimi_lab.config.people import load_people
    from eimi_lab.process.errors import tell
    from eimi_lab.publishing.archive import publish as published

    archive = published(
        runs, output, title=title, people=load_people(people) if people else None, licence=licence, force=force
    )
    for remark in archive.remarks:
        tell(f"{output}: {remark}")
    sizes = sum(file.size_bytes for file in archive.files)
    return Result(
        [f"{output}: {len(archive.files)} files, {sizes / 1e6:.1f} MB; every SHA-256 hash was checked"],
        {
            "archive": output,
            "files": [
                {"place": str(file.place), "size_bytes": file.size_bytes, "sha256": file.sha256}
                for file in archive.files
            ],
            "remarks": archive.remarks,
        },
    )

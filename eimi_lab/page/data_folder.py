"""The data folder: the only folder in which the live web page reads and writes files."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from eimi_lab.process.errors import InputError
from eimi_lab.process.paths import followed
from eimi_lab.vision.image_files import ENDINGS as PICTURES

MOST_ENTRIES = 2000
KINDS = {".h5": "dataset", ".toml": "toml", ".json": "json", ".html": "report", ".csv": "table"}


@dataclass(frozen=True)
class Entry:
    """A file or a folder in the list on the live web page.

    Parameters
    ----------
    name : str
        Path relative to the data folder, with slashes.
    kind : str
        "folder", "dataset", "picture", "toml", "json", "report" or "table".
    changed_s : float
        Time of the last change, s since 1970.
    size : int
        Size in bytes.
    """

    name: str
    kind: str
    changed_s: float
    size: int


@dataclass(frozen=True)
class DataFolder:
    """The folder whose files the live web page may read and write.

    Parameters
    ----------
    root : Path
        Absolute path without symbolic links.
    """

    root: Path

    def inside(self, name: object) -> Path:
        """Return the path of a file that the browser named. For a value that is not a text, return the data folder.

        Raises
        ------
        InputError
            If the path lies outside the data folder.
        """
        name = name if isinstance(name, str) else ""
        parts = PurePosixPath(name)
        wrong = "\0" in name or "\\" in name or parts.is_absolute() or ".." in parts.parts or ":" in name
        if not wrong:
            try:
                path = followed(self.root / parts)
            except InputError:
                wrong = True
            else:
                wrong = not path.is_relative_to(self.root)
        if wrong:
            raise InputError(f"{name!r}: leads out of the folder of this page, {self.root}")
        return path

    def picture_in(self, folder: object, picture: object) -> Path:
        """Return the path of a picture in a folder below the data folder. Raises InputError without this picture."""
        path = self.inside(f"{self.name_of(self.inside(folder))}/{picture}")
        if not path.is_file():
            raise InputError(f"{picture}: no such picture in this folder")
        return path

    def name_of(self, path: Path) -> str:
        """Return a path relative to the data folder."""
        return path.relative_to(self.root).as_posix()

    def listed(self, name: str = "") -> list[Entry]:
        """Return the entries of a folder: first the subfolders, then the files, the newest file first.

        At most 2000 entries are returned. Pictures, of which a folder may hold more, are left out first.

        Raises
        ------
        InputError
            If the name is not a folder inside the data folder.
        """
        folder = self.inside(name)
        if not folder.is_dir():
            raise InputError(f"{name}: is not a folder")
        listed: list[Entry] = []
        with os.scandir(folder) as entries:
            for entry in entries:
                kind = self._kind(entry)
                if kind:
                    about = entry.stat()
                    where = self.name_of(folder / entry.name)
                    listed.append(Entry(where, kind, about.st_mtime, about.st_size))
        kept = sorted(listed, key=lambda entry: entry.kind == "picture")[:MOST_ENTRIES]
        return sorted(kept, key=lambda entry: (entry.kind != "folder", -entry.changed_s, entry.name))

    def _kind(self, entry: os.DirEntry[str]) -> str:
        """Return the kind of an entry, such as "folder" or "dataset"; empty if the web page does not show the entry."""
        if entry.name.startswith("."):
            return ""
        try:
            self.inside(self.name_of(Path(entry.path)))
            if entry.is_dir():
                return "folder"
            ending = Path(entry.name).suffix.lower()
            return ("picture" if ending in PICTURES else KINDS.get(ending, "")) if entry.is_file() else ""
        except (InputError, OSError):
            return ""

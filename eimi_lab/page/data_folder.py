"""The folder that the page may see: datasets, pictures, TOML files, fits and reports, and nothing outside it."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from eimi_lab.process.errors import InputError
from eimi_lab.vision.image_files import ENDINGS as PICTURES

MOST_ENTRIES = 2000
KINDS = {".h5": "dataset", ".toml": "toml", ".json": "json", ".html": "report", ".csv": "table"}


@dataclass(frozen=True)
class Entry:
    """A file or a folder. name: from the data folder on, with slashes. kind: folder, dataset, picture, toml, …"""

    name: str
    kind: str
    changed_s: float
    size: int


@dataclass(frozen=True)
class DataFolder:
    """A folder whose names come from a browser. root: as it is, links followed."""

    root: Path

    def inside(self, name: str) -> Path:
        """The path that a name from the page stands for. Raises InputError for one that leads out of the folder.

        Links are followed before it is judged: one that leads outside is refused as ".." is.
        """
        parts = PurePosixPath(name)
        wrong = "\0" in name or "\\" in name or parts.is_absolute() or ".." in parts.parts or ":" in name
        if not wrong:
            try:
                path = (self.root / parts).resolve()
            except (OSError, RuntimeError):  # RuntimeError is Python's for a loop of links before 3.13
                wrong = True
            else:
                wrong = not path.is_relative_to(self.root)
        if wrong:
            raise InputError(f"{name!r}: leads out of the folder of this page, {self.root}")
        return path

    def name_of(self, path: Path) -> str:
        """The inverse of `inside`."""
        return path.relative_to(self.root).as_posix()

    def listed(self, name: str = "") -> list[Entry]:
        """What is in a folder, folders first, the newest file first. Raises InputError."""
        folder = self.inside(name)
        if not folder.is_dir():
            raise InputError(f"{name}: is no folder")
        found: list[Entry] = []
        with os.scandir(folder) as entries:
            for entry in entries:
                kind = self._kind(entry)
                if kind and len(found) < MOST_ENTRIES:
                    about = entry.stat()
                    where = self.name_of(folder / entry.name)
                    found.append(Entry(where, kind, about.st_mtime, about.st_size))
        return sorted(found, key=lambda entry: (entry.kind != "folder", -entry.changed_s, entry.name))

    def _kind(self, entry: os.DirEntry[str]) -> str:
        """What an entry is to the page; empty for what is none of its business."""
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

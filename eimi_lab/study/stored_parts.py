"""Store each result of a study in a JSON file, so that an interrupted study can continue."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from eimi_lab.process.errors import InputError
from eimi_lab.process.outputs import new_folder, write_file
from eimi_lab.process.replacing import patiently

_HEAD = "study"


@dataclass(frozen=True)
class StoredParts:
    """The stored results of a study: one JSON file for each result, in the folder `parts`."""

    folder: Path

    @staticmethod
    def of(output: Path, head: dict[str, Any], force: bool) -> StoredParts:
        """Open the stored results of a study with the same inputs, or begin a new study.

        Parameters
        ----------
        output : Path
            Folder of the study.
        head : dict
            Inputs of the study.
        force : bool
            Whether to delete stored results.

        Raises
        ------
        InputError
            If the folder holds a study with other inputs, or other files.
        """
        parts = StoredParts(output / "parts")
        if parts._file(_HEAD).exists() and not force:
            if parts._read(_HEAD) != json.loads(json.dumps(head)):
                raise InputError(
                    f"{output}: holds a study with other inputs or of another version; give another folder, or --force"
                )
            return parts
        new_folder(output, force)
        parts.folder.mkdir(exist_ok=True)
        for file in parts.folder.glob("*.json"):
            patiently(file.unlink)
        parts._write(_HEAD, head)
        return parts

    def part(self, name: str, compute: Callable[[], Any]) -> Any:
        """Return the stored result with this name; if nothing is stored, compute and store the result."""
        if not self._file(name).exists():
            self._write(name, compute())
        return self._read(name)

    def _file(self, name: str) -> Path:
        return self.folder / f"{name}.json"

    def _read(self, name: str) -> Any:
        file = self._file(name)
        try:
            return json.loads(file.read_text(encoding="utf-8"))
        except ValueError as error:
            raise InputError(
                f"{file}: is not JSON ({error}); remove this file, and the program computes the part of the study again"
            ) from error

    def _write(self, name: str, content: Any) -> None:
        write_file(self._file(name), json.dumps(content, indent=1) + "\n", force=True)

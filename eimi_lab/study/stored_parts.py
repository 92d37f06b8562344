"""Results of a study as they are found, one JSON file each: what is there is not computed again."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from eimi_lab.process.errors import InputError
from eimi_lab.process.outputs import new_folder, write_file

_HEAD = "study"


@dataclass(frozen=True)
class StoredParts:
    """The folder ``parts`` of a study's output."""

    folder: Path

    @staticmethod
    def of(output: Path, head: dict[str, Any], force: bool) -> StoredParts:
        """Those of a new study or of one to go on with, which was begun with the same head.

        With ``force`` whatever is there is begun again. Raises InputError for a folder that holds another study, or
        something else.
        """
        parts = StoredParts(output / "parts")
        begun = parts._file(_HEAD)
        if begun.exists() and not force:
            if parts._read(_HEAD) != json.loads(json.dumps(head)):
                raise InputError(
                    f"{output}: holds a study of another extent or version; give another folder, or --force"
                )
            return parts
        new_folder(output, force)
        parts.folder.mkdir(exist_ok=True)
        for old in parts.folder.glob("*.json"):
            old.unlink()
        parts._write(_HEAD, head)
        return parts

    def part(self, name: str, found: Callable[[], Any]) -> Any:
        """What the part of this name holds: as stored, or as ``found`` says, which is then stored."""
        if not self._file(name).exists():
            self._write(name, found())
        return self._read(name)

    def _file(self, name: str) -> Path:
        return self.folder / f"{name}.json"

    def _read(self, name: str) -> Any:
        file = self._file(name)
        try:
            return json.loads(file.read_text(encoding="utf-8"))
        except ValueError as error:
            raise InputError(f"{file}: is no JSON ({error}); remove it, and it will be found again") from error

    def _write(self, name: str, content: Any) -> None:
        write_file(self._file(name), json.dumps(content, indent=1) + "\n", force=True)

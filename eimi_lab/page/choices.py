"""Protocols, specimens and rigs that a person may choose from, and what a run of them would do."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from eimi_lab.acquisition.dry_run import dry_run
from eimi_lab.acquisition.playback import pictures_needed
from eimi_lab.acquisition.run import check_request
from eimi_lab.config.protocol import load_protocol
from eimi_lab.config.rig import load_rig
from eimi_lab.config.specimen import load_specimen
from eimi_lab.config.toml import parse_table, read_text
from eimi_lab.page.data_folder import DataFolder
from eimi_lab.process.errors import InputError

Choices = dict[str, list[str]]

SHIPPED = {"protocol": "", "specimen": "specimens", "rig": "rigs"}
# The key by which a TOML file of each kind is known.
KEYS = {"protocol": "frames_per_state", "specimen": "specimen", "rig": "supply", "calibration": "pixels_per_mm"}
MOST_FILES = 500
MOST_LINES = 400


def shipped(kind: str) -> list[str]:
    """The names of shipped files of a kind."""
    folder = Path(str(files("eimi_lab.protocols"))) / SHIPPED[kind]
    return sorted(file.stem for file in folder.glob("*.toml") if KEYS[kind] in parse_table(read_text(file), file))


def choices(folder: DataFolder) -> Choices:
    """Names by kind: files of the data folder and of its folders, from it on, then those that are shipped."""
    found: Choices = {kind: [] for kind in KEYS}
    tomls = sorted([*folder.root.glob("*.toml"), *folder.root.glob("*/*.toml")])[:MOST_FILES]
    for file in tomls:
        name = folder.name_of(file)
        try:
            table = parse_table(read_text(folder.inside(name)), file)
        except InputError:  # not for a run, whatever it is
            continue
        for kind, key in KEYS.items():
            if key in table:
                found[kind].append(name)
                break
    for kind in SHIPPED:
        found[kind] += shipped(kind)
    return found


def chosen(folder: DataFolder, kind: str, name: object) -> str:
    """What the command line takes for a choice: the path of a file, or a shipped name. Raises InputError."""
    if not isinstance(name, str) or not name:
        raise InputError(f"choose a {kind}")
    if name in shipped(kind):
        return name
    file = folder.inside(name)
    if not file.is_file():
        raise InputError(f"{name}: no such file")
    return str(file)


def dry(protocol: str, specimen: str, rig: str) -> list[str]:
    """What a run would do, in lines. Raises InputError, as the run would."""
    asked, beam, bench = load_protocol(protocol), load_specimen(specimen), load_rig(rig)
    check_request(asked, beam, bench)
    lines = [words] if (words := pictures_needed(asked, bench)) else []
    dry_run(asked, beam, bench, lines.append)
    if len(lines) > MOST_LINES:
        left_out = len(lines) - MOST_LINES
        half = MOST_LINES // 2
        lines = [*lines[:half], f"… {left_out} lines left out; `eimi acquire --dry-run` shows all …", *lines[-half:]]
    return lines

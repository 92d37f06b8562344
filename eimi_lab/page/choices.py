"""The input files that the live web page offers, and the list of steps that a run with them would do."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from eimi_lab.acquisition.dry_run import dry_run
from eimi_lab.acquisition.playback import describe_recording_length
from eimi_lab.acquisition.run import check_request
from eimi_lab.config.protocol import load_protocol
from eimi_lab.config.rig import load_rig
from eimi_lab.config.specimen import load_specimen
from eimi_lab.config.toml import parse_table, read_text
from eimi_lab.page.data_folder import DataFolder
from eimi_lab.process.errors import InputError

Choices = dict[str, list[str]]

SHIPPED = {"protocol": "", "specimen": "specimens", "rig": "rigs"}
# For each kind of TOML file, a key that only this kind has.
KEYS = {"protocol": "frames_per_state", "specimen": "specimen", "rig": "supply", "calibration": "pixels_per_mm"}
READ = {"protocol": load_protocol, "specimen": load_specimen, "rig": load_rig}
INCOMPLETE = "incomplete"
MOST_FILES = 500


def shipped(kind: str) -> list[str]:
    """Return the names of the shipped TOML files of a kind, without the ending ".toml".

    The kind is "protocol", "specimen" or "rig".
    """
    folder = Path(str(files("eimi_lab.protocols"))) / SHIPPED[kind]
    return sorted(file.stem for file in folder.glob("*.toml") if KEYS[kind] in parse_table(read_text(file), file))


def choices(folder: DataFolder) -> Choices:
    """Return the names of the files that a person can choose on the live web page.

    Returns
    -------
    dict of lists of str
        The names by kind: "protocol", "specimen", "rig" and "calibration". The key "incomplete" lists files that cannot
        be used, for example because values are missing.
    """
    names: Choices = {kind: [] for kind in (*KEYS, INCOMPLETE)}
    tomls = sorted([*folder.root.glob("*.toml"), *folder.root.glob("*/*.toml")])[:MOST_FILES]
    for file in tomls:
        name = folder.name_of(file)
        try:
            table = parse_table(read_text(folder.inside(name)), file)
        except InputError:  # the file is not an input of a run
            continue
        for kind, key in KEYS.items():
            if key in table:
                names[kind].append(name)
                if kind in READ and not _is_complete(kind, file):
                    names[INCOMPLETE].append(name)
                break
    for kind in SHIPPED:
        names[kind] += shipped(kind)
    return names


def _is_complete(kind: str, file: Path) -> bool:
    try:
        READ[kind](file)
    except InputError:
        return False
    return True


def chosen(folder: DataFolder, kind: str, name: object) -> str:
    """Return the path of a chosen file, or the name of a shipped file.

    Parameters
    ----------
    folder : DataFolder
        The data folder.
    kind : str
        "protocol", "specimen" or "rig".
    name : object
        The name that came from the live web page.

    Raises
    ------
    InputError
        If nothing was chosen, or if the file does not exist in the data folder.
    """
    if not isinstance(name, str) or not name:
        raise InputError(f"{kind} is missing; choose a file")
    if name in shipped(kind):
        return name
    file = folder.inside(name)
    if not file.is_file():
        raise InputError(f"{name}: no such file in the folder of this page, and no shipped {kind} with this name")
    return str(file)


def dry(protocol: str, specimen: str, rig: str) -> list[str]:
    """Return the steps of a run as lines of text, without using an instrument.

    `protocol`, `specimen` and `rig` are paths or names of shipped files.

    Raises
    ------
    InputError
        If the run would be refused.
    """
    asked, beam, bench = load_protocol(protocol), load_specimen(specimen), load_rig(rig)
    check_request(asked, beam, bench)
    lines = [length] if (length := describe_recording_length(asked, bench)) else []
    dry_run(asked, beam, bench, lines.append, lambda detail: None)
    return lines

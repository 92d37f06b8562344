"""Write docs/file_formats.md, which lists every key of every file that a person edits.

    python docs/scripts/file_formats.py

The keys come from the classes that check the files. The meaning of a key is the text below its field in the class. The
unit of a key is the ending of its name. The example of a key comes from a shipped file.
"""

from __future__ import annotations

import ast
import dataclasses
import inspect
import re
import textwrap
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import UnionType
from typing import Any, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from eimi_fitting.inference.evidence.sources import SOURCES, File
from eimi_lab.config.calibration import Calibration
from eimi_lab.config.csv_tables import Column
from eimi_lab.config.materials import TrueMaterials
from eimi_lab.config.people import People
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.rig import Rig
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.config.toml import Document
from eimi_lab.config.uncertainty import FOCAL_LENGTH, keys_of
from eimi_lab.dataset.moving.motion_csv import POINT_COLUMNS as MOTION_COLUMNS
from eimi_lab.dataset.moving.motion_csv import TIME_COLUMNS
from eimi_lab.dataset.state_loads import FRAME_COLUMNS, LOAD_COLUMNS, STATE_COLUMNS, UNTIL_COLUMNS
from eimi_lab.dataset.tracked.points_csv import COLUMNS as POINT_COLUMNS
from eimi_lab.dataset.tracked.points_csv import OPTIONAL_COLUMNS
from eimi_lab.fits.tensile_files import COLUMNS as TENSILE_COLUMNS

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "file_formats.md"

# Longer endings come first, because the first ending that fits gives the unit.
UNITS = {
    "_mT_per_A": "mT/A",
    "_A_per_s": "A/s",
    "_kA_per_m": "kA/m",
    "_per_m": "1/m",
    "_kg_m3": "kg/m³",
    "pixels_per_mm": "px/mm",
    "_percent": "%",
    "_degC": "°C",
    "_ohm": "ohm",
    "_deg": "degrees",
    "_kPa": "kPa",
    "_MPa": "MPa",
    "_Pa": "Pa",
    "_mm": "mm",
    "_Hz": "Hz",
    "_mT": "mT",
    "_px": "px",
    "_T": "T",
    "_A": "A",
    "_V": "V",
    "_N": "N",
    "_e": "electrons",
    "_s": "s",
    "seconds": "s",
    "region": "px",
}

# The files that give the examples; the first file that has a key is used.
EXAMPLES: dict[type[Document], tuple[str, ...]] = {
    SpecimenFile: ("specimens/bench_example.toml", "first/specimen.toml"),
    Calibration: ("rigs/bench_example_calibration.toml", "first/calibration.toml"),
    Protocol: ("dragon_skin_10.toml",),
    Rig: ("rigs/bench_example.toml", "rigs/virtual.toml"),
    TrueMaterials: ("rigs/virtual_materials.toml",),
    People: (),
}
# Examples of keys that no shipped file has.
FURTHER_EXAMPLES = {
    "camera_tilt_deg": "[0.0, 1.5]",
    "ruler_px": "[[60, 845], [460, 845]]",
    "uncertainty.camera_tilt_deg": "2.0",
    "current.values_A": "[0.0, 0.2, 0.5]",
    "creep": "true",
    "settle.dwell_s": "60.0",
    "ring_down": "{ seconds = 10.0, rate_Hz = 120.0 }",
    "ring_down.seconds": "10.0",
    "ring_down.from_A": "1.5",
    "ring_down.rate_Hz": "120.0",
    "ring_down.repeats": "3",
    "current.up_and_down": "true",
    "specimen.rest_shape": '"straight"',
    "current.both_polarities": "true",
    "telecentric": "true",
    "person.given_name": '"Josiah"',
    "person.family_name": '"Carberry"',
    "person.orcid": '"0000-0002-1825-0097"',
    "person.affiliation": '"Brown University"',
    "person.email": '"josiah@example.org"',
    "background_field_mT": "[0.0, 0.04]",
    "field.radius_mm": "100.0",
    "field.gap_mm": "100.0",
    "field.centre_mm": "[28.0, 0.0]",
    "field.map": '"field.csv"',
    "field.gradient_per_m": "[0.5, 0.0]",
    "bench.magnetisation_angle_deg": "3.0",
    "bench.coil_constant_mT_per_A": "4.5",
    "bench.background_field_mT": "[0.0, 0.04]",
    "field.against_current": "[[0.0, 0.03], [0.5, 2.38]]",
    "sensors.uncertainty": "0.005",
    "uncertainty.background_field_mT": "0.03",
    "uncertainty.field_gradient_per_m": "0.5",
    "calibrated_on": "2026-11-20",
    "supply.off_below_A": "0.02",
    "uncertainty.magnet_tip_offset_mm": "0.05",
    "uncertainty.rest_shape_mm": "0.2",
    "uncertainty.taper_mm": "0.02",
    f"uncertainty.{FOCAL_LENGTH}": "12.0",
}

# Tables with the keys of a table that the page describes elsewhere.
REFERENCES = {
    "bench.field": (
        "The keys are those of `[field]` in calibration.toml. In this table, `map` is a list of rows "
        "[x_mm, y_mm, bx_mT, by_mT] instead of the name of a CSV file, and `against_current` is not needed."
    ),
}

# Meanings of keys of a table [uncertainty] for which the name of the quantity in a fit is too short. The words follow
# "Standard uncertainty of the".
UNCERTAIN = {
    "rest_shape_mm": "largest offset of the centre line without load, in each of three smooth bending shapes",
    "taper_mm": "change of the width from the clamp to the magnet; without a magnet, from the clamp to the tip",
    "axis_angle_deg": "direction of the unloaded beam",
    "current_A": "zero of the current",
}

# The files with a table [uncertainty].
STATING: dict[type[Document], File] = {SpecimenFile: "specimen", Calibration: "calibration", Rig: "rig"}
HEADER = "\n| key | unit | default | meaning | example |\n| --- | --- | --- | --- | --- |\n"

INTRODUCTION = """# File formats

This page lists every key of every file that a person edits. The script `docs/scripts/file_formats.py` makes the page
from the code that checks the files, so the page agrees with the program. `eimi init FOLDER` writes template files with
comments, which you can edit.

- The name of a key with a unit ends in this unit, with few exceptions.
- For an unknown key, a wrong type or a value out of range, the program prints one line: file, key, value, and what
  would be right. The program names all missing keys at once.
- The default "required" means that the file must have the key if it has the table of the key.
- The beam frame has its origin at the middle of the line at which the beam leaves the clamp. In this frame, x points
  along the undeformed beam away from the clamp, and y points across the beam, to the side to which the field of a
  positive current points. If calibration.toml has no `field_angle_deg`, y is turned by 90 degrees counter-clockwise
  from x in the picture.
- In the picture, x points to the right and y down. Angles are clockwise from +x.

[The format](why/format.md) describes the results of a run: the dataset and `fits.json`.
"""

TABLES = """
## CSV files

The columns may be in any order. Cells are separated by commas, semicolons or tabs. With semicolons or tabs, a decimal
comma is accepted too.
"""


def page() -> str:
    """Return the text of the page."""
    parts = [INTRODUCTION]
    for title, model, words in (
        ("specimen.toml", SpecimenFile, "A beam of soft material, with or without a magnet at its tip."),
        (
            "calibration.toml",
            Calibration,
            "The position of the beam in the picture, the scale, and the field per ampere.",
        ),
        ("protocol.toml", Protocol, "The currents of a run, and the conditions for each state."),
        ("rig.toml", Rig, "The supply and the camera, and their addresses."),
        ("materials.toml", TrueMaterials, "The materials of the specimens of a virtual rig. No fit reads this file."),
        ("people.toml", People, "The authors of a published archive of datasets, for `eimi publish --people`."),
    ):
        parts.append(f"\n## {title}\n\n{words}\n" + _document(model))
    parts.append(TABLES)
    parts.append(
        _table(
            "states.csv",
            "The loads in each picture or state.",
            FRAME_COLUMNS | UNTIL_COLUMNS | STATE_COLUMNS | LOAD_COLUMNS,
        )
    )
    parts.append(_table("points.csv", "Tracked points instead of pictures.", POINT_COLUMNS | OPTIONAL_COLUMNS))
    words = (
        "Tracked points of a motion, for `eimi import --ring-down` or `--creep`: one row for each point of each frame. "
        "Without the column time_s, the file needs the column frame, and the command needs `--rate`."
    )
    parts.append(_table("CSV file of a motion", words, TIME_COLUMNS | MOTION_COLUMNS))
    words = (
        "A tensile test: one column of strain and one of stress. The files of the Soft Robotics Materials Database "
        "(Marechal et al. 2020) can be read without changes."
    )
    parts.append(_table("CSV file of a tensile test", words, TENSILE_COLUMNS))
    return "".join(parts)


def _document(model: type[Document]) -> str:
    examples = _examples(EXAMPLES[model])
    text = ""
    for name, table in _tables(model):
        if name in REFERENCES:
            text += f"\n### `[{name}]`\n\n{REFERENCES[name]}\n"
            continue
        rows = [_row(table, key, name, examples) for key in _keys(table)]
        if not rows:
            continue
        heading = f"\n### `[{name}]`\n" if name else ""
        text += heading + HEADER + "".join(rows)
    if model in STATING:
        text += _uncertainties(STATING[model], examples)
    return text


def _uncertainties(file: File, examples: Mapping[str, str]) -> str:
    """Return the documentation of the TOML table [uncertainty] of a file, with one row for each key."""
    meanings = {
        key: f"Standard uncertainty of the {UNCERTAIN.get(key, SOURCES[source].words)}."
        for key, source in keys_of(file).items()
    }
    if file == "calibration":
        meanings[FOCAL_LENGTH] = "Standard uncertainty of the focal length; `eimi calibrate` writes it."
    rows = "".join(
        f"| `{key}` | {_unit(key)} | not known | {meaning} | `{_example(f'uncertainty.{key}', examples)}` |\n"
        for key, meaning in meanings.items()
    )
    return "\n### `[uncertainty]`\n\nStandard uncertainties. The value 0 means exact.\n" + HEADER + rows


def _example(path: str, examples: Mapping[str, str]) -> str:
    example = examples.get(path) or FURTHER_EXAMPLES.get(path)
    if not example:
        raise ValueError(
            f"no file in protocols/ contains the key {path}; add the key to one of these files: its value there is the "
            "example in the documentation"
        )
    return example


def _tables(model: type, name: str = "") -> Iterator[tuple[str, type]]:
    """Yield the name and the class of each TOML table in a file. The file itself comes first, with the name ""."""
    yield name, model
    for key, annotation in _keys(model).items():
        inner = next((kind for kind in _kinds(annotation) if _is_table(kind)), None)
        if inner and not issubclass(inner, Document):
            named = {dict: f"{key}.NAME", tuple: f"[{key}]"}.get(
                get_origin(annotation), key
            )  # [[key]]: a list of tables
            yield from _tables(inner, f"{name}.{named}" if name else named)


def _kinds(annotation: Any) -> Iterator[Any]:
    yield annotation
    for inner in get_args(annotation):
        yield from _kinds(inner)


def _is_table(kind: Any) -> bool:
    return isinstance(kind, type) and (issubclass(kind, BaseModel) or dataclasses.is_dataclass(kind))


def _keys(table: type) -> dict[str, Any]:
    if issubclass(table, BaseModel):
        return {name: field.annotation for name, field in table.model_fields.items()}
    return {field.name: field.type for field in dataclasses.fields(table)}


def _row(table: type, key: str, name: str, examples: Mapping[str, str]) -> str:
    path = f"{name.strip('[]')}.{key}" if name else key
    meaning = _meanings(table)[key]
    choices = _choices(_keys(table)[key])
    if any(choice not in meaning for choice in choices):
        meaning += f" One of {', '.join(f'`{choice}`' for choice in choices)}."
    shown = examples.get(path) or _shown(_default_value(table, key))
    if _holds_table(table, key) and not shown.startswith(('"', "{")):
        example = "a separate table"
    else:
        example = f"`{shown or _example(path, examples)}`"
    cells = [f"`{key}`", _unit(key), _default(table, key), meaning, example]
    return f"| {' | '.join(cells)} |\n"


def _holds_table(table: type, key: str) -> bool:
    return (key == "uncertainty" and issubclass(table, Document)) or any(
        _is_table(kind) for kind in _kinds(_keys(table)[key])
    )


def _choices(annotation: Any) -> list[str]:
    literals = [
        str(value)
        for kind in _kinds(annotation)
        if get_origin(kind) not in (Union, UnionType) and str(get_origin(kind)).endswith("Literal")
        for value in get_args(kind)
    ]
    return [f'"{value}"' for value in dict.fromkeys(literals)]


def _default_value(table: type, key: str) -> Any:
    if issubclass(table, BaseModel):
        return table.model_fields[key].default
    return next(field.default for field in dataclasses.fields(table) if field.name == key)


def _default(table: type, key: str) -> str:
    value = _default_value(table, key)
    if value is PydanticUndefined:
        return "required"
    if value is None:
        return "see meaning" if "default" in _meanings(table)[key].lower() else "none"
    return f"`{_shown(value)}`"


def _shown(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return f"[{', '.join(map(_shown, value))}]"
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, BaseModel):
        return f"{{ {', '.join(f'{name} = {_shown(inner)}' for name, inner in value)} }}"
    if _is_table(type(value)):
        return "see below"
    return "" if value is None or value is PydanticUndefined else f"{value:g}"


def _unit(key: str) -> str:
    return next((unit for ending, unit in UNITS.items() if key.endswith(ending)), "")


def _meanings(table: type) -> dict[str, str]:
    """Return the explanations of the fields of a class, by field name. Each explanation is the text below the field."""
    (node,) = ast.parse(textwrap.dedent(inspect.getsource(table))).body
    assert isinstance(node, ast.ClassDef)
    meanings = {}
    for field, below in zip(node.body, node.body[1:], strict=False):
        if isinstance(field, ast.AnnAssign) and isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant):
            assert isinstance(field.target, ast.Name)
            meanings[field.target.id] = " ".join(str(below.value.value).split())
    return meanings


def _examples(names: tuple[str, ...]) -> dict[str, str]:
    """Return an example value of each key, from the lines of shipped files in which the key has a value.

    `names` are the names of the files. A line may be a comment, because the files contain optional keys as comments.
    """
    examples: dict[str, str] = {}
    for name in names:
        table = ""
        for line in (ROOT / "protocols" / name).read_text(encoding="utf-8").splitlines():
            line = line.removeprefix("# ")
            if header := re.match(r"\[+([\w.\" -]+)\]", line):
                table = re.sub(r'"[^"]*"', "NAME", header.group(1)) + "."
            elif pair := re.match(r"(\w+) = ([^?#]+?)\s*(#.*)?$", line):
                key, value = table + pair.group(1), pair.group(2)
                examples.setdefault(key, value)
                for inner in re.finditer(r"[{,] (\w+) = ([^,}]+?) ?(?=[,}])", value) if value.startswith("{") else ():
                    examples.setdefault(f"{key}.{inner.group(1)}", inner.group(2))
    return examples


def _table(title: str, words: str, columns: Mapping[str, Column]) -> str:
    rows = "".join(
        f"| `{name}` | {_unit(name)} | {column.default or 'none'} | {column.meaning} | `{column.example}` |\n"
        for name, column in columns.items()
    )
    return f"\n### {title}\n\n{words}\n{HEADER.replace('key', 'column')}{rows}"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")

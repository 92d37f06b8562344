"""Validate TOML text against a pydantic model, and describe the first fault in one line for the user."""

from __future__ import annotations

import difflib
import json
import re
import tomllib
from dataclasses import fields, is_dataclass
from datetime import date
from importlib.resources import files
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, PrivateAttr, ValidationError

from eimi_lab.process.errors import InputError
from eimi_lab.process.paths import reachable
from eimi_lab.process.replacing import patiently


class Table(BaseModel):
    """The base class of the models of TOML tables."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class Document(Table):
    """The base class of the models of TOML files."""

    _text: str = PrivateAttr(default="")

    @property
    def text(self) -> str:
        """The TOML text from which the document was read; empty if the document was created in Python."""
        return self._text


MOST_PARTS_OF_A_KEY = 1000
"""Largest number of dots in a key. The time that tomllib needs is proportional to the square of this number."""

_DECIMAL_COMMA = re.compile(r"\s*(?P<key>[\w.-]+)\s*=\s*(?P<value>[+-]?\d+,\d+)\s*(#.*)?")

SPREADSHEETS = frozenset({".xlsx", ".xls", ".ods", ".numbers"})

AnyDocument = TypeVar("AnyDocument", bound=Document)


def locate(name: str | Path, folder: str = "") -> Path:
    """Return the path of a TOML file that the user gives by its path or by the name of a shipped file.

    Parameters
    ----------
    name
        A path, or the name of a shipped file with or without ``.toml``.
    folder
        Subfolder of ``protocols`` with the shipped files of this kind.

    Raises
    ------
    InputError
        If there is no such file.
    """
    path = Path(name)
    if reachable(path).is_file():
        return reachable(path)
    shipped = Path(str(files("eimi_lab.protocols"))) / folder
    if path.name == str(name) and path.suffix in ("", ".toml"):
        candidate = shipped / f"{path.stem}.toml"
        if candidate.is_file():
            return candidate
    if path.is_dir():
        raise InputError(f"{name}: is a folder, not a TOML file")
    stems = ", ".join(sorted(file.stem for file in shipped.glob("*.toml")))
    raise InputError(f"{name}: no such file, and no shipped file of that name; the shipped files are {stems}")


_HDF5 = b"\x89HDF\r\n\x1a\n"  # the signature of HDF5 files (HDF5 File Format Specification, II.A)


def is_dataset(path: Path) -> bool:
    """Return whether a file is a dataset, which begins with the signature (first eight bytes) of HDF5."""
    if not path.is_file():
        return False
    try:
        with path.open("rb") as file:
            return file.read(len(_HDF5)) == _HDF5
    except OSError:
        return False


def read_text(path: Path) -> str:
    """Return the text of a file in UTF-8. Raises InputError if the file cannot be read."""
    if path.exists() and not path.is_file():  # reading a device or a pipe might never end
        raise InputError(f"{path}: is a folder, a device or a pipe, not a file")
    try:
        return patiently(lambda: path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        if is_dataset(path):
            raise InputError(f"{path}: is a dataset (HDF5), but a text file is needed here") from error
        if path.suffix.lower() in SPREADSHEETS:
            raise InputError(f"{path}: is a spreadsheet; save its table as CSV") from error
        raise InputError(
            f"{path}: is not text in UTF-8 (byte {error.start}); save it with the encoding UTF-8"
        ) from error


def parse(model: type[AnyDocument], text: str, origin: str | Path) -> AnyDocument:
    """Return the contents of a TOML file as an instance of its pydantic model.

    Parameters
    ----------
    model
        The pydantic model of the file.
    text
        The text of the file.
    origin
        Name of the file in error messages.

    Raises
    ------
    InputError
        If the text is not valid TOML, or if a key or value is wrong.
    """
    return check(model, parse_table(text, origin), text, origin)


def to_toml(document: Document) -> str:
    """Return the contents of a TOML file as TOML text, without comments and without the keys that were not given."""
    return table_text(document.model_dump(exclude_unset=True, exclude_none=True))


def table_text(table: dict[str, Any]) -> str:
    """Return a dictionary of numbers, texts, lists, tables and lists of tables as TOML text."""
    return "\n".join(_lines(table, "")) + "\n"


def _lines(table: dict[str, Any], header: str) -> list[str]:
    name = header.strip("[]")
    lines = [header] if header else []
    tables = {key: value for key, value in table.items() if isinstance(value, dict) or _is_list_of_tables(value)}
    lines += [f"{key} = {_toml(value)}" for key, value in table.items() if key not in tables]
    for key, value in tables.items():
        path = f"{name}.{key}" if name else key
        if isinstance(value, dict):
            lines += ["", *_lines(value, f"[{path}]")]
        else:
            lines += [line for row in value for line in ("", *_lines(row, f"[[{path}]]"))]
    return lines


def _is_list_of_tables(value: Any) -> bool:
    return isinstance(value, list | tuple) and bool(value) and all(isinstance(row, dict) for row in value)


def _toml(value: Any) -> str:
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, date):
        return value.isoformat()
    # A TOML string must not contain the control character DEL (U+007F).
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def parse_table(text: str, origin: str | Path) -> dict[str, Any]:
    """Return the contents of TOML text as a dictionary. Raises InputError if the text is not valid TOML."""
    if any(_longest_key(line) > MOST_PARTS_OF_A_KEY for line in text.splitlines()):
        raise InputError(f"{origin}: is not usable TOML: a key has more than {MOST_PARTS_OF_A_KEY} parts")
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        raise InputError(f"{origin}: is not usable TOML: its arrays or tables are nested too deeply") from error
    except ValueError as error:  # TOMLDecodeError, or the error of int() for too many digits
        raise InputError(f"{origin}: is not valid TOML: {error}{_decimal_comma(text)}") from error


def _decimal_comma(text: str) -> str:
    """Return a hint about the first number with a decimal comma in TOML text; an empty text without such a number."""
    for number, line in enumerate(text.splitlines(), 1):
        if match := _DECIMAL_COMMA.fullmatch(line):
            right = match["value"].replace(",", ".")
            return f"; line {number}: {match['key']} = {match['value']} has a decimal comma; write {right}"
    return ""


def _longest_key(line: str) -> int:
    """Return the number of dots in the longest dotted key of a line of TOML; a.b.c has two dots."""
    *keys, _ = line.split("=")
    if line.lstrip().startswith("["):
        keys.append(line)
    return max((re.split("[{,]", key)[-1].count(".") for key in keys), default=0)


def differences(before: str, after: str) -> tuple[str, ...]:
    """Return one line of text with the old and the new value for each key that differs between two TOML texts."""
    old, new = _flat(tomllib.loads(before), ""), _flat(tomllib.loads(after), "")
    return tuple(
        f"{key} was {_stated(old, key)}, and is {_stated(new, key)} now"
        for key in sorted(old.keys() | new.keys())
        if old.get(key) != new.get(key)
    )


def _flat(table: dict[str, Any], prefix: str) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for key, value in table.items():
        values |= _flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {prefix + key: value}
    return values


def _stated(table: dict[str, Any], key: str) -> str:
    return _toml(table[key]) if key in table else "absent"


# For each key that only one kind of file has: the class name of this kind, and the kind in words.
_KINDS = {
    "specimen": ("SpecimenFile", "a specimen"),
    "pixels_per_mm": ("Calibration", "a calibration"),
    "frames_per_state": ("Protocol", "a protocol"),
    "supply": ("Rig", "a rig"),
}


def check(model: type[AnyDocument], table: dict[str, Any], text: str, origin: str | Path) -> AnyDocument:
    """Check the contents of a TOML file against a pydantic model, and return the instance of the model.

    Parameters
    ----------
    model
        The pydantic model of the file.
    table
        The contents of the file as a dictionary.
    text
        The text of the file, which the result keeps.
    origin
        Name of the file in error messages.

    Raises
    ------
    InputError
        If a key or value is wrong.
    """
    try:
        document = model.model_validate(table)
    except ValidationError as error:
        for key, (name, kind) in _KINDS.items():
            if key in table and key not in model.model_fields and name != model.__name__:
                needed = next((words for other, words in _KINDS.values() if other == model.__name__), "another file")
                raise InputError(f"{origin}: is {kind}, but {needed} is needed here") from error
        raise InputError(f"{origin}: {_one_line(model, error)}") from error
    document._text = text
    return document


LONGEST_SHOWN = 20  # a message shows a list up to this number of values

# Pydantic's error types for an unknown key: in a model and in a dataclass.
UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")


def _one_line(model: type[BaseModel], error: ValidationError) -> str:
    """Return one of the faults that pydantic found, in one line for the user."""
    faults = error.errors(include_url=False)
    fault = next((f for f in faults if f["type"] in UNKNOWN), faults[0])
    location = tuple(str(part) for part in fault["loc"])
    key = ".".join(location)
    value = fault["input"]
    match fault["type"]:
        case unknown if unknown in UNKNOWN:
            return f"{key} is not a known key; {_near(location[-1], _known_keys(model, location[:-1]))}"
        case "missing" if isinstance(fault["loc"][-1], int):
            return f"{'.'.join(location[:-1])} should have more than {location[-1]} values"
        case "too_long":
            largest, actual = fault["ctx"]["max_length"], fault["ctx"]["actual_length"]
            shown = _shown(value) if len(value) <= LONGEST_SHOWN else "a list"
            comma = "; decimals have a point, not a comma" if actual == 2 * largest else ""
            return f"{key} = {shown} should have at most {largest} values, not {actual}{comma}"
        case "tuple_type":
            return f"{key} = {_shown(value)} should be a list in square brackets"
        case "missing":
            missing = [_missing(model, other["loc"]) for other in faults if _is_missing_key(other)]
            return f"{', '.join(missing)} {'is' if len(missing) == 1 else 'are'} missing"
        case "value_error":
            reason = str(fault["ctx"]["error"])
            if isinstance(value, dict):
                return f"[{key}] {reason}" if key else reason
            return f"{key} = {_shown(value)} {reason}"
        case "literal_error":
            return f"{key} = {_shown(value)} should be {fault['ctx']['expected']}"
        case _:
            return f"{key} = {_shown(value)} {fault['msg'].removeprefix('Input ')}"


def _is_missing_key(fault: Any) -> bool:
    return fault["type"] == "missing" and isinstance(fault["loc"][-1], str)


def _missing(model: type[BaseModel], location: tuple[int | str, ...]) -> str:
    parts = tuple(map(str, location))
    return f"the table [{'.'.join(parts)}]" if _known_keys(model, parts) else ".".join(parts)


def _near(key: str, keys: list[str]) -> str:
    near = difflib.get_close_matches(key, keys, n=1)
    return f"did you mean {near[0]}?" if near else f"the known keys are {', '.join(keys)}"


def _shown(value: object) -> str:
    """Return a value as TOML text for a message; a dictionary becomes "a table"."""
    if isinstance(value, dict):
        return "a table"
    return str(value).lower() if isinstance(value, bool) else repr(value)


def _known_keys(model: Any, location: tuple[str, ...]) -> list[str]:
    """Return the permitted keys of the table at ``location``, such as ("virtual", "optics"), in a file.

    ``model`` is the pydantic model of the file.
    """
    table = model
    for part in location:
        if part.isdecimal():  # the number of one of several tables [[name]]
            continue
        field = table.model_fields.get(part) if isinstance(table, type) and issubclass(table, BaseModel) else None
        annotation = field.annotation if field else None
        table = next((kind for kind in (annotation, *get_args(annotation)) if _is_table(kind)), None)
    if table is None:
        return []
    return [field.name for field in fields(table)] if is_dataclass(table) else list(table.model_fields)


def _is_table(kind: Any) -> bool:
    return isinstance(kind, type) and (issubclass(kind, BaseModel) or is_dataclass(kind))

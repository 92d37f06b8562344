"""Make the files of a dataset from photographs of a loaded beam, clicks and typed numbers."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from contextlib import suppress
from datetime import UTC, date, datetime
from functools import lru_cache
from pathlib import Path
from typing import Any

from eimi_drivers.cameras.image_series import natural_key
from eimi_lab.config.calibration import load_calibration
from eimi_lab.config.specimen import SpecimenFile, load_specimen
from eimi_lab.config.toml import check, parse, parse_table, read_text
from eimi_lab.dataset.importing import import_frames
from eimi_lab.page.eye import edges_in
from eimi_lab.page.states_table import STATES, states_text, written_states
from eimi_lab.page.stored_runs import jpeg
from eimi_lab.process.errors import InputError
from eimi_lab.process.outputs import refuse_existing, write_file
from eimi_lab.process.replacing import remove
from eimi_lab.process.replacing import replace as move
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.calibration.clicked_bench import ClickedBench, MeasuredBench, measure_bench
from eimi_lab.vision.calibration.exif_lens import focal_length
from eimi_lab.vision.edges.region import region_of
from eimi_lab.vision.image_files import ENDINGS, read_image

SPECIMEN, CALIBRATION = "specimen.toml", "calibration.toml"
OF_COIL = ("current_A", "field_mT", "field_sigma_mT")
"""Columns of states.csv that the page leaves out, because its calibration has no coil."""

N_PER_GRAM = 9.80665e-3
"""Weight of a mass of 1 g at standard gravity (ISO 80000-4), N."""

FREED = ("axis", "clamp", "tilt")
"""Inputs that become unknowns in a fit of clicked photographs.

The photographs determine these inputs better than a click, a spirit level or the eye of a person does.
"""

DENSITY_SIGMA_KG_M3 = 10.0
_SIZES = ("length_mm", "width_mm", "depth_mm")
_TYPED = (*_SIZES, "density_kg_m3")


def opened(path: Path) -> dict[str, Any]:
    """Return the names of the photographs in a folder, and the values in the files of the folder.

    Returns
    -------
    dict
        A JSON object with the names and the size (pixels) of the photographs, a text on the source of the focal length,
        the values of specimen.toml and states.csv, the names of the existing files and the name of the dataset.

    Raises
    ------
    InputError
        If the folder does not exist, or if the first photograph or a file cannot be read.
    """
    pictures = _pictures(path)
    size, lens = [0, 0], None
    if pictures:
        height, width = _image(pictures[0], pictures[0].stat().st_mtime_ns).shape[:2]
        size, lens = [width, height], focal_length(pictures[0], (width, height))
    return {
        "pictures": [picture.name for picture in pictures],
        "size_px": size,
        "lens": lens.source if lens else "",
        "beam": _written_beam(path / SPECIMEN),
        "grams": _written_grams(path),
        "written": [name for name in (SPECIMEN, CALIBRATION, STATES) if (path / name).exists()],
        "dataset": dataset_name(path),
    }


def dataset_name(path: Path) -> str:
    """Return the name of the dataset that is made from a folder: the name of the folder with the ending .h5."""
    return f"{path.name or 'beam'}.h5"


def _pictures(path: Path) -> list[Path]:
    if not path.is_dir():
        raise InputError(f"{path}: is not a folder")
    images = [file for file in path.iterdir() if file.suffix.lower() in ENDINGS and not file.name.startswith(".")]
    return sorted(images, key=lambda file: natural_key(file.name))


@lru_cache(maxsize=6)
def _image(path: Path, changed_ns: int) -> Any:
    return read_image(path)


def _written_beam(file: Path) -> dict[str, str]:
    """Return the values in a specimen file as texts, by their keys on the web page; empty without a file."""
    if not file.is_file():
        return {}
    table = parse_table(read_text(file), file)
    beam, sigma = table.get("specimen", {}), table.get("uncertainty", {})
    values = {key: beam[key] for key in ("name", "material", *_TYPED) if key in beam}
    values |= {f"{key}_sigma": sigma[key] for key in _SIZES if key in sigma}
    if "tip_load" in table:
        values["thread_mm"] = table["tip_load"].get("x_mm", "")
    return {key: str(value) for key, value in values.items()}


def _written_grams(folder: Path) -> dict[str, str]:
    grams = {}
    for name, row in written_states(folder).items():
        with suppress(ValueError):  # the row contains no force
            grams[name] = f"{float(row.get('tip_force_N', '')) / N_PER_GRAM:.6g}"
    return grams


def picture(path: Path) -> bytes:
    """Return a photograph as an upright JPEG in its full size. Raises InputError if the photograph cannot be read."""
    return jpeg(_image(path, path.stat().st_mtime_ns))


def accepted(received: Path, target: Path) -> dict[str, Any]:
    """Check a photograph that the live web page received, and rename the file to `target`.

    Parameters
    ----------
    received : Path
        The file with a temporary name.
    target : Path
        The path with the final name.

    Returns
    -------
    dict
        The name of the photograph, and its width and height in pixels.

    Raises
    ------
    InputError
        If the file is not a readable photograph, or if a different file already has the final name.
    """
    try:
        height, width = read_image(received).shape[:2]
        if target.exists() and target.read_bytes() != received.read_bytes():
            raise InputError("a different picture with this name is in the folder; rename one of the two pictures")
        move(received, target)
    except InputError as error:
        words = str(error).removeprefix(f"{received}: ")
        raise InputError(f"{target.name}: {words}") from error
    finally:
        remove(received)
    return {"picture": target.name, "size_px": [width, height]}


def edges(path: Path, clicked: Mapping[str, Any], beam: Mapping[str, Any]) -> dict[str, Any]:
    """Find the edges of the beam in a photograph, and return a JSON object.

    Parameters
    ----------
    path : Path
        The photograph.
    clicked : mapping
        The clicked points in pixels of the first photograph, and the typed values about the ruler and the camera.
    beam : mapping
        The typed sizes and the density of the beam.

    Returns
    -------
    dict
        The two edges (pixels), the angle of the tip with its standard uncertainty (degrees), the blur with its limit
        (pixels), the flags (failed quality checks), and the numbers of the calibration with their sources.

    Raises
    ------
    InputError
        If a number is wrong or missing, or if the clicks contradict each other.
    """
    specimen = parse(SpecimenFile, _specimen_text(beam, path.parent), SPECIMEN)
    measured = _measured(path.parent, clicked, specimen)
    whole = measured.calibration  # calibration of the whole photograph
    if path != _pictures(path.parent)[0] and whole.picture is not None:  # points along the beam are on the first one
        whole = whole.model_copy(update={"picture": whole.picture.model_copy(update={"along_px": None})})
    image = _image(path, path.stat().st_mtime_ns)
    region = region_of(whole, image.shape)
    cut, calibration = (region.cut(image), region.calibration) if region else (image, whole)
    return {**edges_in(cut, calibration, specimen, BeamFrame(whole)), "sources": _shown(measured)}


def _measured(folder: Path, clicked: Mapping[str, Any], specimen: SpecimenFile) -> MeasuredBench:
    numbers = {key: clicked[key] for key in clicked if key not in ("ruler_mm", "stand_off_mm")}
    numbers["ruler_mm"] = _number(clicked, "ruler_mm")
    if _typed(clicked, "stand_off_mm"):
        numbers["stand_off_mm"] = _number(clicked, "stand_off_mm")
    first = _first(folder)
    height, width = _image(first, first.stat().st_mtime_ns).shape[:2]
    beam = specimen.specimen
    return measure_bench(
        check(ClickedBench, numbers, "", "clicks"),
        (width, height),
        beam.length_mm,
        beam.depth_mm,
        focal_length(first, (width, height)),
        _day(first),
    )


def _first(folder: Path) -> Path:
    pictures = _pictures(folder)
    if not pictures:
        raise InputError("there is no picture in the folder; drop the pictures of the beam first")
    return pictures[0]


def _day(file: Path) -> date:
    return datetime.fromtimestamp(file.stat().st_mtime, UTC).date()


def _shown(measured: MeasuredBench) -> list[list[str]]:
    """Return a row for each number of the calibration: its key, its value with standard uncertainty, and its source."""
    table, sigma = measured.calibration.model_dump(), measured.calibration.uncertainty or {}
    return [[key, f"{_words(table[key])} ± {sigma[key]:g}", source] for key, source in measured.sources.items()]


def _words(value: float | tuple[float, float]) -> str:
    return f"{value:g}" if isinstance(value, float) else ", ".join(f"{part:g}" for part in value)


def _typed(table: Mapping[str, Any], key: str) -> str:
    value = table.get(key)
    return "" if value is None else str(value).strip()


def _number(table: Mapping[str, Any], key: str) -> float:
    """Return the number that a person typed for a key. Raises InputError if the number is missing or wrong."""
    text = _typed(table, key)
    if not text:
        raise InputError(f"{key} is missing; type a number")
    try:
        value = float(text.replace(",", "."))
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{key} = {text!r} should be a number")
    return value


def _specimen_text(beam: Mapping[str, Any], folder: Path) -> str:
    """Return the text of a specimen file (TOML) with the numbers that a person typed."""
    sizes = {key: _number(beam, key) for key in _TYPED}
    sigmas = {key: _number(beam, f"{key}_sigma") for key in _SIZES}
    thread = [f"x_mm = {_number(beam, 'thread_mm'):g}"] if _typed(beam, "thread_mm") else []
    name, material = (_typed(beam, key) for key in ("name", "material"))
    lines = [
        (
            '# Written by the page "Weights and a phone". The length is the distance from the clamp to the tip. '
            "The camera"
        ),
        "# sees the width. The depth is the size along the line of sight of the camera.",
        "[specimen]",
        f"name = {json.dumps(name or folder.name or 'beam')}",
        f"material = {json.dumps(material or 'not given')}",
        *(f"{key} = {value:g}" for key, value in sizes.items()),
        "",
        "[tip_load]    # where the thread of the weights is attached",
        *thread,
        "y_mm = 0.0",
        "",
        "[uncertainty]    # standard uncertainties",
        *(f"{key} = {value:g}" for key, value in sigmas.items()),
        f"density_kg_m3 = {DENSITY_SIGMA_KG_M3:g}    # assumed",
    ]
    return "\n".join(lines) + "\n"


def saved(
    folder: Path, clicked: Mapping[str, Any], beam: Mapping[str, Any], grams: Mapping[str, Any], replace: bool
) -> dict[str, Any]:
    """Write specimen.toml, calibration.toml and states.csv beside the photographs, and make the dataset.

    Parameters
    ----------
    folder : Path
        The folder of the photographs.
    clicked : mapping
        The clicked points in pixels of the first photograph, and the typed values about the ruler and the camera.
    beam : mapping
        The typed sizes and the density of the beam.
    grams : mapping
        The mass of the weight in each photograph (g), by the name of the photograph; 0 for a beam without a weight.
        Photographs without a typed mass are left out.
    replace : bool
        Whether existing files are replaced.

    Returns
    -------
    dict
        The names of the written files and of the dataset, the number of load steps, and the numbers of the calibration
        with their sources.

    Raises
    ------
    InputError
        If a number is wrong or missing, if a file exists and ``replace`` is false, or if the dataset cannot be made. A
        file that did not exist before does not exist afterwards.
    """
    specimen_text = _specimen_text(beam, folder)
    specimen = parse(SpecimenFile, specimen_text, SPECIMEN)
    measured = _measured(folder, clicked, specimen)
    names = [picture.name for picture in _pictures(folder)]
    weighed = [(name, _number(grams, name)) for name in names if _typed(grams, name)]
    if len({weight for _, weight in weighed}) < 2:
        raise InputError(
            "the folder needs at least two pictures with different weights; type the grams in each picture, 0 for no "
            "weight"
        )
    calibration = measured.calibration
    if weighed[0][0] != names[0] and calibration.picture is not None and calibration.picture.along_px:
        raise InputError(
            f"{names[0]}: points along the beam were clicked on this picture; type also the weight on the beam, in "
            "grams"
        )
    forces_N = {name: f"{N_PER_GRAM * weight:.7g}" for name, weight in weighed}
    texts = {
        SPECIMEN: specimen_text,
        CALIBRATION: calibration.text,
        STATES: states_text(folder, "tip_force_N", forces_N, OF_COIL),
    }
    target = folder / dataset_name(folder)
    for name in (*texts, target.name):
        refuse_existing(folder / name, replace)
    new = [folder / name for name in texts if not (folder / name).exists()]
    try:
        for name, text in texts.items():
            write_file(folder / name, text, replace)
        states = import_frames(
            folder,
            folder / STATES,
            load_specimen(folder / SPECIMEN),
            load_calibration(folder / CALIBRATION),
            target,
            replace,
        )
    except BaseException:
        for file in new:
            remove(file)
        raise
    return {"written": list(texts), "states": states, "dataset": target.name, "sources": _shown(measured)}

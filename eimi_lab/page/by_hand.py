"""Process images that were taken without the instruments of this program.

On the live web page, a person drags the marks of the calibration into place in an image and types the currents.
"""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path
from typing import Any

from eimi_drivers.cameras.image_series import natural_key
from eimi_lab.config.calibration import Calibration, load_calibration
from eimi_lab.config.specimen import load_specimen
from eimi_lab.config.toml import check, to_toml
from eimi_lab.dataset.importing import import_frames
from eimi_lab.page.data_folder import DataFolder
from eimi_lab.page.eye import edges_in
from eimi_lab.page.states_table import STATES, states_text, written_states
from eimi_lab.page.stored_runs import jpeg
from eimi_lab.process.errors import InputError
from eimi_lab.process.outputs import refuse_existing, write_file
from eimi_lab.process.paths import followed
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edges.region import region_of
from eimi_lab.vision.image_files import ENDINGS, find_images, read_image

CALIBRATION = "calibration.toml"
EDITED = (
    *("pixels_per_mm", "coil_constant_mT_per_A", "clamp_midpoint_px", "axis_angle_deg", "gravity_angle_deg"),
    *("field_angle_deg", "picture"),
)
"""The keys of a calibration that the page can change."""

OF_FIELDS = ("field_mT", "field_sigma_mT")
"""Columns of states.csv that a table with currents must not have."""

MOST_FOLDERS = 200
WIDEST_PX = 1600


def folders(folder: DataFolder) -> list[str]:
    """Return the names of the folders that contain images, in the data folder and two levels below."""
    names = []
    for path in sorted({folder.root, *folder.root.glob("*/"), *folder.root.glob("*/*/")})[:MOST_FOLDERS]:
        name = folder.name_of(path)
        hidden = any(part.startswith(".") for part in Path(name).parts)
        if not hidden and followed(path).is_relative_to(folder.root) and _has_pictures(path):
            names.append(name)
    return names


def _has_pictures(path: Path) -> bool:
    try:
        return any(file.suffix.lower() in ENDINGS and not file.name.startswith(".") for file in path.iterdir())
    except OSError:  # the folder of another user, such as lost+found
        return False


def opened(path: Path) -> dict[str, Any]:
    """Return the names of the images in a folder, and the currents and the calibration from the files in the folder.

    Without a calibration file, the calibration is a first guess.

    Raises
    ------
    InputError
        If the folder contains no image, or if a file cannot be read.
    """
    images = _in_order(path)
    height, width = read_image(images[0]).shape[:2]
    rows = written_states(path)
    return {
        "pictures": [image.name for image in images],
        "size_px": [width, height],
        "currents": {name: row["current_A"] for name, row in rows.items() if row.get("current_A")},
        "calibration": _written_calibration(path / CALIBRATION) or _guess(width, height),
        "written": [name for name in (CALIBRATION, STATES) if (path / name).exists()],
    }


def _in_order(path: Path) -> list[Path]:
    return sorted(find_images(path), key=lambda file: natural_key(file.name))


def _guess(width: int, height: int) -> dict[str, Any]:
    """Return a first guess of the calibration for an image of `width` by `height` pixels."""
    return {
        "pixels_per_mm": round(height / 60.0, 3),
        "coil_constant_mT_per_A": 1.0,
        "clamp_midpoint_px": [round(width / 2.0, 1), round(height / 6.0, 1)],
        "axis_angle_deg": 90.0,
        "gravity_angle_deg": 90.0,
        "field_angle_deg": 0.0,
    }


def _written_calibration(file: Path) -> dict[str, Any] | None:
    if not file.is_file():
        return None
    table = load_calibration(file).model_dump(mode="json", exclude_none=True)
    return {key: table[key] for key in EDITED if key in table}


def _stated(folder: Path, changes: dict[str, Any]) -> Calibration:
    """Return the calibration of a folder with the values (`changes`) that a person gave on the web page."""
    file = folder / CALIBRATION
    edited = {key: value for key, value in changes.items() if key in EDITED}
    return load_calibration(file, edited) if file.is_file() else check(Calibration, edited, "", "calibration")


def picture(path: Path) -> bytes:
    """Return an image as JPEG of limited width.

    Raises
    ------
    InputError
        If the image cannot be read.
    """
    return jpeg(_image(path, path.stat().st_mtime_ns), WIDEST_PX)


@lru_cache(maxsize=4)
def _image(path: Path, changed_ns: int) -> Any:
    return read_image(path)


def edges(path: Path, calibration: dict[str, Any], specimen: str) -> dict[str, Any]:
    """Find the edges of the beam in an image, and return a JSON object.

    Parameters
    ----------
    path : Path
        The image.
    calibration : dict
        The values that a person gave on the page, by their keys in calibration.toml.
    specimen : str
        The specimen file.

    Returns
    -------
    dict
        The two edges (pixels), the angle of the tip with its standard uncertainty (degrees), the blur with its limit
        (pixels), and the flags (failed quality checks).

    Raises
    ------
    InputError
        If the image, the specimen or the calibration cannot be used.
    """
    whole = _stated(path.parent, calibration)  # calibration of the whole image
    beam = load_specimen(specimen)
    if whole.picture is not None and path != _in_order(path.parent)[0]:  # the points along the beam are on the first
        whole = whole.model_copy(update={"picture": whole.picture.model_copy(update={"along_px": None})})
    image = _image(path, path.stat().st_mtime_ns)
    region = region_of(whole, image.shape)
    cut, calibration_of_cut = (region.cut(image), region.calibration) if region else (image, whole)
    return edges_in(cut, calibration_of_cut, beam, BeamFrame(whole))


def saved(path: Path, calibration: dict[str, Any], currents: dict[str, Any], replace: bool) -> dict[str, Any]:
    """Write the calibration (calibration.toml) and the currents (states.csv) into a folder of images.

    Parameters
    ----------
    path : Path
        The folder.
    calibration : dict
        The values that a person gave on the page, by their keys in calibration.toml.
    currents : dict
        The current (A) of each image, by the name of the image. Images without a current are left out.
    replace : bool
        Whether existing files are replaced. Other columns of an existing states.csv stay.

    Returns
    -------
    dict
        The names of the written files, and the number of images with a current.

    Raises
    ------
    InputError
        If a file exists and ``replace`` is false, if no image has a current, or if a current is not a number.
    """
    new_calibration = _stated(path, calibration)
    names = [image.name for image in find_images(path)]
    typed = {name: _current(name, currents[name]) for name in names if str(currents.get(name, "")).strip()}
    if not typed:
        raise InputError(f"{path.name}: no picture has a current; enter the current of at least one picture")
    for name in (CALIBRATION, STATES):
        refuse_existing(path / name, replace)
    texts = {CALIBRATION: to_toml(new_calibration), STATES: states_text(path, "current_A", typed, OF_FIELDS)}
    for name, text in texts.items():
        write_file(path / name, text, replace)
    return {"written": list(texts), "states": len(typed)}


def _current(name: str, text: Any) -> str:
    try:
        value = float(str(text).replace(",", "."))
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{name}: current_A = {text!r} should be a number")
    return f"{value:g}"


def dataset_of(path: Path, specimen: str, target: Path, replace: bool) -> int:
    """Make a dataset from the images of a folder, and return the number of its load steps.

    Parameters
    ----------
    path : Path
        The folder with the images, calibration.toml and states.csv.
    specimen : str
        The specimen file.
    target : Path
        The dataset to write.
    replace : bool
        Whether an existing dataset is replaced.

    Raises
    ------
    InputError
        If a file cannot be read, or if the dataset exists and ``replace`` is false.
    """
    saved_calibration = load_calibration(path / CALIBRATION)
    return import_frames(path, path / STATES, load_specimen(specimen), saved_calibration, target, replace)

"""The layout of a dataset file, in NeXus base classes (https://manual.nexusformat.org/classes/base_classes)."""

from __future__ import annotations

import json
import platform
from dataclasses import astuple, dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, Literal

import h5py
import numpy as np
from numpy.typing import NDArray

from eimi_drivers.interfaces import Identity
from eimi_lab.config.calibration import Calibration
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.config.toml import Document
from eimi_lab.dataset.logged_sensor import LoggedSensor
from eimi_lab.vision.check import Flag, Severity

if TYPE_CHECKING:  # these modules import every driver, which is slow, and reading a dataset does not need them
    from eimi_drivers.cameras.settings import CameraSettings
    from eimi_lab.config.protocol import Protocol
    from eimi_lab.config.rig import Rig

# Groups of the file:
#
# /entry                      NXentry, as the application definition NXsensor_scan requires it
#   title, definition, start_time, program_name; end_time once the edges were stored
#   sample                    NXsample
#   sample/environment        NXenvironment: an NXsensor for each sensor; its NXlog has one row for each frame
#   instrument                NXinstrument: detector (NXdetector), supply (NXcollection of two NXlog)
#   instrument/detector/settings    NXcollection: exposure, gain and other settings that were read back from the camera
#   specimen, calibration, protocol, rig    NXnote: the TOML texts of the run
#   former                    NXcollection of NXnote with a date: specimens and calibrations replaced after the run
#   host                      NXnote: time zone, and versions of the programs that wrote the file
#   user_note                 NXnote: the note that the user gave with --note
#   data                      NXdata: frames (n, H, W) or (n, H, W, 3: red, green, blue), or tracked points; columns
#   states                    NXcollection: one row for each load step; attributes of the group: version of the
#                             format, and whether the dataset holds frames or tracked points
#   transients, ring_down, conditioning    NXdata: frames outside the load steps (`recordings`)
#   set_points, ring_down_steps    NXcollection: times of set-points; one row for each free oscillation (`steps`)
#   ring_down_points, creep_points    NXcollection: motions as points at measured times (`moving.stored_motions`)
#   sessions                  NXcollection: one row for each time that the run was started or resumed
#   correction                NXcollection: dark frame and flat field, if the user gave them
#   segmentation              NXprocess: the edges; the projection of colours with which they were found; and the plots
#                             tip and outline (NXdata)
#   truth                     NXnote: the true materials of a virtual rig, which are used only to score results

WRITTEN_AS = ("v110", "latest")
"""Oldest and newest version of the HDF5 structures in a file. HDF5 1.10 is the first version with the
single-writer-multiple-reader mode. With a newer lower bound, older releases of HDF5 could not read the files.
"""
FORMAT = 1
FORMAT_ATTRIBUTE = "eimi_format"
KIND_ATTRIBUTE = "eimi_kind"
START_ATTRIBUTE = "eimi_start_time"
"""Name of the attribute with the start of the run. The text of the attribute has a fixed length, because HDF5 may
allocate 4 GiB for a damaged text of variable length.
"""
PROGRAM = "eimi-lab"
PROGRAM_URL = "https://doi.org/10.3389/frobt.2021.790571"
"""Paper with the method of the program. NXprocess requires a URL, and the program has no site of its own."""
DEFINITION, DEFINITION_VERSION = "NXsensor_scan", "1.0"
"""Name and version of the NeXus application definition with which a dataset complies."""

Kind = Literal["frames", "points"]

# One row for each state. `index` is written last, so its length is the number of complete states.
STATE_COLUMNS: dict[str, tuple[str, str | None]] = {
    "current": ("f8", "A"),
    "field": ("f8", "mT"),
    "tip_force": ("f8", "N"),
    "flags": ("S4096", None),
    "index": ("i8", None),
}
# One row for each time that a run was started or resumed.
# `end` is empty while the session lasts and after a crash; files of 0.1.0 have no such column.
SESSION_COLUMNS: dict[str, tuple[str, str | None]] = {
    "start": ("S40", None),
    "first_state": ("i8", None),
    "end": ("S40", None),
}
# One row for each frame.
FRAME_COLUMNS: dict[str, tuple[str, str | None]] = {
    "state": ("i8", None),
    "number": ("i8", None),
    "timestamp": ("f8", "s"),
    "time": ("f8", "s"),
    "set_current": ("f8", "A"),
    "measured_current": ("f8", "A"),
    "field": ("f8", "mT"),
}


@dataclass(frozen=True)
class Header:
    """The description of a run or an import, as a dataset stores it before the first load step.

    Parameters
    ----------
    specimen, calibration, protocol, rig
        The input files; None for an absent file.
    instruments
        Identities of the supply, the camera and the sensors.
    truth
        True materials of a virtual rig; None for a real rig.
    note
        The user's note.
    taken
        Time of the first frame in ISO 8601; None for the present time.
    camera_settings
        Settings that were read back from the camera; None for an import.
    without_contact
        What the supply does if its cable is pulled or the computer stops.
    sensors
        The sensors that are read during the run.
    """

    specimen: SpecimenFile
    calibration: Calibration | None = None
    protocol: Protocol | None = None
    rig: Rig | None = None
    instruments: tuple[Identity, ...] = ()
    truth: dict[str, Any] | None = None
    note: str = ""
    taken: str | None = None
    camera_settings: CameraSettings | None = None
    without_contact: str = ""
    sensors: tuple[LoggedSensor, ...] = ()

    @property
    def documents(self) -> dict[str, Document | None]:
        """The input files of a run, by the name of the HDF5 group that stores each text."""
        return {
            "specimen": self.specimen,
            "calibration": self.calibration,
            "protocol": self.protocol,
            "rig": self.rig,
        }


def write_header(file: h5py.File, header: Header) -> h5py.Group:
    """Write the description of a run into a new file, and return the new HDF5 group `entry`."""
    file.attrs["default"] = "entry"
    entry = group(file, "entry", "NXentry")
    entry.attrs["default"] = "data"
    beam = header.specimen.specimen
    put_text(entry, "title", f"{beam.name}, {beam.material}")
    put_definition(entry)
    put_date(entry, "start_time", header.taken or now())
    put_text(entry, "program_name", PROGRAM).attrs["version"] = version(PROGRAM)

    sample = group(entry, "sample", "NXsample")
    put_text(sample, "name", beam.name)
    put_text(sample, "description", beam.material)

    instrument = group(entry, "instrument", "NXinstrument")
    put_text(instrument, "name", header.rig.name if header.rig else "imported")
    for number, identity in enumerate(header.instruments):
        note(instrument, f"identity_{number}", identity_text(identity), "text/plain")

    for name, document in header.documents.items():
        if document is not None:
            note(entry, name, document.text, "application/toml")
    if header.truth is not None:
        note(entry, "truth", json.dumps(header.truth), "application/json")
    note(entry, "host", json.dumps(host()), "application/json")
    if header.note:
        note(entry, "user_note", header.note, "text/plain")
    return entry


def to_stored(image: NDArray[Any]) -> NDArray[Any]:
    """Exchange the colours blue and red of an image; an image without colours is returned unchanged."""
    return image if image.ndim == 2 else image[..., ::-1]


def identity_text(identity: Identity) -> str:
    """Return driver, identification and address of an instrument as one line of text."""
    return f"{identity.driver}: {identity.text} at {identity.address}"


def host() -> dict[str, str]:
    """Return the time zone, and the versions of eimi-lab, Python, h5py, HDF5 and NumPy, by name."""
    local = datetime.now().astimezone()
    return {
        "time_zone": f"{local:%Z} (UTC{local:%z})",
        PROGRAM: version(PROGRAM),
        "python": platform.python_version(),
        "h5py": h5py.__version__,
        "hdf5": h5py.version.hdf5_version,
        "numpy": np.__version__,
    }


def write_state_columns(entry: h5py.Group, kind: Kind) -> dict[str, h5py.Dataset]:
    """Create the empty table of load steps in a new dataset, and return its columns by name.

    ``kind`` is "frames" for a dataset of frames, and "points" for a dataset of tracked points.
    """
    states = group(entry, "states", "NXcollection")
    states.attrs[FORMAT_ATTRIBUTE] = FORMAT
    states.attrs[KIND_ATTRIBUTE] = kind
    states.attrs[START_ATTRIBUTE] = np.bytes_(entry["start_time"][()])
    return columns(states, STATE_COLUMNS)


def columns(parent: h5py.Group, described: dict[str, tuple[str, str | None]]) -> dict[str, h5py.Dataset]:
    """Create the empty columns of a table in a dataset file, and return them by name.

    Parameters
    ----------
    parent
        The HDF5 group that gets the columns.
    described
        Type and unit (or None) of each column by name.
    """
    created = {}
    for name, (dtype, unit) in described.items():
        created[name] = parent.create_dataset(
            name,
            shape=(0,),
            maxshape=(None,),
            chunks=(64,),
            dtype=dtype,
            compression="gzip",
            compression_opts=1,
            fletcher32=True,
        )
        if unit:
            created[name].attrs["units"] = unit
    return created


def frame_stack(parent: h5py.Group, name: str, image: NDArray[Any]) -> h5py.Dataset:
    """Create an empty HDF5 array of frames, to which frames like the example ``image`` can be appended."""
    frames = parent.create_dataset(
        name,
        shape=(0, *image.shape),
        maxshape=(None, *image.shape),
        chunks=(1, *image.shape),
        dtype=image.dtype,
        compression="gzip",
        compression_opts=1,
        fletcher32=True,
    )
    frames.attrs["units"] = "counts"
    if image.ndim == 3:
        frames.attrs["interpretation"] = "rgb-image"
    return frames


def append(column: h5py.Dataset, rows: Any) -> None:
    """Append rows to a column of a dataset file."""
    count = len(column)
    column.resize(count + len(rows), axis=0)
    column[count:] = rows


def group(parent: h5py.Group, name: str, nx_class: str) -> h5py.Group:
    """Create an HDF5 group of a NeXus class, and return the group."""
    created = parent.create_group(name)
    created.attrs["NX_class"] = nx_class
    return created


def note(parent: h5py.Group, name: str, text: str, media_type: str) -> None:
    """Create an NXnote (a NeXus group for a text) in an HDF5 group.

    ``media_type`` is the type of the text, such as "application/toml".
    """
    created = group(parent, name, "NXnote")
    put_text(created, "type", media_type)
    put_text(created, "data", text)


def put_text(parent: h5py.Group, name: str, text: str) -> h5py.Dataset:
    """Store a text in UTF-8 with a fixed length, and return the HDF5 dataset that contains it."""
    # HDF5's single-writer-multiple-reader mode does not allow texts of variable length
    raw = text.encode() or b"\0"
    return parent.create_dataset(name, data=np.array(raw, dtype=h5py.string_dtype("utf-8", len(raw))))


def put_date(parent: h5py.Group, name: str, date: str) -> h5py.Dataset:
    """Store a date as a text of variable length, and return the HDF5 dataset that contains it."""
    return parent.create_dataset(name, data=date, dtype=h5py.string_dtype())


def get_start(entry: h5py.Group) -> str:
    """Return the time at which a run started, in ISO 8601. Raises ValueError if the file does not contain the time."""
    attributes = entry["states"].attrs
    if START_ATTRIBUTE in attributes and attributes.get_id(START_ATTRIBUTE).dtype.kind == "S":
        return bytes(attributes[START_ATTRIBUTE]).decode()
    if entry["start_time"].dtype.hasobject:
        raise ValueError(
            f"the attribute {START_ATTRIBUTE} of the group entry/states, the time at which the run began, is missing"
        )
    return get_text(entry, "start_time")


def put_definition(entry: h5py.Group) -> None:
    """Store the name and the version of the NeXus application definition with which a dataset complies."""
    put_text(entry, "definition", DEFINITION).attrs["version"] = DEFINITION_VERSION


def get_text(parent: h5py.Group, name: str) -> str:
    """Return a text that `put_text` or `put_date` stored in an HDF5 group."""
    return bytes(parent[name][()]).rstrip(b"\0").decode()


def now() -> str:
    """Return the present time in UTC, as ISO 8601."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def flags_to_text(flags: tuple[Flag, ...]) -> bytes:
    """Return the flags (defects) of a load step as JSON in UTF-8. Raises ValueError if the JSON is too long."""
    text = json.dumps([list(astuple(flag)) for flag in flags]).encode()
    width = np.dtype(STATE_COLUMNS["flags"][0]).itemsize
    if len(text) > width:
        raise ValueError(
            f"the {len(flags)} flags of a state need {len(text)} bytes as JSON, but a dataset has room for {width} "
            "bytes"
        )
    return text


def flags_from_text(text: bytes) -> tuple[Flag, ...]:
    """Return the flags (defects) of a load step from JSON that `flags_to_text` returned."""
    return tuple(Flag(*fields[:4], *map(Severity, fields[4:5]), *fields[5:]) for fields in json.loads(text))

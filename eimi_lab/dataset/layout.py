"""Where things are in a dataset file. NeXus base classes throughout (https://manual.nexusformat.org/classes/base_classes).

/entry                      NXentry
  title, start_time, end_time, program_name
  sample                    NXsample
  instrument                NXinstrument: detector (NXdetector), supply (NXcollection of two NXlog)
  instrument/detector/settings    NXcollection: exposure, gain and what else the camera read back
  specimen, calibration, protocol, rig    NXnote: the TOML texts as they were
  former                    NXcollection of NXnote with a date: specimens and calibrations that others took the place of
  host                      NXnote: time zone and versions of what wrote the file
  user_note                 NXnote: what the user had to say
  data                      NXdata: frames (n, H, W), or (n, H, W, 3: red, green, blue), or tracked points, with columns
  states                    NXcollection: one row a state; its attributes tell the format and the kind
  transients, release, conditioning    NXdata: frames between the states, see `recordings`; where the protocol asks
  sessions                  NXcollection: one row for every time that the run was begun or resumed
  correction                NXcollection: dark frame and flat field, where somebody gave them
  segmentation              NXprocess: edges, once they were found; how colours were projected for that; and tip and
                            outline (NXdata), which a viewer then shows first
  truth                     NXnote: what a virtual rig was made of; for scoring alone
"""

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
from eimi_lab.vision.check import Flag, Severity

if TYPE_CHECKING:  # what knows every driver is slow to load, and who reads a dataset does without
    from eimi_drivers.cameras.settings import CameraSettings
    from eimi_lab.config.protocol import Protocol
    from eimi_lab.config.rig import Rig

FORMAT = 1
FORMAT_ATTRIBUTE = "eimi_format"
KIND_ATTRIBUTE = "eimi_kind"
PROGRAM = "eimi-lab"

Kind = Literal["frames", "points"]

# One row a state. `index` is written last: its length is the number of states that are complete.
STATE_COLUMNS: dict[str, tuple[str, str | None]] = {
    "current": ("f8", "A"),
    "field": ("f8", "mT"),
    "tip_force": ("f8", "N"),
    "flags": ("S4096", None),
    "index": ("i8", None),
}
# One row for each time that a run was begun or resumed.
SESSION_COLUMNS: dict[str, tuple[str, str | None]] = {"start": ("S40", None), "first_state": ("i8", None)}
# One row a frame, beside the frames themselves.
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
    """What a dataset says of itself. A quantity that an imported dataset does not know is None.

    taken: when the first frame was taken, ISO 8601; None where that is now. camera_settings: as read back.
    without_contact: what would have become of the coil where the cable was pulled or the computer died, in words.
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

    @property
    def documents(self) -> dict[str, Document | None]:
        """The TOML documents by the names under which a dataset keeps their texts."""
        return {
            "specimen": self.specimen,
            "calibration": self.calibration,
            "protocol": self.protocol,
            "rig": self.rig,
        }


def write_header(file: h5py.File, header: Header) -> h5py.Group:
    """Create everything that is known before the first state; returns the entry."""
    file.attrs["default"] = "entry"
    entry = group(file, "entry", "NXentry")
    entry.attrs["default"] = "data"
    beam = header.specimen.specimen
    put_text(entry, "title", f"{beam.name}, {beam.material}")
    put_text(entry, "start_time", header.taken or now())
    put_text(entry, "end_time", " " * 40)
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
    """An image (H, W) or (H, W, 3) in the order of colours of a file, red first as NeXus has it, not blue; and back."""
    return image if image.ndim == 2 else image[..., ::-1]


def identity_text(identity: Identity) -> str:
    """An instrument in one line, as a dataset keeps it."""
    return f"{identity.driver}: {identity.text} at {identity.address}"


def host() -> dict[str, str]:
    """The time zone and the versions of what writes the file."""
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
    """Create the empty table of states."""
    states = group(entry, "states", "NXcollection")
    states.attrs[FORMAT_ATTRIBUTE] = FORMAT
    states.attrs[KIND_ATTRIBUTE] = kind
    return columns(states, STATE_COLUMNS)


def columns(parent: h5py.Group, described: dict[str, tuple[str, str | None]]) -> dict[str, h5py.Dataset]:
    """Create empty columns that grow."""
    made = {}
    for name, (dtype, unit) in described.items():
        made[name] = parent.create_dataset(
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
            made[name].attrs["units"] = unit
    return made


def frame_stack(parent: h5py.Group, name: str, image: NDArray[Any]) -> h5py.Dataset:
    """Create a stack of frames like (H, W) or (H, W, 3) `image` that grows, without any."""
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
    """Add rows at the end of a column."""
    count = len(column)
    column.resize(count + len(rows), axis=0)
    column[count:] = rows


def group(parent: h5py.Group, name: str, nx_class: str) -> h5py.Group:
    """Create a group of a NeXus class."""
    made = parent.create_group(name)
    made.attrs["NX_class"] = nx_class
    return made


def note(parent: h5py.Group, name: str, text: str, media_type: str) -> None:
    """Create an NXnote."""
    made = group(parent, name, "NXnote")
    put_text(made, "type", media_type)
    put_text(made, "data", text)


def put_text(parent: h5py.Group, name: str, text: str) -> h5py.Dataset:
    """Create a UTF-8 text of fixed length: a file under single-writer-multiple-reader bears no other kind."""
    raw = text.encode() or b"\0"
    return parent.create_dataset(name, data=np.array(raw, dtype=h5py.string_dtype("utf-8", len(raw))))


def get_text(parent: h5py.Group, name: str) -> str:
    """Read a text back."""
    return bytes(parent[name][()]).rstrip(b"\0").decode()


def now() -> str:
    """The time in ISO 8601, in UTC."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def flags_to_text(flags: tuple[Flag, ...]) -> bytes:
    """Flags as JSON, for a column of fixed width."""
    text = json.dumps([list(astuple(flag)) for flag in flags]).encode()
    width = np.dtype(STATE_COLUMNS["flags"][0]).itemsize
    if len(text) > width:
        raise ValueError(f"{len(flags)} flags need {len(text)} bytes; a state has {width}")
    return text


def flags_from_text(text: bytes) -> tuple[Flag, ...]:
    """The inverse of `flags_to_text`; a flag of earlier versions has no severity, and made its state unusable."""
    return tuple(Flag(*fields[:4], *map(Severity, fields[4:5]), *fields[5:]) for fields in json.loads(text))

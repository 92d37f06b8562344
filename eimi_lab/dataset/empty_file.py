"""The initial contents of a dataset of frames: the description of the run, and empty tables."""

from __future__ import annotations

import io
from typing import Any

import h5py
from numpy.typing import NDArray

from eimi_lab.dataset.layout import (
    FRAME_COLUMNS,
    SESSION_COLUMNS,
    WRITTEN_AS,
    Header,
    columns,
    frame_stack,
    group,
    put_text,
    write_header,
    write_state_columns,
)
from eimi_lab.dataset.recordings import make_recordings, planned
from eimi_lab.dataset.sensor_logs import make_sensor_logs
from eimi_lab.dataset.steps import make_steps


def empty_file(header: Header, image: NDArray[Any]) -> bytes:
    """Return the bytes of a dataset file that contains the description of a run, and no frames yet.

    Parameters
    ----------
    header
        Description of the run.
    image
        An example frame, shape (H, W) or (H, W, 3). All frames will have its shape and type.
    """
    # HDF5 can crash when it writes to a full disk, so the file is made in memory
    memory = io.BytesIO()
    with h5py.File(memory, "w", libver=WRITTEN_AS) as file:
        entry = write_header(file, header)
        detector = group(entry["instrument"], "detector", "NXdetector")
        frames = frame_stack(detector, "data", image)
        put_text(detector, "description", "side camera")
        if header.camera_settings and (settings := header.camera_settings.chosen()):
            read_back = group(detector, "settings", "NXcollection")
            for name, value in settings.items():
                read_back[name] = value

        data = group(entry, "data", "NXdata")
        data.attrs["signal"] = "frames"
        data.attrs["axes"] = ["field"] + ["."] * image.ndim
        data["frames"] = frames
        of_frame = columns(data, FRAME_COLUMNS)

        supply = group(entry["instrument"], "supply", "NXcollection")
        if header.without_contact:
            put_text(supply, "without_contact", header.without_contact)
        for name in ("set_current", "measured_current"):
            log = group(supply, name, "NXlog")
            log["time"] = of_frame["time"]
            log["value"] = of_frame[name]

        make_sensor_logs(entry, header.sensors)
        columns(group(entry, "sessions", "NXcollection"), SESSION_COLUMNS)
        make_recordings(entry, planned(header.protocol), image)
        make_steps(entry, header.protocol)
        write_state_columns(entry, "frames")
    return memory.getvalue()

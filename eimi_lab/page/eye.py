"""Two processes for the live web page: one encodes the frames of a run as JPEG, the other finds edges in the frames."""

from __future__ import annotations

import json
import os
import struct
import sys
import time
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_lab.config.calibration import Calibration
from eimi_lab.config.rig import load_rig
from eimi_lab.config.specimen import SpecimenFile, load_specimen
from eimi_lab.page.frame_memory import FrameMemory, NewestFrame
from eimi_lab.page.stored_runs import finite, in_pixels, jpeg, shown_flags
from eimi_lab.process.detached import give_way
from eimi_lab.process.pipes import readable, received
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edges.edge_set import tip_angle_deg, tip_angle_sigma_deg
from eimi_lab.vision.edges.finding import find_edges
from eimi_lab.vision.flags import CHECK_OF
from eimi_lab.vision.intensity import full_scale

SIZES = struct.Struct(">II")
"""Header of each message to the server: the sizes of its JSON and of its JPEG in bytes."""

BINS = 32
WIDEST_PX = 960
SATURATED = 0.998  # share of full scale from which a pixel counts as saturated
FRAMES, EDGES = "frames", "edges"  # names of the tasks of the two processes
GIVES_WAY = 3  # number that is added to the nice value
SHORTEST_PAUSE_S = 0.01
_BLUR = CHECK_OF["blur_px"]
_EDGES_SHARE = 0.5  # largest share of the time that the search for edges takes


def show_frames(memory: int, bell: int, rig: str) -> None:
    """Write every new frame as JPEG to standard output until the pipe `bell` is closed.

    Parameters
    ----------
    memory : int
        File descriptor of the shared memory with the newest frame.
    bell : int
        Reading end of a pipe. A byte in the pipe announces a new frame.
    rig : str
        The rig file, which lists the instruments.
    """
    calibration, frames, last = load_rig(rig).calibration, FrameMemory(memory), 0
    while True:
        if not os.read(bell, 4096):
            return
        frame = frames.read(last)
        if frame is not None:
            last = frame.number
            _send(_described(frame, calibration), jpeg(frame.image, WIDEST_PX))


def find_in_frames(memory: int, until_closed: int, rig: str, specimen: str) -> None:
    """Find edges in the newest frame and write them to standard output, repeatedly, until a pipe is closed.

    Parameters
    ----------
    memory : int
        File descriptor of the shared memory with the newest frame.
    until_closed : int
        Reading end of the pipe.
    rig, specimen : str
        The rig file (which lists the instruments) and the specimen file.
    """
    calibration, beam, frames = load_rig(rig).calibration, load_specimen(specimen), FrameMemory(memory)
    place, last, pause_s, going_on = BeamFrame(calibration), 0, SHORTEST_PAUSE_S, True
    while going_on:
        going_on = not readable(until_closed, pause_s)
        frame = frames.read(last)
        if frame is None or frame.kept > 1:
            continue
        last, began = frame.number, time.monotonic()
        _send({"kind": "edges", "seen": last, **edges_in(frame.image, calibration, beam, place)})
        pause_s = max(SHORTEST_PAUSE_S, (time.monotonic() - began) * (1 / _EDGES_SHARE - 1))


def _described(frame: NewestFrame, calibration: Calibration) -> dict[str, Any]:
    height, width = frame.image.shape[:2]
    current_A = frame.about["measured_A"] if frame.about["on"] else 0.0
    return {
        "kind": "frame",
        "seen": frame.number,
        "size_px": [width * frame.kept, height * frame.kept],
        "field_mT": current_A * calibration.mT_per_A,
        **light(frame.image),
        **frame.about,
    }


def light(image: NDArray[Any]) -> dict[str, Any]:
    """Return the histogram of the grey levels and the share of saturated pixels of an image, as a JSON object.

    The image of H by W pixels has the shape (H, W), or (H, W, 3) with three colours.
    """
    some = image[::4, ::4] if image.size > 1 << 18 else image
    # A single saturated channel displaces an edge.
    brightest = some if some.ndim == 2 else some.max(axis=2)
    most = 255.0 if image.dtype == np.uint8 else full_scale(image)
    counts = np.histogram(brightest, bins=BINS, range=(0.0, most))[0]
    return {
        "histogram": np.round(counts / brightest.size, 5).tolist(),
        "saturated_share": float(np.mean(brightest >= SATURATED * most)),
    }


def edges_in(image: NDArray[Any], calibration: Calibration, specimen: SpecimenFile, place: BeamFrame) -> dict[str, Any]:
    """Find the edges of the beam in an image, and return them with the blur of the image as a JSON object.

    Parameters
    ----------
    image : ndarray, shape (H, W) or (H, W, 3)
        The image of H by W pixels.
    calibration : Calibration
        The calibration of this image.
    specimen : SpecimenFile
        The specimen.
    place : BeamFrame
        Conversion from positions on the beam (mm) to pixels of the result.

    Returns
    -------
    dict
        The two edges (pixels), the angle of the tip with its standard uncertainty (degrees), the blur with its limit
        (pixels), and the flags (failed quality checks). None stands for a value that cannot be measured.
    """
    edge_set = find_edges(image, calibration, specimen, limits={"blur_px": 0.0})
    blur = next((flag for flag in edge_set.flags if flag.name == _BLUR.name and flag.limit == 0.0), None)
    flags = tuple(flag for flag in edge_set.flags if flag is not blur)
    shown = in_pixels(edge_set, place)
    shown["flags"] = shown_flags(flags + ((_BLUR.flag(blur.value),) if blur and blur.value > _BLUR.limit else ()))
    return {
        **shown,
        "tip_angle_deg": finite(tip_angle_deg(edge_set)),
        "tip_angle_sigma_deg": finite(tip_angle_sigma_deg(edge_set)),
        "blur_px": blur.value if blur else None,
        "blur_limit_px": _BLUR.limit,
    }


def _send(about: dict[str, Any], picture: bytes = b"") -> None:
    text = json.dumps(about).encode()
    sys.stdout.buffer.write(SIZES.pack(len(text), len(picture)) + text + picture)
    sys.stdout.buffer.flush()


if __name__ == "__main__":
    what, memory, until, *rest = sys.argv[1:]
    with suppress(BrokenPipeError, KeyboardInterrupt):  # the page has ended
        if what == FRAMES:
            give_way(GIVES_WAY)
            show_frames(received(memory), received(until), *rest)
        else:
            give_way(2 * GIVES_WAY)
            find_in_frames(received(memory), received(until), *rest)

"""Find the times at which the frames of a video were recorded, also for videos in slow motion.

The camera program of Android stores the recording rate with the key `com.android.capture.fps` in `moov` / `meta`
(ISO/IEC 14496-12; QuickTime File Format Specification, "Metadata Item Keys Atom").
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eimi_lab.process.errors import InputError, tell

Array = NDArray[np.float64]

_KEY = b"com.android.capture.fps"
_FLOAT, _DOUBLE = 23, 24  # codes of the types of a metadata value
_MOST_BYTES = 1 << 20  # assumed largest size of a header, which contains no frames
_SLOWEST_HZ, _FASTEST_HZ = 1.0, 1e5
_USUAL_HZ = 61.0  # highest usual rate at which a video is played
_SAME = 0.02  # largest relative difference of two rates that count as equal


def recorded_times(path: Path, stored_s: Array, rate_Hz: float | None) -> Array:
    """Return the times at which the frames of a video were recorded, in s from the first frame, shape (n,).

    Parameters
    ----------
    path : Path
        The video.
    stored_s : ndarray, shape (n,)
        Playback times of the n frames, from the file.
    rate_Hz : float, optional
        Frames per second of the recording; by default the rate in the file or, without it, that of the playback.

    Raises
    ------
    InputError
        If the times in the file do not increase and no rate is given.
    """
    steps_s = np.diff(stored_s)
    interval_s = float(np.median(steps_s)) if len(steps_s) else 0.0
    if interval_s <= 0.0 or (steps_s <= 0.0).any():
        if rate_Hz is None:
            raise InputError(
                f"{path}: the times of the frames in the file do not increase; give the frames per second with --rate"
            )
        return np.arange(len(stored_s)) / rate_Hz
    played_Hz = 1.0 / interval_s
    captured_Hz = capture_rate_Hz(path)
    if rate_Hz is not None:
        return np.asarray((stored_s - stored_s[0]) * played_Hz / rate_Hz)
    if captured_Hz is not None and abs(captured_Hz / played_Hz - 1.0) > _SAME:
        tell(
            f"note: {path}: is played at {played_Hz:.4g} and was recorded at {captured_Hz:.4g} frames per second "
            "(com.android.capture.fps in the file); the times of the recording are used; if the rate of the recording "
            "is wrong, give it with --rate"
        )
        return np.asarray((stored_s - stored_s[0]) * played_Hz / captured_Hz)
    advice = "" if played_Hz > _USUAL_HZ else "; if this is slow motion, give the rate of the recording with --rate"
    tell(f"note: {path}: has {played_Hz:.4g} frames per second according to the times in the file{advice}")
    return np.asarray(stored_s - stored_s[0])


def capture_rate_Hz(path: Path) -> float | None:
    """Return the frame rate (Hz) of a recording that its MP4 file contains; None without such a rate."""
    try:
        header = _boxes(path)
    except (OSError, OverflowError, ValueError, struct.error):
        return None
    at = header.find(_KEY)
    if at < 0:
        return None
    keys = header.rfind(b"keys", 0, at)
    number, place = 1, keys + 12
    while keys >= 0 and place < at - 8:  # each key begins with its size
        (size,) = struct.unpack_from(">I", header, place)
        if size < 8:
            return None
        number, place = number + 1, place + size
    return _value(header, number)


def _boxes(path: Path) -> bytes:
    """Return the block of metadata (box `moov`) of an MP4 file, at most 16 MiB; empty without this block."""
    with path.open("rb") as file:
        while head := file.read(16):
            if len(head) < 8:
                break
            size, name = struct.unpack_from(">I4s", head)
            if size == 1 and len(head) == 16:
                (size,) = struct.unpack_from(">Q", head, 8)
            if name == b"moov":
                file.seek(-len(head), 1)
                return file.read(min(size or _MOST_BYTES, 16 * _MOST_BYTES))
            if size < 8:
                break
            file.seek(size - len(head), 1)
    return b""


def _value(header: bytes, number: int) -> float | None:
    """Return the rate (Hz) that an MP4 file stores under its metadata key ``number`` (from 1); None if implausible.

    ``header`` is the block of metadata (box `moov`).
    """
    items = header.find(b"ilst")
    while items >= 0:
        at = header.find(struct.pack(">I", number), items)
        while 0 <= at < items + _MOST_BYTES:
            if header[at + 8 : at + 12] == b"data" and at + 24 <= len(header):
                (kind,) = struct.unpack_from(">I", header, at + 12)
                form = {_FLOAT: ">f", _DOUBLE: ">d"}.get(kind)
                if form and at + 20 + struct.calcsize(form) <= len(header):
                    (rate,) = struct.unpack_from(form, header, at + 20)
                    return float(rate) if _SLOWEST_HZ <= rate <= _FASTEST_HZ else None
                return None
            at = header.find(struct.pack(">I", number), at + 1)
        items = header.find(b"ilst", items + 4)
    return None

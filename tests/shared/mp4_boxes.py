"""Change the data of an MP4 file about its frames: times, rate of the recording and orientation (ISO/IEC 14496-12)."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path

_TURNS = {0: (1, 0, 0, 1), 90: (0, 1, -1, 0), 180: (-1, 0, 0, -1), 270: (0, -1, 1, 0)}


def state_times(path: Path, times_s: Sequence[float]) -> None:
    """Write the time (s) of every frame into a video file from OpenCV.

    times_s : increasing, the first is 0
    """
    content = path.read_bytes()
    mdhd = content.index(b"mdhd")
    (per_s,) = struct.unpack_from(">I", content, mdhd + 16)  # before the time scale: version, flags, two dates
    ticks = [round(time * per_s) for time in times_s]
    last = ticks[-1] - ticks[-2] if len(ticks) > 1 else 1
    lengths = [after - before for before, after in pairwise(ticks)] + [last]
    entries = b"".join(struct.pack(">II", 1, length) for length in lengths)
    table = struct.pack(">II", 0, len(lengths)) + entries
    _rewrite(path, (b"moov", b"trak", b"mdia", b"minf", b"stbl"), b"stts", lambda _: table)
    mvhd = content.index(b"mvhd")
    (of_movie,) = struct.unpack_from(">I", content, mvhd + 16)
    length, of_media = round(sum(lengths) * of_movie / per_s), sum(lengths)

    def put(at: int, value: int) -> Callable[[bytes], bytes]:
        return lambda body: body[:at] + struct.pack(">I", value) + body[at + 4 :]

    _rewrite(path, (b"moov",), b"mvhd", put(16, length))
    _rewrite(path, (b"moov", b"trak"), b"tkhd", put(20, length))
    _rewrite(path, (b"moov", b"trak", b"edts"), b"elst", put(8, length))
    _rewrite(path, (b"moov", b"trak", b"mdia"), b"mdhd", put(16, of_media))


def state_capture_rate(path: Path, rate_Hz: float) -> None:
    """Write the frame rate (Hz) of the recording into a video file, as Android does for slow motion."""
    name = b"com.android.capture.fps"
    handler = _box(b"hdlr", struct.pack(">II4s12x", 0, 0, b"mdta") + b"\0")
    keys = _box(b"keys", struct.pack(">II", 0, 1) + struct.pack(">I", 8 + len(name)) + b"mdta" + name)
    data = _box(b"data", struct.pack(">II", 23, 0) + struct.pack(">f", rate_Hz))  # 23: a float of 32 bits
    meta = _box(b"meta", handler + keys + _box(b"ilst", _box(struct.pack(">I", 1), data)))
    content = path.read_bytes()
    at = _find(content, 0, len(content), b"moov")
    (size,) = struct.unpack_from(">I", content, at)
    moov = content[at : at + size] + meta
    path.write_bytes(content[:at] + struct.pack(">I", len(moov)) + moov[4:] + content[at + size :])


def state_turn(path: Path, turn_deg: int) -> None:
    """Write the clockwise angle of the display (0, 90, 180 or 270 degrees) into a video file."""
    a, b, c, d = (value * 0x10000 for value in _TURNS[turn_deg])
    matrix = struct.pack(">9i", a, b, 0, c, d, 0, 0, 0, 0x40000000)

    def turned(body: bytes) -> bytes:
        return body[:40] + matrix + body[76:]

    _rewrite(path, (b"moov", b"trak"), b"tkhd", turned)


def _rewrite(path: Path, parents: Sequence[bytes], name: bytes, change: Callable[[bytes], bytes]) -> None:
    """Replace the content of the box `name` by `change(content)`.

    parents : names of the boxes that contain this box, outermost first
    """
    content = bytearray(path.read_bytes())
    begin, end, starts = 0, len(content), []
    for parent in parents:
        at = _find(content, begin, end, parent)
        starts.append(at)
        begin, end = at + 8, at + struct.unpack_from(">I", content, at)[0]
    at = _find(content, begin, end, name)
    (size,) = struct.unpack_from(">I", content, at)
    replaced = _box(name, change(bytes(content[at + 8 : at + size])))
    for start in starts:
        struct.pack_into(">I", content, start, struct.unpack_from(">I", content, start)[0] + len(replaced) - size)
    content[at : at + size] = replaced
    path.write_bytes(bytes(content))


def _find(content: bytes | bytearray, begin: int, end: int, name: bytes) -> int:
    """Return the position in bytes of the box `name` between `begin` and `end`; raise ValueError without it."""
    at = begin
    while at + 8 <= end:
        size, kind = struct.unpack_from(">I4s", content, at)
        if kind == name:
            return at
        if size == 1:
            (size,) = struct.unpack_from(">Q", content, at + 8)
        at += size or end
    raise ValueError(f"no box {name!r}")


def _box(name: bytes, body: bytes) -> bytes:
    return struct.pack(">I4s", 8 + len(body), name) + body

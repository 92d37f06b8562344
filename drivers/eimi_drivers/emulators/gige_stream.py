"""Send the frames of the emulated GigE Vision camera over the stream protocol of GigE Vision (GVSP).

The fake camera of Aravis sends all packets of a frame at once. By default, Linux stores about 0.2 MB of unread packets
for a program (net.core.rmem_default), and discards the others. Most frames with 640 x 480 pixels were then incomplete.
This sender waits until the receiver has read most of the packets that were sent before.

Source: the structures of the packets in arvgvspprivate.h of Aravis 0.8.
"""

from __future__ import annotations

import random
import socket
import struct
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

STREAM_PORT, PACKET_SIZE, STREAM_ADDRESS = 0xD00, 0xD04, 0xD18
"""Registers with the UDP port of the receiver, the size of a packet (lower 16 bits) and the IP address of the receiver
(bootstrap registers of GigE Vision, arvgvcpprivate.h).
"""

HEADERS = 36
"""Size (bytes) of the headers of IP, UDP and GVSP, which the size of a packet includes."""

AT_ONCE = 32_000
"""Number of bytes that are sent before the sender checks the queue of the receiver again."""

QUEUE = 64_000
"""Memory (bytes). The sender waits while the unread packets of the receiver need more memory than this."""

WAIT_S, LOOK_EVERY_S = 0.2, 2e-4
"""Longest wait (s) for the receiver during one frame, and the time (s) between two checks of its queue."""

_LEADER, _TRAILER, _PAYLOAD = 1, 2, 3
_IMAGE = 1
_UDP_SOCKETS = Path("/proc/net/udp")


@dataclass(frozen=True)
class StreamedFrame:
    """A frame that is sent to a receiver.

    Parameters
    ----------
    number : int
        The frame number, 1 to 65535.
    stamp_ns : int
        The time of the exposure, ns.
    pixel_format : int
        The code of the pixel format.
    region : tuple of int
        Left, top, width and height, px.
    data : bytes
        The data of the pixels.
    """

    number: int
    stamp_ns: int
    pixel_format: int
    region: tuple[int, int, int, int]
    data: bytes


def packets(frame: StreamedFrame, packet_size: int) -> Iterator[bytes]:
    """Yield the packets of a frame: the leader, the packets with the data, and the trailer.

    Parameters
    ----------
    frame : StreamedFrame
        The frame.
    packet_size : int
        The size of a packet with the headers of IP and UDP, bytes.
    """
    left, top, width, height = frame.region
    step = packet_size - HEADERS
    parts = [frame.data[begin : begin + step] for begin in range(0, len(frame.data), step)]

    def header(kind: int, place: int) -> bytes:
        return struct.pack(">HHI", 0, frame.number, kind << 24 | place)

    image = struct.pack(">HHQ5IHH", 0, _IMAGE, frame.stamp_ns, frame.pixel_format, width, height, left, top, 0, 0)
    yield header(_LEADER, 0) + image
    for place, part in enumerate(parts, 1):
        yield header(_PAYLOAD, place) + part
    yield header(_TRAILER, len(parts) + 1) + struct.pack(">II", _IMAGE, height)


def unread_bytes(port: int) -> int:
    """Return the memory (bytes) of the unread packets at a UDP port of this computer; 0 if it is not known."""
    try:
        rows = _UDP_SOCKETS.read_text(encoding="ascii").splitlines()[1:]
    except OSError:  # only Linux has this file
        return 0
    sockets = (row.split() for row in rows)
    return sum(int(words[4].split(":")[1], 16) for words in sockets if words[1].endswith(f":{port:04X}"))


class FrameSender:
    """The socket that sends the frames of a camera from an IP address of this computer.

    Attributes
    ----------
    lost_share : float
        The share (0 to 1) of the packets that are not sent, chosen at random.
    """

    def __init__(self, address: str) -> None:
        self.lost_share = 0.0
        self._line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._line.bind((address, 0))

    def send(self, frame: StreamedFrame, receiver: tuple[str, int], packet_size: int) -> None:
        """Send the packets of a frame to a receiver (address, port), in packets of `packet_size` bytes.

        If the receiver does not read the packets within `WAIT_S`, the others are sent without waiting.
        """
        until_s = time.monotonic() + WAIT_S
        allowed = 0
        for packet in packets(frame, packet_size):
            if allowed <= 0:
                while unread_bytes(receiver[1]) > QUEUE and time.monotonic() < until_s:
                    time.sleep(LOOK_EVERY_S)
                allowed = AT_ONCE
            allowed -= len(packet)
            if random.random() >= self.lost_share:
                with suppress(OSError):  # a packet that cannot be sent is a lost packet
                    self._line.sendto(packet, receiver)

    def close(self) -> None:
        """Release the socket."""
        self._line.close()

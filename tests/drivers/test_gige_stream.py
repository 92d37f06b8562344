"""The emulated GigE camera sends frames in packets, and waits for a slow receiver."""

from __future__ import annotations

import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing

import pytest

from eimi_drivers.emulators import gige_stream
from eimi_drivers.emulators.gige_stream import FrameSender, StreamedFrame, packets, unread_bytes
from tests.patience import PATIENCE_S

LOOPBACK = "127.0.0.1"
FRAME = StreamedFrame(0x1234, 0x0102030405060708, 0x01080001, (1, 2, 5, 2), bytes(range(10)))
on_linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux has /proc/net/udp")


@pytest.fixture
def receiver() -> Iterator[socket.socket]:
    # A socket that stores few packets, as on a computer whose limits were not raised.
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 100_000)
        line.bind((LOOPBACK, 0))
        line.settimeout(PATIENCE_S)
        yield line


def read(line: socket.socket, count: int) -> list[bytes]:
    return [line.recv(2000) for _ in range(count)]


def test_a_frame_is_a_leader_packets_with_data_and_a_trailer() -> None:
    # The layout is that of ArvGvspPacket, ArvGvspImageLeader and ArvGvspTrailer in arvgvspprivate.h of Aravis 0.8.
    leader, *parts, trailer = (packet.hex() for packet in packets(FRAME, 36 + 4))
    image = "000000010102030405060708010800010000000500000002000000010000000200000000"
    assert leader == "0000123401000000" + image
    assert parts == ["000012340300000100010203", "000012340300000204050607", "00001234030000030809"]
    assert trailer == "00001234020000040000000100000002"


def test_a_share_of_the_packets_is_lost(receiver: socket.socket) -> None:
    with closing(FrameSender(LOOPBACK)) as sender:
        sender.lost_share = 1.0
        sender.send(FRAME, receiver.getsockname(), 40)
        sender.lost_share = 0.0
        sender.send(FRAME, receiver.getsockname(), 1400)
        assert read(receiver, 3) == list(packets(FRAME, 1400))
        sender.lost_share = 0.5
        sender.send(StreamedFrame(1, 0, 0x01080001, (0, 0, 400, 1), bytes(400)), receiver.getsockname(), 37)
        sender.lost_share = 0.0
        sender.send(FRAME, receiver.getsockname(), 1400)
    trailer = list(packets(FRAME, 1400))[-1]
    arrived = sum(1 for _ in iter(lambda: receiver.recv(2000), trailer)) - 2
    assert 120 < arrived < 282  # of 402; a share this far from 0.5 has a probability below 1e-15


@on_linux
def test_a_receiver_that_reads_slowly_gets_every_packet(
    receiver: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Without the waits, only a part of the 2 MB fits into the queue of the receiver.
    monkeypatch.setattr(gige_stream, "WAIT_S", PATIENCE_S)
    frame = StreamedFrame(7, 0, 0x01080001, (0, 0, 2000, 1000), bytes(2_000_000))
    expected = list(packets(frame, 1400))
    with closing(FrameSender(LOOPBACK)) as sender:
        sending = threading.Thread(target=sender.send, args=(frame, receiver.getsockname(), 1400))
        sending.start()
        received = []
        for place in range(len(expected)):
            if place % 100 == 0:
                time.sleep(0.01)
            received.append(receiver.recv(2000))
        sending.join()
    assert received == expected


@on_linux
def test_a_receiver_that_reads_nothing_does_not_stop_the_camera(
    receiver: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gige_stream, "WAIT_S", 0.01)
    port = receiver.getsockname()[1]
    assert unread_bytes(port) == 0
    frame = StreamedFrame(7, 0, 0x01080001, (0, 0, 2000, 1000), bytes(2_000_000))
    with closing(FrameSender(LOOPBACK)) as sender:
        sender.send(frame, (LOOPBACK, port), 1400)
    assert unread_bytes(port) > gige_stream.QUEUE


def test_without_a_list_of_the_sockets_frames_are_sent_without_waiting(
    receiver: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gige_stream, "_UDP_SOCKETS", gige_stream.Path("no such file"))
    with closing(FrameSender(LOOPBACK)) as sender:
        sender.send(FRAME, receiver.getsockname(), 1400)
    assert read(receiver, 3) == list(packets(FRAME, 1400))


def test_a_packet_that_cannot_be_sent_is_lost(receiver: socket.socket) -> None:
    with closing(FrameSender(LOOPBACK)) as sender:
        sender.send(FRAME, ("192.0.2.1", 9), 1400)  # the loopback address cannot send to this network
        sender.send(FRAME, receiver.getsockname(), 1400)
    assert read(receiver, 3) == list(packets(FRAME, 1400))

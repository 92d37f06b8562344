"""Small properties of drivers, recordings, settings and emulated instruments on which users rely."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from eimi_drivers.cameras.image_series import ImageSeries, list_images, recording_length
from eimi_drivers.cameras.pixel_formats import PIXEL_FORMATS, PixelFormat, decode
from eimi_drivers.cameras.rolling_shutter import row_time_s
from eimi_drivers.cameras.settings import CameraSettings
from eimi_drivers.cameras.timed import TimedCamera
from eimi_drivers.clock import SimulatedClock
from eimi_drivers.emulators import coil_line
from eimi_drivers.emulators import session as supply_session
from eimi_drivers.emulators.faults import Fault
from eimi_drivers.emulators.gige_camera import encode
from eimi_drivers.emulators.scpi_families import KepcoBit4886Dialect
from eimi_drivers.emulators.sensors import TextLineDialect
from eimi_drivers.emulators.serve import emulate, serve_tcp
from eimi_drivers.emulators.session import EmulatedSession
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.interfaces import (
    EndOfPlayback,
    Identity,
    InstrumentDisconnected,
    InstrumentError,
    InstrumentTimeout,
    Limits,
    ProtectionTripped,
    ReplyNotUnderstood,
    SetPointNotTaken,
)
from eimi_drivers.sensors import SENSORS
from eimi_drivers.supplies.identity import in_words, serial_number_in
from eimi_drivers.supplies.korad import KoradSupply
from eimi_drivers.supplies.transcript import ReplayedTransport, TranscriptMismatch
from eimi_drivers.supplies.transport import InProcessTransport
from eimi_drivers.supplies.values import line_in, number_in, set_point_text
from eimi_drivers.testing import check_sensor
from eimi_drivers.testing.sensor_checks import SENSOR_CHECKS
from tests.patience import PATIENCE_S

TextLine: Any = SENSORS["text-line"]


class Status:
    # An emulated Korad that reports the status byte `byte`.

    byte = 0

    def receive(self, data: bytes) -> bytes:
        return bytes([self.byte]) if data == b"STATUS?" else b""


@pytest.mark.parametrize("byte", range(256))
def test_only_bit_6_of_a_korads_status_is_the_output_and_bits_5_and_7_are_trips(byte: int) -> None:
    clock = SimulatedClock()
    korad = Status()
    supply = KoradSupply(InProcessTransport(korad, clock), Limits(1.0, 10.0), clock)
    korad.byte = byte
    assert supply.output_on() is bool(byte & 0x40)
    korad.byte = 0x40
    supply.set_output(True)
    supply.check()
    korad.byte = byte
    if byte & 0x40 and not byte & 0xA0:
        supply.check()
    else:
        with pytest.raises(
            ProtectionTripped, match=f"status byte {byte:#04x}, output {'on' if byte & 0x40 else 'off'}"
        ) as e:
            supply.check()
        assert ("perhaps" in str(e.value)) is not bool(byte & 0xA0)


@pytest.mark.parametrize("armed", [0x20, 0x80])
def test_a_protection_bit_that_is_set_from_the_start_is_no_trip(armed: int) -> None:
    clock = SimulatedClock()
    korad = Status()
    supply = KoradSupply(InProcessTransport(korad, clock), Limits(1.0, 10.0), clock)
    korad.byte = 0x40 | armed
    supply.set_output(True)
    supply.check()
    korad.byte = 0x40 | 0xA0
    with pytest.raises(ProtectionTripped):
        supply.check()


@pytest.mark.parametrize(
    ("requested", "read_back", "believed"),
    [
        (0.0, 0.9e-9, True),
        (0.0, 1.1e-9, False),
        (1.0, 1.019, True),
        (1.0, 1.021, False),
        (1.0, None, False),
        (8, 8, True),
        (8, 10, False),
    ],
)
def test_a_setting_may_differ_by_2_percent(requested: float, read_back: float | None, believed: bool) -> None:
    name = "bit_depth" if isinstance(requested, int) else "gain"
    settings, answered = CameraSettings(**{name: requested}), CameraSettings(**{name: read_back})  # type: ignore[arg-type]
    if believed:
        settings.verify("camera 1", answered)
        return
    with pytest.raises(SetPointNotTaken, match=rf"camera 1: {name} was set to {requested} but reads back {read_back}"):
        settings.verify("camera 1", answered)


@pytest.mark.parametrize(
    ("shutter", "readout_us", "rows", "expected_s"),
    [
        ("Global", 5000.0, 500, 0.0),
        ("Global", None, 500, 0.0),
        ("Rolling", 5000.0, 500, 1e-5),
        ("Rolling", None, 500, None),
        ("GlobalReset", 5000.0, 500, None),
    ],
)
def test_the_rows_of_a_rolling_shutter_share_the_readout_time(
    shutter: str, readout_us: float | None, rows: int, expected_s: float | None
) -> None:
    assert row_time_s(shutter, readout_us, rows) == (None if expected_s is None else pytest.approx(expected_s))


def test_the_length_of_a_recording_is_known_without_reading_it(tmp_path: Path) -> None:
    for number in (1, 2, 10):
        cv2.imwrite(str(tmp_path / f"f_{number}.png"), np.full((4, 5), number, np.uint8))
    (tmp_path / "notes.txt").write_text("none")
    video = cv2.VideoWriter(str(tmp_path / "v.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (16, 16))
    for _ in range(4):
        video.write(np.zeros((16, 16, 3), np.uint8))
    video.release()
    (tmp_path / "broken.avi").write_bytes(b"nothing")
    lengths = {
        name: recording_length(str(tmp_path / name)) for name in ("", "f_%d.png", "v.avi", "broken.avi", "absent")
    }
    assert lengths == {"": 3, "f_%d.png": 3, "v.avi": 4, "broken.avi": None, "absent": None}
    assert recording_length("0") is None


def test_a_series_is_read_in_the_order_of_its_numbers_to_its_end(tmp_path: Path) -> None:
    for number in (1, 2, 10):
        cv2.imwrite(str(tmp_path / f"f_{number}.png"), np.full((4, 5), number, np.uint8))
    series = ImageSeries(list_images(tmp_path))
    read = [series.read() for _ in range(3)]
    assert [(int(image[0, 0]), time_s) for image, time_s in read] == [(1, 0.0), (2, 1.0), (10, 2.0)]
    with pytest.raises(EndOfPlayback, match="end of playback after 3 images"):
        series.read()


def test_set_points_of_an_hmp_need_the_channel_of_the_coil() -> None:
    coil = CoilSupply(SimulatedClock())
    hmp = emulate("rs-hmp", coil)
    assert hmp.receive(b"APPL 5,0.5\nSYST:ERR?\n") == b'-241,"Hardware missing"\n'
    assert (coil.state.set_voltage_V, coil.state.set_current_A) == (0.0, 0.0)
    assert hmp.receive(b"INST OUT1\nAPPL 5,0.5\nSYST:ERR?\n") == b'0,"No error"\n'
    assert (coil.state.set_voltage_V, coil.state.set_current_A) == (5.0, 0.5)


def test_a_bit4886_sets_a_current_in_current_mode_only() -> None:
    coil = CoilSupply(SimulatedClock())
    card = KepcoBit4886Dialect(coil)
    assert card.receive(b"CURR 0.5;VOLT 5;CURR?;FUNC:MODE?\n") == b"0.000000E+00;0\n"
    assert (coil.state.output, coil.state.set_voltage_V, coil.bipolar) == (True, 0.0, True)
    assert card.receive(b"CURR -0.5;SYST:ERR?\n") == b'-222,"Data out of range"\n'
    assert card.receive(b"FUNC:MODE CURR;CURR -0.5;VOLT 5;CURR?;FUNC:MODE?\n") == b"-5.000000E-01;1\n"
    assert (coil.state.set_voltage_V, coil.state.set_current_A) == (5.0, -0.5)
    assert card.receive(b"FUNC:MODE BOTH;SYST:ERR?\n") == b'-104,"Data type error"\n'


class ReopensWhenRead(TextLine):
    # A faulty sensor driver: `read` opens its line again, and `close` fails on a closed line.

    is_closed = False

    def read(self) -> Any:
        self.is_closed = False
        return super().read()

    def close(self) -> None:
        if self.is_closed:
            raise RuntimeError("closed already")
        self.is_closed = True


def test_a_sensor_that_cannot_be_closed_twice_in_a_row_fails_the_check() -> None:
    checks = [check for check in SENSOR_CHECKS if check.__name__ == "closes_twice"]
    with pytest.raises(AssertionError, match="closes_twice: RuntimeError: closed already"):
        check_sensor(ReopensWhenRead, TextLineDialect, checks=checks)


def test_a_supply_that_disappears_returns_at_another_address_after_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = SimulatedClock()
    monkeypatch.setattr(supply_session, "WallClock", lambda: clock)
    served_at: list[tuple[float, str, str]] = []
    served = EmulatedSession(
        "scpi",
        None,
        Fault.REENUMERATE,
        0.0,
        lambda words: None,
        announce=lambda a, b: served_at.append((clock.now(), a, b)),
    )
    line = served._line

    @contextmanager
    def at_port(number: int) -> Iterator[str]:
        yield f"port {number}"

    def leaves() -> None:
        assert not line.lost
        if len(served_at) == 3:
            raise KeyboardInterrupt
        line.inject(Fault.REENUMERATE)
        with pytest.raises(ConnectionResetError):
            line.receive(b"OUTP?\n")

    monkeypatch.setattr(served, "_serve", at_port)
    monkeypatch.setattr(served, "_watch", leaves)
    with pytest.raises(KeyboardInterrupt):
        served.serve()
    assert [(at_s, address) for at_s, address, _ in served_at] == [(0.0, "port 0"), (1.0, "port 1"), (2.0, "port 2")]
    assert len({coil for _, _, coil in served_at}) == 1
    assert all(coil_line.ADDRESS.fullmatch(coil) for _, _, coil in served_at)


def test_a_session_serves_first_at_the_requested_port_and_then_at_a_free_port(monkeypatch: pytest.MonkeyPatch) -> None:
    ports_served: list[Any] = []
    monkeypatch.setattr(supply_session, "serve_tcp", lambda line, port: ports_served.append(("tcp", port)))
    monkeypatch.setattr(supply_session, "serve_pty", lambda line: ports_served.append(("pty",)))
    monkeypatch.setattr(supply_session, "serve_port", lambda line, name: ports_served.append(("port", name)))
    for tcp, fault in ((5025, None), (None, None), (None, Fault.DROP)):
        served = EmulatedSession("scpi", tcp, fault, 0.0, lambda words: None)
        for ports in (0, 1):
            served._serve(ports)
    assert ports_served == [
        *[("tcp", 5025), ("tcp", 0)],
        *[("pty",), ("pty",)],
        *[("port", "ttyEMULATED0"), ("port", "ttyEMULATED1")],
    ]


class Constant:
    # An instrument with one answer to every message; an empty answer ends the connection.

    def __init__(self, answer: bytes) -> None:
        self._answer = answer

    def receive(self, data: bytes) -> bytes:
        if not self._answer:
            raise ConnectionResetError
        return self._answer


@pytest.mark.parametrize(
    ("answer", "expected"),
    [(b"0.25\n", 0.25), (b"-1e-3\n", -0.001), (b"many\n", ReplyNotUnderstood), (b"", InstrumentDisconnected)],
)
def test_the_current_of_a_far_coil_is_a_number_or_an_error_with_its_address(answer: bytes, expected: Any) -> None:
    with serve_tcp(Constant(answer)) as address:
        if not isinstance(expected, float):
            with pytest.raises(expected, match=address):
                coil_line.RemoteCoil(address)
            return
        coil = coil_line.RemoteCoil(address)
        assert coil.coil_current_A() == expected
        coil.close()


def test_a_far_coil_that_does_not_answer_is_a_timeout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(coil_line, "ANSWER_WITHIN_S", 0.05)
    two_addresses = r"within 0\.05 s\. An emulated supply and its coil have two addresses"
    with (
        socket.create_server(("127.0.0.1", 0)) as server,
        pytest.raises(InstrumentTimeout, match=two_addresses),
    ):
        coil_line.RemoteCoil(f"TCPIP::127.0.0.1::{server.getsockname()[1]}::SOCKET")
    with pytest.raises(InstrumentError, match="should be TCPIP::HOST::PORT::SOCKET"):
        coil_line.RemoteCoil("127.0.0.1:5")


@pytest.mark.parametrize(
    ("reply", "number"),
    [
        (b"0.7001\n", 0.7001),
        (b" +1.5E-03\r\n", 0.0015),
        (b".5", 0.5),
        (b"5.", 5.0),
        (b"-12\0", -12.0),
        (b"9.91E+37\n", None),
        (b"-9.9E+37\n", None),
        (b"1E+30\n", 1e30),
        (b"nan", None),
        (b"1.0A", None),
        (b"1.0 2.0", None),
        (b"", None),
        (b"1_0", None),
    ],
)
def test_an_answer_is_a_number_only_if_it_has_no_other_characters(reply: bytes, number: float | None) -> None:
    assert number_in(reply) == number


@pytest.mark.parametrize(
    ("reply", "line"),
    [(b" A,B \r\n", "A,B"), (b"A\0", "A"), (b"\xb0C\n", None), (b"A\x07B", None), (b"A\nB", None), (b"\r\n", None)],
)
def test_an_answer_is_one_line_only_if_nothing_follows_it(reply: bytes, line: str | None) -> None:
    assert line_in(reply) == line


@pytest.mark.parametrize(
    ("value", "step", "text"),
    [
        (0.7999999999999999, "0.001", "0.800"),
        (0.7996, "0.001", "0.799"),
        (-0.7996, "0.001", "-0.799"),
        (-0.0001, "0.001", "0.000"),
        (12, "0.01", "12.00"),
        (0.1 + 0.2, "0.1", "0.3"),
        (0.9999999996, "0.01", "1.00"),
        (0.999999994, "0.01", "0.99"),
        (0.37, "0.05", "0.35"),
        (-0.37, "0.05", "-0.35"),
        (0.3, "0.0025", "0.3000"),
        (25, "10", "20"),
    ],
)
def test_a_set_point_is_rounded_toward_zero_in_whole_steps(value: float, step: str, text: str) -> None:
    assert set_point_text(value, step) == text


@pytest.mark.parametrize(
    ("text", "serial_number"),
    [
        ("KEYSIGHT,E36312A,MY123,1.0", "MY123"),
        ("KEYSIGHT,E36312A, MY123 ,1.0,x", "MY123"),
        ("HP,E3631A,0,2.1", ""),
        ("HP,E3631A,000,2.1", ""),
        ("HP,E3631A,2.1", ""),
        ("TENMA 72-2540 SN:30045578", "30045578"),
        ("KORADKA3005PV2.0", ""),
    ],
)
def test_the_serial_number_is_the_third_field_of_an_identification(text: str, serial_number: str) -> None:
    assert serial_number_in(text) == serial_number
    words = in_words(Identity("scpi", text, "COM3", serial_number))
    assert words == (f"{text!r} with serial number {serial_number}" if serial_number else repr(text))


ENCODED = [(c, f) for c, f in PIXEL_FORMATS.items() if f.kind == "Mono" and not (f.packing and f.bits == 10)]


@pytest.mark.parametrize(("code", "pixel_format"), ENCODED, ids=[pixel_format.name for _, pixel_format in ENCODED])
def test_encoded_pictures_are_decoded_again_and_have_the_size_of_their_format(
    code: int, pixel_format: PixelFormat
) -> None:
    image = np.random.default_rng(1).integers(0, 256, (3, 8), dtype=np.uint8)
    data = encode(pixel_format, image)
    assert 8 * len(data) == 24 * ((code >> 16) & 0xFF)
    expected = image.astype(np.uint16) << pixel_format.bits - 8
    np.testing.assert_array_equal(decode(code, data, 8, 3), expected)
    with pytest.raises(
        ReplyNotUnderstood, match=rf"8 x 3 pixels in {pixel_format.name} has only {len(data) - 1} bytes"
    ):
        decode(code, data[:-1], 8, 3)


def test_a_read_where_the_transcript_has_a_message_is_a_mismatch(tmp_path: Path) -> None:
    file = tmp_path / "wire.txt"
    file.write_text("0.0 open here\n0.1 > A?\\n\n0.2 < 1\\n\n0.3 > B?\\n\n0.4 >! InstrumentTimeout stuck\n")
    line = ReplayedTransport(file)
    assert (line.address, line.reopen()) == ("here", False)
    with pytest.raises(TranscriptMismatch, match=r"read 9 bytes, but line 2 of the transcript is: > A\?"):
        line.read(9, 1.0, b"\n")
    line.write(b"A?\n")
    with pytest.raises(TranscriptMismatch, match=r"sent B\?.*, but line 3 of the transcript is: < 1"):
        line.write(b"B?\n")
    assert line.read(9, 1.0, b"\n") == b"1\n"
    with pytest.raises(TranscriptMismatch, match="2 events did not happen, the first of which is in line 4: > B"):
        line.assert_complete()
    with pytest.raises(InstrumentTimeout, match="stuck"):
        line.write(b"B?\n")
    line.assert_complete()
    with pytest.raises(TranscriptMismatch, match="read 9 bytes after the end of the transcript"):
        line.read(9, 1.0)
    file.write_text("0.0 open here\nnonsense\n")
    with pytest.raises(ValueError, match=r"wire\.txt: line 2: 'nonsense' is no event"):
        ReplayedTransport(file)


def test_a_camera_that_cannot_be_opened_leaves_no_thread_behind() -> None:
    def fail() -> Any:
        raise InstrumentDisconnected("not there")

    with pytest.raises(InstrumentDisconnected, match="not there"):
        TimedCamera("the absent camera", fail)
    callers = [thread for thread in threading.enumerate() if thread.name == "calls of the absent camera"]
    for caller in callers:
        caller.join(PATIENCE_S)
        assert not caller.is_alive()

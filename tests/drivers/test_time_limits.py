"""In simulated time, drivers wait as long as they should."""

from __future__ import annotations

from collections import Counter
from contextlib import suppress
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_drivers.cameras.gentl import GenTLCamera
from eimi_drivers.cameras.settings import CameraSettings
from eimi_drivers.clock import SimulatedClock
from eimi_drivers.emulators import session as supply_session
from eimi_drivers.emulators.faults import Fault
from eimi_drivers.emulators.serve import DIALECTS, emulate
from eimi_drivers.emulators.session import EmulatedSession
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.interfaces import (
    InstrumentDisconnected,
    InstrumentError,
    InstrumentTimeout,
    Limits,
    ReplyNotUnderstood,
)
from eimi_drivers.sensors import SENSORS
from eimi_drivers.supplies import SUPPLIES
from eimi_drivers.supplies.korad import MESSAGE_GAP_S
from eimi_drivers.supplies.transport import InProcessTransport

LIMITS = Limits(1.0, 12.0)


class Timed:
    # A connection that records each message with its time.
    # answer, error : what a read returns or raises; without both, the read times out

    def __init__(self, clock: SimulatedClock, answer: bytes = b"") -> None:
        self.address = "somewhere"
        self.clock, self.answer = clock, answer
        self.error: InstrumentError | None = None
        self.asked: list[tuple[float, bytes]] = []
        self.sizes: set[int] = set()

    def write(self, message: bytes) -> None:
        self.asked.append((self.clock.now(), message))

    def read(self, size: int, timeout_s: float, end: bytes = b"") -> bytes:
        self.sizes.add(size)
        if self.error is not None:
            raise self.error
        if not self.answer:
            self.clock.sleep(timeout_s)
            raise InstrumentTimeout("nothing came")
        return self.answer

    def reopen(self) -> bool:
        return False

    def close(self) -> None:
        pass


@pytest.mark.parametrize(
    ("error", "pause_s"), [(None, 1.0), (InstrumentDisconnected("cut"), 1.0), (ReplyNotUnderstood("odd"), 2.0)]
)
def test_after_a_query_without_an_answer_the_next_one_waits_for_a_late_answer(
    error: InstrumentError | None, pause_s: float
) -> None:
    clock = SimulatedClock()
    line = Timed(clock)
    supply = SUPPLIES["scpi"](line, LIMITS, clock)
    line.error = error
    with pytest.raises(InstrumentError):
        supply.output_on()
    ended_s = clock.now()
    assert ended_s == (1.0 if error is None else 0.0)
    line.error, line.answer = None, b"1\n"
    assert supply.output_on() is True
    assert line.asked[-1][0] == pytest.approx(ended_s + pause_s)
    assert supply.output_on() is True  # no wait after an answer
    assert line.asked[-1][0] == pytest.approx(ended_s + pause_s)


def test_the_wait_for_a_late_answer_includes_the_time_that_has_passed() -> None:
    clock = SimulatedClock()
    line = Timed(clock)
    supply = SUPPLIES["scpi"](line, LIMITS, clock)
    with pytest.raises(InstrumentTimeout):
        supply.output_on()
    line.answer = b"0\n"
    clock.sleep(0.75)
    assert supply.output_on() is False
    assert line.asked[-1][0] == pytest.approx(2.0)


# The largest number of bytes of one answer. Without such a bound a line that never ends would be read for ever.
LONGEST = {"korad": 64, "genesys": 128, "aim-tti": 256}


@pytest.mark.parametrize("driver", [*SUPPLIES, *SENSORS])
def test_an_answer_without_an_end_is_read_up_to_a_maximum_length(driver: str) -> None:
    clock = SimulatedClock()
    line = Timed(clock, b"OK\r" if driver == "genesys" else b"1\n")
    sensor = driver in SENSORS
    device: Any = SENSORS[driver](line, clock) if sensor else SUPPLIES[driver](line, LIMITS, clock)
    if driver == "korad":
        line.answer = b"x"
        assert len(device.identify().text) == LONGEST["korad"]
        return
    with suppress(InstrumentError):
        device._ask("*IDN?")
    assert line.sizes == {256 if sensor else LONGEST.get(driver, 4096)}


class InPieces(Timed):
    # A connection over which the second half of an answer arrives `gap_s` (s) after the first half.

    gap_s = 0.0

    def write(self, message: bytes) -> None:
        super().write(message)
        half = len(self.answer) // 2
        self.pieces = [(0.0, self.answer[:half]), (self.clock.now() + self.gap_s, self.answer[half:])]

    def read(self, size: int, timeout_s: float, end: bytes = b"") -> bytes:
        arrives_s, piece = self.pieces[0] if self.pieces else (float("inf"), b"")
        self.clock.sleep(min(max(arrives_s - self.clock.now(), 0.0), timeout_s))
        if arrives_s > self.clock.now():
            raise InstrumentTimeout("nothing came")
        self.pieces = [(arrives_s, piece[size:])] * (len(piece) > size) + self.pieces[1:]
        return piece[:size]


@pytest.mark.parametrize("identity", ["KORADKA3005PV2.0", "KORAD KD3005P V4.2 SN:03379314", "A supply of another kind"])
def test_the_identity_of_a_korad_is_read_to_its_end_although_it_arrives_in_two_pieces(identity: str) -> None:
    clock = SimulatedClock()
    line = InPieces(clock, identity.encode())
    line.gap_s = MESSAGE_GAP_S + 0.25
    assert SUPPLIES["korad"](line, LIMITS, clock).identify().text == identity


@pytest.mark.parametrize("identity", ["KORADKA3005PV2.0", "KORAD KD3005P V4.2 SN:03379314", "TENMA 72-2540 V2.1\0"])
def test_after_a_whole_identity_a_korad_is_not_awaited_for_long(identity: str) -> None:
    clock = SimulatedClock()
    SUPPLIES["korad"](InPieces(clock, identity.encode()), LIMITS, clock).identify()
    assert clock.now() == pytest.approx(MESSAGE_GAP_S + 0.05)


def test_a_sensor_waits_half_a_second_for_a_late_answer() -> None:
    clock = SimulatedClock()
    line = Timed(clock)
    sensor = SENSORS["text-line"](line, clock)
    with pytest.raises(InstrumentTimeout):
        sensor.read()
    ended_s = clock.now()
    line.answer = b"1.5 mT\n"
    assert sensor.read().value == 1.5
    assert line.asked[-1][0] == pytest.approx(ended_s + 0.5)
    sensor.read()
    assert line.asked[-1][0] == pytest.approx(ended_s + 0.5)


class Talkative(Timed):
    # A board on a serial port that sends the text `unasked` after every answer.

    def __init__(self, clock: SimulatedClock, answer: bytes, unasked: bytes) -> None:
        super().__init__(clock, answer)
        self.address, self.unasked, self.unread = "COM7", unasked, b""

    def write(self, message: bytes) -> None:
        super().write(message)
        self.unread = self.answer + self.unasked

    def read(self, size: int, timeout_s: float, end: bytes = b"") -> bytes:
        length = self.unread.find(end) + 1
        received, self.unread = self.unread[:length], self.unread[length:]
        if not received:
            self.clock.sleep(timeout_s)
            raise InstrumentTimeout("nothing came")
        return received


def test_a_board_that_sends_without_being_asked_is_refused() -> None:
    clock = SimulatedClock()
    line = Talkative(clock, b"my lab,board,1,1.0\r\n", unasked=10 * b"12.3 mT\n")
    sensor = SENSORS["text-line"](line, clock)
    for _ in range(2):
        with pytest.raises(ReplyNotUnderstood, match=r"^COM7: the board sends b'12\.3 mT\\n' without being asked; "):
            sensor.identify()
    line.unasked = b"ready\n"  # a text at the start
    began_s = clock.now()
    assert sensor.identify().text == sensor.identify().text == "my lab,board,1,1.0"
    assert clock.now() - began_s == pytest.approx(0.2)
    for reading in (
        b"12.345 mT\r\n",
        b"-.5 mT\r\n",
        b"1e-3 mT 0.02\r\n",
    ):  # a slow board that hears nothing
        sensor = SENSORS["text-line"](Talkative(clock, reading, unasked=b""), clock)
        with pytest.raises(ReplyNotUnderstood, match=r"an identity such as my lab,.*; a board must send nothing"):
            sensor.identify()
    number = SENSORS["text-line"](Talkative(clock, b"1234\r\n", unasked=b""), clock)
    assert number.identify().text == "1234"


@pytest.mark.parametrize("driver", sorted(DIALECTS))
def test_a_set_point_that_never_reads_back_is_an_error_within_5_s(driver: str) -> None:
    clock = SimulatedClock()
    coil = CoilSupply(clock)
    line = InProcessTransport(emulate(driver, coil), clock)
    supply = SUPPLIES[driver](line, LIMITS, clock)
    supply.set_voltage(5.0)
    supply.set_current(0.5)
    began_s = clock.now()
    coil.locked = True
    with pytest.raises(InstrumentError):
        supply.set_current(0.1)
    assert clock.now() - began_s < 5.0
    assert coil.state.set_current_A == 0.5


@pytest.fixture
def session(monkeypatch: pytest.MonkeyPatch) -> tuple[EmulatedSession, CoilSupply, list[str]]:
    # An emulated supply in simulated time: the object that serves it, the supply, and the printed lines.
    # Its measured current gets an offset 3 s after a current has begun to flow.
    clock = SimulatedClock()
    monkeypatch.setattr(supply_session, "WallClock", lambda: clock)
    coil = CoilSupply(clock)
    messages: list[str] = []
    return EmulatedSession("scpi", None, Fault.OFFSET, 3.0, messages.append, coil=coil), coil, messages


def test_a_fault_begins_its_time_after_the_current_flows_and_only_once(
    session: tuple[EmulatedSession, CoilSupply, list[str]],
) -> None:
    served, coil, message = session

    def after(seconds: float) -> bool:
        coil.clock.sleep(seconds)
        served._begin_in_time(Fault.OFFSET)
        return coil.offset_A != 0.0

    coil.set_voltage(12.0)
    assert not after(10.0)
    coil.switch(True)
    assert not after(10.0)  # the set-point is 0
    coil.switch(False)
    coil.set_current(0.5)
    assert not after(10.0)
    coil.switch(True)
    assert not after(0.0)
    assert not after(2.9)
    assert after(0.2)
    assert message == [f"# 33.10 s: the fault offset begins: {Fault.OFFSET.effect}"]
    coil.offset_A = 0.0
    assert not after(10.0)
    assert len(message) == 1


@pytest.mark.parametrize("fault", [None, Fault.OFFSET, Fault.REENUMERATE])
def test_a_session_looks_every_twentieth_of_a_second_until_its_supply_has_left(
    session: tuple[EmulatedSession, CoilSupply, list[str]], monkeypatch: pytest.MonkeyPatch, fault: Fault | None
) -> None:
    served, coil, messages = session
    coil.set_voltage(12.0)
    coil.set_current(0.5)
    coil.switch(True)
    looked_s: list[float] = []
    watched: list[float] = []

    def look() -> None:
        looked_s.append(coil.clock.now())
        if len(looked_s) == 70:  # the fault begins at look 61
            line = SimpleNamespace(lost=True, instrument=served._line.instrument)
            monkeypatch.setattr(served, "_line", line)
        if len(looked_s) == 80:
            raise KeyboardInterrupt

    monkeypatch.setattr(served, "_fault", fault)
    monkeypatch.setattr(served, "_after_s", 2.98)
    monkeypatch.setattr(served, "_look", look)
    monkeypatch.setattr(served._line.instrument, "watch", lambda: watched.append(coil.clock.now()), raising=False)
    if fault is Fault.REENUMERATE:
        served._watch()
    else:
        with pytest.raises(KeyboardInterrupt):
            served._watch()
    expected = [0.05 * number for number in range(70 if fault is Fault.REENUMERATE else 80)]
    assert looked_s == pytest.approx(expected)
    assert watched == pytest.approx(expected)
    begins = [message for message in messages if "begins" in message]
    assert begins == ([f"# 3.00 s: the fault {fault.word} begins: {fault.effect}"] if fault else [])
    reports = [message for message in messages if "in the coil" in message]
    assert (len(reports) > 0) is (fault is not None)


def test_the_true_current_is_reported_when_it_changes(
    session: tuple[EmulatedSession, CoilSupply, list[str]],
) -> None:
    served, coil, message = session
    coil.set_voltage(12.0)
    served._report()
    served._report()
    assert message == ["# 0.00 s: output off, 0.000 A set, 0.000 A in the coil"]
    coil.clock.sleep(1.5)
    coil.set_current(0.5)
    served._report()
    coil.switch(True)
    served._report()
    coil.clock.sleep(5.0)
    served._report()
    served._report()
    assert message[1:] == [
        "# 1.50 s: output off, 0.500 A set, 0.000 A in the coil",
        "# 1.50 s: output on, 0.500 A set, 0.000 A in the coil",
        "# 6.50 s: output on, 0.500 A set, 0.500 A in the coil",
    ]
    coil.shorted_A = 0.5 + supply_session.LEAST_CHANGE_A / 2
    served._report()
    assert len(message) == 4
    coil.shorted_A = 0.5 + 2 * supply_session.LEAST_CHANGE_A
    served._report()
    assert len(message) == 5


class Producer:
    # A GenTL camera that delivers frames with the given numbers; None ends a wait without a frame.

    def __init__(self, settings: CameraSettings, *numbers: int | None) -> None:
        self.waiting = list(numbers)
        self.queued: list[int] = []
        self.triggers = 0
        self.waits: list[float] = []
        self.shape = (4, 3)
        self.payload = 1
        camera = self.camera = object.__new__(GenTLCamera)
        camera._label, camera.settings, camera._closed = "camera 1", settings, False
        camera._triggered = settings.trigger == "software"
        camera._timeout, camera._errors = TimeoutError, KeyError
        camera._api, camera._out_of_range = SimpleNamespace(GenericException=KeyError), (OverflowError, ValueError)
        camera._to_skip, camera._counting, camera._last_number = 0, False, None
        camera.lost_frames = Counter()
        camera._acquirer = self
        camera._producers = SimpleNamespace(reset=lambda: None)
        camera._nodes = SimpleNamespace(TriggerSoftware=SimpleNamespace(execute=self.expose))

    def expose(self) -> None:
        self.triggers += 1

    def fetch(self, timeout: float, is_raw: bool) -> Any:
        self.waits.append(timeout)
        number = self.waiting.pop(0) if self.waiting else None
        if number is None:
            raise TimeoutError
        buffer = SimpleNamespace(payload_type=self.payload, frame_id=number, width=self.shape[0], height=self.shape[1])
        buffer.raw_buffer = bytes(5) + bytes(range(12))
        buffer.image_offset, buffer.pixel_format, buffer.timestamp_ns = 5, 0x01080001, 2_500_000_000
        buffer.parent = SimpleNamespace(queue_buffer=lambda given: self.queued.append(given.frame_id))
        return buffer


SOFTWARE = CameraSettings(trigger="software", region=(0, 0, 4, 3))


def test_a_gentl_frame_has_its_pixels_number_and_time() -> None:
    made = Producer(SOFTWARE, None, 7)
    frame = made.camera.grab(10.0)
    assert (frame.number, frame.timestamp_s, made.triggers, made.queued) == (7, 2.5, 1, [7])
    np.testing.assert_array_equal(frame.image, np.arange(12, dtype=np.uint8).reshape(3, 4))


def test_a_triggered_gentl_camera_discards_the_frames_before_the_trigger_and_counts_missing_ones() -> None:
    made = Producer(SOFTWARE, 1, 2, None, 3)
    assert made.camera.grab(10.0).number == 3
    assert (made.queued, made.waits[0], made.triggers) == ([1, 2, 3], 0.001, 1)
    made.waiting = [None, None, 6]
    assert made.camera.grab(10.0).number == 6
    assert dict(made.camera.lost_frames) == {"no complete frame": 2}
    made.waiting = [None, 7]
    made.camera.grab(10.0)
    assert made.camera.lost_frames.total() == 2


def test_a_free_gentl_camera_discards_two_frames_after_a_flush_and_counts_no_gap_there() -> None:
    made = Producer(CameraSettings(frame_rate_Hz=10.0), 1, 2, 5)
    assert [made.camera.grab(10.0).number for _ in range(3)] == [1, 2, 5]
    assert (made.triggers, made.camera.lost_frames.total()) == (0, 2)
    made.waiting = [6, 7, None]
    made.camera.flush()
    made.waiting = [20, 21, 22, 23]
    assert [made.camera.grab(10.0).number for _ in range(2)] == [22, 23]
    assert made.camera.lost_frames.total() == 2
    assert made.queued == [1, 2, 5, 6, 7, 20, 21, 22, 23]


def test_the_flush_of_a_fast_gentl_camera_ends_after_as_many_frames_as_there_are_buffers() -> None:
    made = Producer(CameraSettings(frame_rate_Hz=2000.0), *range(100))
    made.camera.flush()
    assert made.camera.grab(10.0).number == 32 + 2


def test_a_gentl_camera_with_a_trigger_input_skips_no_frame() -> None:
    made = Producer(CameraSettings(trigger="Line1"), 1, None)
    made.camera.flush()
    made.waiting = [2]
    assert (made.camera.grab(10.0).number, made.triggers, made.queued) == (2, 0, [1, 2])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"payload": 2}, "payload type 2"),
        ({"shape": (3, 4)}, r"frame 9 has 3 x 4 pixels, but the region in the settings is"),
    ],
)
def test_a_gentl_frame_with_unexpected_contents_is_an_error_and_its_buffer_is_returned(
    change: dict[str, Any], words: str
) -> None:
    made = Producer(SOFTWARE, None, 9)
    for name, value in change.items():
        setattr(made, name, value)
    with pytest.raises(ReplyNotUnderstood, match=words):
        made.camera.grab(10.0)
    assert made.queued == [9]


def test_a_gentl_camera_without_frames_is_a_timeout_and_a_closed_one_is_disconnected() -> None:
    made = Producer(SOFTWARE)
    with pytest.raises(InstrumentTimeout, match=r"camera 1: no complete frame within 0\.01 s"):
        made.camera.grab(0.01)
    ended: list[str] = []
    made.stop, made.destroy = lambda: ended.append("stop"), lambda: ended.append("destroy")  # type: ignore[attr-defined]
    made.camera._producers = SimpleNamespace(reset=lambda: ended.append("reset"))
    made.camera.close()
    made.camera.close()
    assert ended == ["stop", "destroy", "reset"]
    with pytest.raises(InstrumentDisconnected, match="camera 1: the camera was closed"):
        made.camera.grab(10.0)

"""Connections to instruments (serial, VISA, in the same process) have the right settings, time limits and errors."""

from __future__ import annotations

import subprocess
import sys
from types import SimpleNamespace
from typing import Any

import pytest
import pyvisa
import serial

from eimi_drivers.clock import SimulatedClock
from eimi_drivers.interfaces import InstrumentDisconnected, InstrumentError, InstrumentTimeout
from eimi_drivers.sensors import SENSORS
from eimi_drivers.supplies import SUPPLIES, transport
from eimi_drivers.supplies.address import is_serial_port, pseudo_terminal, serial_port, split_address
from eimi_drivers.supplies.interruptible import InterruptibleTransport
from eimi_drivers.supplies.transport import InProcessTransport, SerialTransport
from eimi_drivers.supplies.visa import VisaTransport, open_visa
from tests.patience import PATIENCE_S


class Port:
    # A serial port that returns prepared pieces of an answer, and records what is written.

    def __init__(self, *pieces: bytes, unread: bytes = b"") -> None:
        self.pieces, self.unread = list(pieces), unread
        self.written: list[bytes] = []
        self.timeout: float | None = None
        self.reads: list[int] = []
        self.closed = 0

    @property
    def in_waiting(self) -> int:
        return len(self.unread)

    def read(self, size: int = 1) -> bytes:
        if self.unread:
            taken, self.unread = self.unread[:size], self.unread[size:]
            return taken
        self.reads.append(size)
        return self.pieces.pop(0) if self.pieces else b""

    def read_until(self, end: bytes, size: int) -> bytes:
        return self.read(size)

    def write(self, message: bytes) -> None:
        self.written.append(message)

    def close(self) -> None:
        self.closed += 1


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    # A list of the arguments with which serial ports are opened; no real port is opened.
    calls: list[dict[str, Any]] = []

    def open_port(url: str, **settings: Any) -> Port:
        calls.append({"url": url, **settings})
        return Port()

    monkeypatch.setattr(serial, "serial_for_url", open_port)
    return calls


# Speed (bit/s), data bits, parity and stop bits in the manuals; a serial line of the other families has 9600 8N1.
SERIAL_LINES = {
    "bk-xln": (57600, 8, "N", 1),
    "owon-spe": (115200, 8, "N", 1),
    "keysight-e3631a": (9600, 8, "N", 2),
    "keysight-e3632a": (9600, 8, "N", 2),
    "keysight-e364x": (9600, 8, "N", 2),
    "lakeshore-425": (57600, 7, "O", 1),
    "lakeshore-475": (9600, 7, "O", 1),
    "fwbell-5080": (2400, 8, "N", 1),
    "text-line": (115200, 8, "N", 1),  # docs/howto/measure_the_field.md
}


@pytest.mark.parametrize("driver", [*SUPPLIES, *SENSORS])
def test_a_serial_line_has_the_settings_of_the_family(opened: list[dict[str, Any]], driver: str) -> None:
    kind: Any = SUPPLIES[driver] if driver in SUPPLIES else SENSORS[driver]
    kind.connect("/dev/ttyUSB7#1" if driver in SUPPLIES else "/dev/ttyUSB7")
    (call,) = opened
    assert call["url"] == "/dev/ttyUSB7"
    settings = (call["baudrate"], call["bytesize"], call["parity"], call["stopbits"])
    assert settings == SERIAL_LINES.get(driver, (9600, 8, "N", 1))
    assert call["exclusive"] is True
    assert call["timeout"] == 0
    assert call["write_timeout"] == 2.0


def test_a_pseudo_terminal_carries_whole_bytes_without_parity(opened: list[dict[str, Any]]) -> None:
    SerialTransport("/dev/pts/99999", 57600, 7, "O", 2)
    (call,) = opened
    assert (call["bytesize"], call["parity"], call["stopbits"], call["baudrate"]) == (8, "N", 1, 57600)


def test_a_shared_port_is_opened_without_a_lock(opened: list[dict[str, Any]], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(transport, "_sharing", False)
    transport.share_ports()
    SerialTransport("/dev/ttyUSB7")
    assert opened[0]["exclusive"] is None
    monkeypatch.setattr(transport, "_sharing", False)


@pytest.mark.parametrize(
    ("address", "is_serial", "port"),
    [
        ("/dev/ttyUSB0", True, "/dev/ttyUSB0"),
        ("/dev/ttyUSB0#2", True, "/dev/ttyUSB0"),
        ("COM3", True, "COM3"),
        (r"\\.\COM12", True, "COM12"),
        ("ASRL3::INSTR", True, "COM3"),
        ("asrl3", True, "COM3"),
        ("ASRL/dev/ttyS1::INSTR#1", True, "/dev/ttyS1"),
        ("TCPIP::h::5025::SOCKET", False, "socket://h:5025"),
        ("tcpip0::h::5025::socket#3", False, "socket://h:5025"),
        ("TCPIP::h::INSTR", False, "TCPIP::h::INSTR"),
        ("USB0::1::2::INSTR", False, "USB0::1::2::INSTR"),
        ("socket://h:1", True, "socket://h:1"),
    ],
)
def test_an_address_names_its_port(address: str, is_serial: bool, port: str) -> None:
    assert serial_port(address) == port
    assert is_serial_port(address) is is_serial


@pytest.mark.parametrize(
    ("address", "parts"),
    [
        ("COM3", ("COM3", None)),
        ("COM3#2", ("COM3", 2)),
        ("a#b#12", ("a#b", 12)),
        ("COM3#", ("COM3#", None)),
        ("COM3#1234", ("COM3#1234", None)),
        ("COM3#x", ("COM3#x", None)),
    ],
)
def test_the_channel_is_the_number_after_the_last_number_sign(address: str, parts: tuple[str, int | None]) -> None:
    assert split_address(address) == parts


@pytest.mark.parametrize("url", ["spy:///dev/ttyUSB0?file=x", "loop://", "alt://x", "hwgrep://x"])
def test_other_urls_are_refused_before_a_port_is_opened(opened: list[dict[str, Any]], url: str) -> None:
    with pytest.raises(InstrumentError, match="is not supported"):
        SerialTransport(url)
    assert opened == []
    for permitted in ("socket://h:1", "SOCKET://h:1", "rfc2217://h:1"):
        SerialTransport(permitted)
    assert len(opened) == 3


ERRORS: list[tuple[Exception, type[InstrumentError], str]] = [
    (serial.SerialTimeoutException("full"), InstrumentTimeout, "the serial port accepts no more bytes"),
    (serial.SerialException("gone"), InstrumentDisconnected, "gone"),
    (OSError(5, "Input/output error"), InstrumentDisconnected, "Input/output error"),
    (TypeError("x"), InstrumentDisconnected, "the port is not open"),
    (AttributeError("x"), InstrumentDisconnected, "the port is not open"),
    (ValueError("bad"), InstrumentError, "bad"),
    (RuntimeError("driver"), InstrumentDisconnected, "RuntimeError: driver"),
]


@pytest.mark.parametrize(("error", "kind", "words"), ERRORS, ids=[type(error).__name__ for error, _, _ in ERRORS])
@pytest.mark.parametrize("call", ["write", "read", "close"])
def test_every_error_of_a_port_is_raised_as_an_instrument_error(
    opened: list[dict[str, Any]], error: Exception, kind: type[InstrumentError], words: str, call: str
) -> None:
    def fail(*_: Any) -> Any:
        raise error

    line = SerialTransport("/dev/ttyX")
    setattr(line._port, call, fail)
    act = {"write": lambda: line.write(b"?"), "read": lambda: line.read(3, 1.0), "close": line.close}[call]
    with pytest.raises(InstrumentError) as caught:
        act()
    assert type(caught.value) is kind
    assert str(caught.value).startswith("/dev/ttyX: ")
    assert words in str(caught.value)
    assert caught.value.__cause__ is error


def test_unread_bytes_are_discarded_before_a_message_is_sent(opened: list[dict[str, Any]]) -> None:
    line = SerialTransport("/dev/ttyX")
    line._port = port = Port(b"1\n", unread=b"late answer")
    line.write(b"?\n")
    assert (port.unread, port.written) == (b"", [b"?\n"])
    assert line.read(10, 0.7, b"\n") == b"1\n"
    assert port.timeout == 0.7


@pytest.mark.parametrize(
    ("received", "size", "end", "is_complete"),
    [
        (b"12345", 5, b"", True),
        (b"1234", 5, b"", False),
        (b"12\n", 5, b"\n", True),
        (b"12", 5, b"\n", False),
        (b"12345", 5, b"\n", True),
        (b"", 1, b"\n", False),
        (b"12\n", 5, b"", False),
    ],
)
@pytest.mark.parametrize("system", ["linux", "win32"])
def test_an_answer_is_complete_by_its_size_or_its_end(
    opened: list[dict[str, Any]],
    monkeypatch: pytest.MonkeyPatch,
    system: str,
    received: bytes,
    size: int,
    end: bytes,
    is_complete: bool,
) -> None:
    line = SerialTransport("/dev/ttyX")
    pieces = [received] if system == "linux" else [received[k : k + 1] for k in range(len(received))]
    line._port = Port(*pieces)
    monkeypatch.setattr(transport, "sys", SimpleNamespace(platform=system))
    if is_complete:
        assert line.read(size, 0.01, end) == received
    else:
        with pytest.raises(InstrumentTimeout, match=r"within 0\.01 s") as caught:
            line.read(size, 0.01, end)
        assert (f"only {received!r} came" if received else "nothing came") in str(caught.value)


def test_polling_reads_no_byte_beyond_the_end_of_an_answer(opened: list[dict[str, Any]]) -> None:
    line = SerialTransport("/dev/ttyX")
    line._port = port = Port(b"1", b"", b"\n", b"2")
    assert line._polled(9, 10.0, b"\n") == b"1\n"
    assert (port.pieces, set(port.reads), port.timeout) == ([b"2"], {1}, 0)
    line._port = port = Port(b"12", b"", b"3")
    assert line._polled(3, 10.0, b"") == b"123"
    assert port.reads == [3, 1, 1]


def test_a_port_is_closed_before_it_is_reopened_and_a_pseudo_terminal_is_not(opened: list[dict[str, Any]]) -> None:
    line = SerialTransport("/dev/ttyX")
    first = line._port
    assert line.reopen() is True
    assert (first.closed, len(opened)) == (1, 2)
    terminal = SerialTransport("/dev/pts/99999")
    assert terminal.reopen() is False
    assert len(opened) == 3


class Resource:
    # A VISA resource that records its calls, and answers or raises an error as prepared.

    def __init__(self) -> None:
        self.timeout: float | None = None
        self.read_termination: str | None = "unset"
        self.calls: list[tuple[Any, ...]] = []
        self.answer: bytes | Exception = timeout_error()

    def read_bytes(self, size: int, break_on_termchar: bool = False) -> bytes:
        self.calls.append(("read", size, self.timeout, break_on_termchar, self.read_termination))
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer

    def write_raw(self, message: bytes) -> None:
        self.calls.append(("write", message, self.timeout))

    def close(self) -> None:
        self.calls.append(("close",))


def timeout_error() -> Exception:
    return pyvisa.errors.VisaIOError(pyvisa.constants.StatusCode.error_timeout)


def lost_error() -> Exception:
    return pyvisa.errors.VisaIOError(pyvisa.constants.StatusCode.error_connection_lost)


@pytest.fixture
def resources(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, int, Resource]]:
    # Replace PyVISA; return a list of the opened resources: name, time limit (ms) and resource.
    calls: list[tuple[str, int, Resource]] = []

    def open_resource(name: str, open_timeout: int) -> Resource:
        calls.append((name, open_timeout, Resource()))
        return calls[-1][2]

    monkeypatch.setattr(pyvisa, "ResourceManager", lambda library: SimpleNamespace(open_resource=open_resource))
    return calls


@pytest.mark.parametrize(
    ("address", "name", "is_stream"),
    [
        ("TCPIP::h::5025::SOCKET", "TCPIP::h::5025::SOCKET", True),
        ("tcpip::h::5025::socket#2", "tcpip::h::5025::socket", True),
        ("TCPIP::h::INSTR", "TCPIP::h::INSTR", False),
        ("USB0::1::2::INSTR", "USB0::1::2::INSTR", False),
        ("COM3", "ASRL3::INSTR", True),
        ("/dev/ttyS1", "ASRL/dev/ttyS1::INSTR", True),
    ],
)
def test_late_answers_are_discarded_on_streams_only(
    resources: list[tuple[str, int, Resource]], address: str, name: str, is_stream: bool
) -> None:
    line = VisaTransport(address)
    ((opened_name, open_ms, resource),) = resources
    assert (opened_name, open_ms) == (name, 3000)
    line.write(b"?\n")
    reads = [call for call in resource.calls if call[0] == "read"]
    assert len(reads) == (2 if is_stream else 0)  # at the opening, and before the message
    assert all(call[2] == 1 for call in reads)  # waits for 1 ms only
    assert resource.calls[-1] == ("write", b"?\n", 2000)


@pytest.mark.parametrize(("timeout_s", "timeout_ms"), [(1.0, 1000), (0.25, 250), (0.0001, 1)])
@pytest.mark.parametrize("end", [b"\n", b"\r", b""])
def test_a_visa_read_ends_at_its_byte_and_its_time(
    resources: list[tuple[str, int, Resource]], timeout_s: float, timeout_ms: int, end: bytes
) -> None:
    line = VisaTransport("TCPIP::h::INSTR")
    resource = resources[0][2]
    resource.answer = b"1.5\n"
    assert line.read(99, timeout_s, end) == b"1.5\n"
    assert resource.calls[-1] == ("read", 99, timeout_ms, bool(end), end.decode() or None)


def test_a_visa_line_is_closed_before_it_is_opened_again(resources: list[tuple[str, int, Resource]]) -> None:
    line = VisaTransport("TCPIP::h::INSTR")
    assert line.reopen() is True
    (_, _, first), (name, _, second) = resources
    assert first.calls[-1] == ("close",)
    assert name == "TCPIP::h::INSTR"
    line.write(b"?\n")
    assert second.calls[-1] == ("write", b"?\n", 2000)


def test_a_visa_timeout_leaves_the_line_open_and_another_error_closes_it(
    resources: list[tuple[str, int, Resource]],
) -> None:
    line = VisaTransport("TCPIP::h::INSTR")
    resource = resources[0][2]
    with pytest.raises(InstrumentTimeout, match=r"^TCPIP::h::INSTR: no complete answer within 0\.5 s$"):
        line.read(9, 0.5, b"\n")
    line.write(b"?")
    for error in (lost_error(), RuntimeError("HiSLIP")):
        resource.answer = error
        with pytest.raises(InstrumentDisconnected, match=r"TCPIP::h::INSTR: "):
            line.read(9, 0.5, b"\n")
        sent = list(resource.calls)
        with pytest.raises(InstrumentDisconnected, match=r"TCPIP::h::INSTR: .* was lost"):
            line.write(b"?")
        assert resource.calls == sent
        assert line.reopen() is True
        assert resource.calls[-1] == ("close",)
        resource = resources[-1][2]
        line.write(b"?")
        assert resource.calls[-1][0] == "write"


def test_a_stream_that_was_lost_is_noticed_when_it_is_opened_and_is_closed_again(
    monkeypatch: pytest.MonkeyPatch, resources: list[tuple[str, int, Resource]]
) -> None:
    monkeypatch.setattr(Resource, "read_bytes", lambda self, size: (_ for _ in ()).throw(lost_error()))
    with pytest.raises(InstrumentDisconnected):
        VisaTransport("TCPIP::h::5025::SOCKET")
    assert resources[0][2].calls == [("close",)]


def test_the_library_of_visa_is_chosen_by_the_environment(
    monkeypatch: pytest.MonkeyPatch, opened: list[dict[str, Any]], resources: list[tuple[str, int, Resource]]
) -> None:
    monkeypatch.delenv("PYVISA_LIBRARY", raising=False)
    assert isinstance(open_visa("COM3", 19200, 2), SerialTransport)
    assert (opened[0]["baudrate"], opened[0]["stopbits"]) == (19200, 2)
    assert isinstance(open_visa("TCPIP::h::INSTR"), VisaTransport)
    monkeypatch.setenv("PYVISA_LIBRARY", "@ivi")
    assert isinstance(open_visa("COM3"), VisaTransport)


class Scripted:
    # An emulated instrument that answers after a given time on its clock.

    def __init__(self, clock: SimulatedClock, answer: bytes, after_s: float = 0.0) -> None:
        self._clock, self._answer, self._after_s = clock, answer, after_s

    def receive(self, data: bytes) -> bytes:
        self._clock.sleep(self._after_s)
        return self._answer


def test_an_answer_in_process_is_read_up_to_its_end_and_discarded_by_the_next_message() -> None:
    clock = SimulatedClock()
    line = InProcessTransport(Scripted(clock, b"ab\ncd"), clock)
    line.write(b"?")
    assert [line.read(9, 1.0, b"\n"), line.read(1, 1.0), line.read(1, 1.0)] == [b"ab\n", b"c", b"d"]
    line.write(b"?")
    assert line.read(2, 1.0, b"\n") == b"ab"  # the answer ends at its size, before its end character
    line.write(b"??")
    assert line.read(3, 1.0) == b"ab\n"
    assert line.sent == [b"?", b"?", b"??"]
    assert clock.now() == 0.0
    with pytest.raises(InstrumentTimeout, match="only b'cd' came"):
        line.read(3, 0.5)
    assert clock.now() == 0.5


@pytest.mark.parametrize(("after_s", "is_in_time"), [(0.5, True), (0.51, False)])
def test_an_answer_in_process_that_is_late_is_a_timeout(after_s: float, is_in_time: bool) -> None:
    clock = SimulatedClock()
    line = InProcessTransport(Scripted(clock, b"1\n", after_s), clock)
    line.write(b"?")
    if is_in_time:
        assert line.read(9, 0.5, b"\n") == b"1\n"
    else:
        with pytest.raises(InstrumentTimeout):
            line.read(9, 0.5, b"\n")


def test_an_interrupted_message_is_not_sent_and_reading_is_not_interrupted() -> None:
    clock = SimulatedClock()
    line = InProcessTransport(Scripted(clock, b"1\n"), clock, "somewhere")
    stops: list[bool] = []

    def between() -> None:
        if stops:
            raise KeyboardInterrupt

    interruptible = InterruptibleTransport(line, between)
    assert (interruptible.address, interruptible.reopen()) == ("somewhere", False)
    interruptible.write(b"a")
    stops.append(True)
    assert interruptible.read(9, 1.0, b"\n") == b"1\n"
    with pytest.raises(KeyboardInterrupt):
        interruptible.write(b"b")
    assert line.sent == [b"a"]
    interruptible.close()


OPENED_LATER = """
import sys
from eimi_drivers.clock import WallClock
from eimi_drivers.emulators.serve import emulate, serve_tcp
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.supplies.visa import load_visa, open_visa

with serve_tcp(emulate("scpi", CoilSupply(WallClock()))) as address:
    load_visa(address)
    before = set(sys.modules)
    open_visa(address).close()
print([name for name in set(sys.modules) - before if name.startswith(("pyvisa", "serial", "zeroconf"))])
"""


def test_a_loaded_visa_library_imports_nothing_when_a_resource_is_opened() -> None:
    # The guardian (the process that switches the coil off if a run dies) loads the library while it waits.
    done = subprocess.run([sys.executable, "-c", OPENED_LATER], capture_output=True, timeout=PATIENCE_S, check=True)
    assert done.stdout.strip() == b"[]"


@pytest.mark.parametrize(
    ("address", "path"),
    [
        ("/dev/pts/3", "/dev/pts/3"),  # Linux
        ("ASRL/dev/ttys012::INSTR", "/dev/ttys012"),  # macOS
        ("/dev/ttyS0", ""),
        ("/dev/tty.usbserial-10", ""),
        ("COM12", ""),
    ],
)
def test_pseudo_terminals_of_linux_and_macos_are_told_from_other_ports(address: str, path: str) -> None:
    assert pseudo_terminal(address) == path

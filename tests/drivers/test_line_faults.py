"""After a single fault of the line or of a driver, the output of the supply is off."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager

import pytest
from pyvisa.constants import ResourceAttribute

from eimi_drivers.clock import WallClock
from eimi_drivers.emulators import CoilSupply, emulate, serve_pty, serve_tcp
from eimi_drivers.emulators.faults import Fault, FaultyInstrument
from eimi_drivers.emulators.hislip import serve_hislip
from eimi_drivers.interfaces import InstrumentDisconnected, InstrumentTimeout, Limits, PowerSupply, SwitchOffFailed
from eimi_drivers.supplies import open_supply
from eimi_drivers.supplies.visa import VisaTransport
from tests.patience import PATIENCE_S

LIMITS = Limits(current_A=1.0, voltage_V=12.0)


@contextmanager
def energised(serve, driver: str = "scpi") -> Iterator[tuple[PowerSupply, CoilSupply, FaultyInstrument]]:
    coil = CoilSupply(WallClock())
    line = FaultyInstrument(emulate(driver, coil))
    with serve(line) as address, closing(open_supply(driver, address, LIMITS)) as supply:
        supply.set_voltage(12.0)
        supply.set_current(0.5)
        supply.set_output(True)
        yield supply, coil, line


@pytest.mark.parametrize("serve", [serve_tcp, serve_hislip])
@pytest.mark.parametrize("message", [b"CURR 0", b"CURR?", b"OUTP 0", b"OUTP?"])
def test_a_line_that_was_dropped_once_is_reopened_and_the_output_goes_off(serve, message: bytes) -> None:
    with energised(serve) as (supply, coil, line):
        line.inject(Fault.DROP, lambda data: data.startswith(message))
        supply.safe_off()
        assert not coil.state.output
        assert coil.state.set_current_A == 0.0
        assert supply.measure().current_A == pytest.approx(0.0, abs=0.5)  # the line still works


def first(message: bytes) -> Callable[[bytes], bool]:
    # Return a function that is True for the first message that begins with `message`.
    seen: list[bytes] = []

    def concerns(data: bytes) -> bool:
        seen.extend([data] if data.startswith(message) else [])
        return seen == [data]

    return concerns


def test_one_unreadable_answer_while_switching_off_is_asked_for_again_on_the_same_line() -> None:
    with energised(serve_tcp, "korad") as (supply, coil, line):  # this supply has no serial number
        supply.identify()
        line.inject(Fault.GARBAGE, first(b"ISET1?"))
        assert not supply.safe_off().found_off
        assert not coil.state.output


@pytest.mark.parametrize("driver", ["scpi", "keysight-e3631a"])
def test_an_error_in_the_queue_of_the_supply_does_not_hinder_that_the_supply_is_confirmed_off(driver: str) -> None:
    with energised(serve_tcp, driver) as (supply, coil, line):
        supply.identify()
        line.instrument._errors.append('-410,"Query INTERRUPTED"')
        supply.safe_off()
        assert not coil.state.output


def test_a_message_on_a_socket_does_not_wait_for_the_acknowledgement_of_the_message_before() -> None:
    with serve_tcp(emulate("scpi", CoilSupply(WallClock()))) as address, closing(VisaTransport(address)) as line:
        for _ in range(2):
            assert line._resource.get_visa_attribute(ResourceAttribute.tcpip_nodelay) == 1  # read from the socket
            line.reopen()


def test_a_dropped_hislip_line_is_an_error_of_the_instrument() -> None:
    with energised(serve_hislip) as (supply, _, line):
        line.inject(Fault.DROP)
        with pytest.raises(InstrumentDisconnected, match=r"hislip0.*dropped"):
            supply.measure()


def test_a_fault_in_a_driver_does_not_prevent_the_output_from_going_off(monkeypatch: pytest.MonkeyPatch) -> None:
    with energised(serve_tcp) as (supply, coil, _):
        monkeypatch.setattr(supply, "_current_set", lambda: 1 / 0)
        with pytest.raises(
            SwitchOffFailed, match=r"zero: failed \(ZeroDivisionError.*output off: done; read back: done"
        ):
            supply.safe_off()
        assert not coil.state.output


def test_setting_the_wall_clock_back_extends_no_timeout(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        link = VisaTransport(f"TCPIP::127.0.0.1::{silent.getsockname()[1]}::SOCKET")
        wall, caught = time.time, []

        def ask() -> None:
            link.write(b"*IDN?\n")
            try:
                link.read(10, 0.5, b"\n")
            except InstrumentTimeout as error:
                caught.append(error)

        asking = threading.Thread(target=ask, daemon=True)
        asking.start()
        WallClock().sleep(0.1)
        monkeypatch.setattr(time, "time", lambda: wall() - 3600)
        asking.join(PATIENCE_S)
        assert len(caught) == 1
        link.close()


@pytest.mark.parametrize(("first", "second"), [("scpi", "scpi"), ("scpi", "korad"), ("genesys", "scpi")])
def test_a_serial_port_belongs_to_one_program(first: str, second: str) -> None:
    coil = CoilSupply(WallClock())
    with serve_pty(emulate(first, coil)) as port:
        places = {"scpi": f"ASRL{port}::INSTR", "korad": port, "genesys": port}
        with closing(open_supply(first, places[first], LIMITS)) as supply:
            identity = supply.identify()
            with pytest.raises(InstrumentDisconnected, match="lock"):
                open_supply(second, places[second], LIMITS)
            assert supply.identify() == identity
        open_supply(second, places[second], LIMITS).close()

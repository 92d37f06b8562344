"""Checks of a sensor driver with an emulated instrument (software that behaves like an instrument)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import dataclass

from eimi_drivers.clock import SimulatedClock, WallClock
from eimi_drivers.contract import check_sensor as check_members
from eimi_drivers.contract import check_sensor_driver
from eimi_drivers.emulators.faults import Fault, FaultyInstrument
from eimi_drivers.emulators.sensors import EmulatedQuantity
from eimi_drivers.emulators.serve import serve_pty
from eimi_drivers.interfaces import (
    Clock,
    Identity,
    InstrumentDisconnected,
    InstrumentError,
    InstrumentTimeout,
    ReplyNotUnderstood,
    Sensor,
    SensorDriver,
    SensorReading,
)
from eimi_drivers.sensors.sensor_names import open_with
from eimi_drivers.supplies.transport import InProcessTransport, Responder
from eimi_drivers.testing.claims import claim, must_raise, run_checks, within

PATIENCE_S = 60.0
CALL_WITHIN_S = 2.0
"""The longest permitted `timeout_s`, and the longest permitted duration of a `read` without a valid answer, s.

The duration is measured on the clock of the sensor. In real time, twice this duration is permitted.
"""


@dataclass
class SensorBench:
    """An open sensor, the emulated instrument, and the true value of the measured quantity.

    Parameters
    ----------
    sensor : Sensor
        Open sensor.
    true : list of float
        True values in `unit`; the last element is the present value.
    unit : str
        Unit of the true values.
    line : FaultyInstrument
        Emulated instrument that can produce faults.
    clock : Clock
        Clock of the driver and of the emulated instrument.
    address : str
        Address of the sensor.
    """

    sensor: Sensor
    true: list[float]
    unit: str
    line: FaultyInstrument
    clock: Clock
    address: str

    def reads(self, value: float) -> None:
        """Set the true value, and raise AssertionError if the sensor returns another value."""
        self.true.append(value)
        before_s = self.clock.now()
        reading = self.sensor.read()
        claim(isinstance(reading, SensorReading), f"read() should return a SensorReading, not {reading!r}")
        claim(reading.unit == self.unit, f"read() should return the unit {self.unit!r}, not {reading.unit!r}")
        tolerance = 1e-4 * abs(value) + 1e-3
        claim(
            abs(reading.value - value) <= tolerance,
            f"read() should return the true value {value:g}, not {reading.value:g}",
        )
        claim(
            before_s <= reading.time_s <= self.clock.now(), "read() should return the time at which the value arrived"
        )
        sigma = reading.standard_uncertainty
        claim(
            sigma is None or 0 <= sigma < math.inf,
            f"the standard uncertainty should be None or a finite number of 0 or above, not {sigma!r}",
        )


def states_its_identity(bench: SensorBench) -> None:
    """Check that `identify` returns driver, text and address, and that `timeout_s` is positive and not too long."""
    identity = bench.sensor.identify()
    claim(isinstance(identity, Identity), f"identify() should return an Identity, not {identity!r}")
    claim(bool(identity.driver and identity.text), f"identify() should return a driver and a text, not {identity}")
    claim(
        identity.address == bench.address,
        f"identify() should return the address {bench.address!r}, not {identity.address!r}",
    )
    claim(
        0 < bench.sensor.timeout_s <= CALL_WITHIN_S,
        f"timeout_s should be above 0 s and at most {CALL_WITHIN_S:g} s, not {bench.sensor.timeout_s!r}",
    )


def reads_values_of_either_sign(bench: SensorBench) -> None:
    """Check that `read` returns positive and negative values with their unit and their time."""
    for value in (0.0, 3.2915, -3.2915, 29.9):
        bench.reads(value)


def gives_up_on_a_silent_line(bench: SensorBench) -> None:
    """Check that a missing answer raises InstrumentTimeout in time, and that later queries work."""
    bench.reads(1.0)
    bench.line.inject(Fault.SILENCE)
    for _ in range(2):
        must_raise((InstrumentTimeout,), "read() on a silent line", lambda: _in_time(bench))
    bench.line.inject(None)
    bench.reads(2.0)


def understands_no_garbage(bench: SensorBench) -> None:
    """Check that an unreadable answer raises InstrumentTimeout or ReplyNotUnderstood, and that the next query works."""
    for fault in (Fault.GARBAGE, Fault.PARTIAL):
        bench.line.inject(fault)
        must_raise(
            (InstrumentTimeout, ReplyNotUnderstood), f"read() with {fault.word} answers", lambda: _in_time(bench)
        )
        bench.line.inject(None)
        bench.reads(1.5)


def takes_no_late_answer_for_the_next(bench: SensorBench) -> None:
    """Check that `read` waits at least 0.3 s for an answer, and never returns a late answer to an earlier query."""
    bench.line.inject(Fault.SLOW)
    bench.reads(1.0)
    bench.line.late_s = bench.sensor.timeout_s + 0.3
    with suppress(InstrumentTimeout):  # a driver may wait longer
        bench.sensor.read()
    bench.line.inject(None)
    bench.reads(-2.0)


def reports_a_cut_line(bench: SensorBench) -> None:
    """Check that `read` raises InstrumentDisconnected or InstrumentTimeout, twice, after the connection was cut."""
    bench.reads(1.0)
    bench.line.inject(Fault.DISCONNECT)
    for _ in range(2):
        must_raise(
            (InstrumentDisconnected, InstrumentTimeout), "read() on a line that was cut", lambda: _in_time(bench)
        )


def closes_twice(bench: SensorBench) -> None:
    """Check that closing twice is allowed, and that `read` of a closed sensor raises InstrumentError or no error."""
    bench.sensor.close()
    bench.sensor.close()
    with suppress(InstrumentError):
        bench.sensor.read()


SENSOR_CHECKS: tuple[Callable[[SensorBench], None], ...] = (
    states_its_identity,
    reads_values_of_either_sign,
    gives_up_on_a_silent_line,
    understands_no_garbage,
    takes_no_late_answer_for_the_next,
    reports_a_cut_line,
    closes_twice,
)
"""The checks that `check_sensor` runs."""


@contextmanager
def sensor_bench(
    open: SensorDriver,
    emulator: Callable[[EmulatedQuantity], Responder],
    unit: str = "mT",
    serve: Callable[[Responder], AbstractContextManager[str]] | None = None,
) -> Iterator[SensorBench]:
    """Connect a sensor driver to an emulated instrument while the `with` block runs, and yield both as a `SensorBench`.

    Parameters
    ----------
    open : SensorDriver
        Driver.
    emulator : callable
        Takes an `EmulatedQuantity` and returns an object whose `receive(data: bytes) -> bytes` answers queries.
    unit : str
        Unit of the values, such as "mT" or "degC".
    serve : callable, optional
        Context manager that yields the address of the emulated instrument, such as `serve_pty` or `serve_tcp`.
    """
    name = str(getattr(open, "name", getattr(open, "__name__", "sensor")))
    with ExitStack() as stack:
        simulated = serve is None and hasattr(open, "connect")
        clock: Clock = SimulatedClock() if simulated else WallClock()
        true = [0.0]
        line = FaultyInstrument(emulator(EmulatedQuantity(clock, lambda: true[-1], unit)), clock)
        if simulated:
            address = "in-process"
            check_sensor_driver(name, open)
            sensor = open(InProcessTransport(line, clock, address), clock)
            check_members(name, open, sensor)
        else:
            address = stack.enter_context((serve or serve_pty)(line))
            sensor = open_with(open, name, address, clock)
        stack.callback(sensor.close)
        yield SensorBench(sensor, true, unit, line, clock, address)


def check_sensor(
    open: SensorDriver,
    emulator: Callable[[EmulatedQuantity], Responder],
    *,
    unit: str = "mT",
    serve: Callable[[Responder], AbstractContextManager[str]] | None = None,
    checks: Iterable[Callable[[SensorBench], None]] = SENSOR_CHECKS,
) -> None:
    """Check a sensor driver with an emulated instrument.

    Parameters
    ----------
    open : SensorDriver
        Driver: a class or a function that opens a sensor.
    emulator : callable
        Takes an `EmulatedQuantity` and returns an object whose `receive(data: bytes) -> bytes` answers queries, such as
        ``lambda quantity: emulate_sensor("text-line", quantity)``.
    unit : str
        Unit of the values, such as "mT" or "degC".
    serve : callable, optional
        Context manager that yields the address of the emulated instrument, such as `serve_pty` or `serve_tcp`.
    checks : iterable of functions, optional
        Selection of `SENSOR_CHECKS`; all checks by default.

    Raises
    ------
    AssertionError
        At least one check failed; the message lists all failed checks.
    """
    subject = f"the sensor driver {getattr(open, '__name__', open)}"
    run_checks(subject, checks, lambda: sensor_bench(open, emulator, unit, serve))


def _in_time(bench: SensorBench) -> SensorReading:
    simulated = isinstance(bench.clock, SimulatedClock)
    began_s = bench.clock.now()
    try:
        return within(PATIENCE_S if simulated else 2 * CALL_WITHIN_S, "read()", bench.sensor.read)
    finally:
        if simulated:
            took_s = bench.clock.now() - began_s
            claim(took_s <= CALL_WITHIN_S, f"read() should end within {CALL_WITHIN_S:g} s, but took {took_s:g} s")

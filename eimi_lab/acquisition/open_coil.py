"""Open the supply and the sensors of a rig file, start the guardian process, and end all of them after use.

The guardian process switches the supply off if the run dies.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from eimi_drivers.interfaces import Camera, Clock, InstrumentDisconnected, InstrumentError, PowerSupply, Sensor
from eimi_lab.acquisition.event_words import on_terminal
from eimi_lab.acquisition.events import OnEvent, Warned
from eimi_lab.acquisition.guardian import Guardian, Ward, guarding
from eimi_lab.acquisition.interruption import Interruption
from eimi_lab.acquisition.sensing import OpenSensor, coil_thermometer
from eimi_lab.acquisition.supply_lock import only_run_on
from eimi_lab.config.rig import Rig
from eimi_lab.process.awake import kept_awake
from eimi_lab.process.progress import silent

if TYPE_CHECKING:
    from eimi_drivers.discovery import Found

WITHOUT_INSTRUMENT = "`eimi instruments` shows more, and --rig virtual needs no instrument"
"""What a person at a terminal can do if an instrument was not found."""


@dataclass(frozen=True)
class CoilBench:
    """The open supply of a coil, the clock, the guardian of the supply, and the open sensors.

    The guardian is the process that switches the coil off if the run dies; None for a simulated supply. `interruption`
    lets a signal interrupt long operations of the supply.
    """

    supply: PowerSupply
    clock: Clock
    guardian: Guardian | None = None
    interruption: Interruption = field(default_factory=Interruption)
    sensors: tuple[OpenSensor, ...] = ()


@contextmanager
def open_coil(
    rig: Rig,
    transcript: Path | None = None,
    *,
    on_event: OnEvent | None = None,
    guardian_events: int | None = None,
) -> Iterator[CoilBench]:
    """Open the real supply and sensors of a rig file, and close them at the end of the context.

    Parameters
    ----------
    rig : Rig
        The instruments, with their limits.
    transcript : Path or None
        New file for every message to and from the supply.
    on_event : OnEvent or None
        Receives a warning if an instrument cannot be closed or the transcript is incomplete; None prints the warning.
    guardian_events : int or None
        File descriptor for the events of the guardian (the process that switches the coil off if the run dies).

    Yields
    ------
    CoilBench
        The open instruments.

    Raises
    ------
    InstrumentError
        If an instrument cannot be opened, or if another run uses the supply.
    """
    from eimi_drivers.clock import WallClock
    from eimi_drivers.sensors.sensor_names import open_sensor
    from eimi_drivers.supplies.supply_names import open_supply
    from eimi_lab.acquisition.added_driver import pack

    wall, interruption, driver, within = WallClock(), Interruption(), rig.supply.driver, rig.supply.opened_with
    ward = Ward(driver, rig.supply.address, within.current_A, within.voltage_V, pack(driver), within.off_below_A)
    with ExitStack() as opened:
        opened.enter_context(only_run_on(rig.supply.address))
        opened.enter_context(kept_awake("a run is in progress and a current flows in a coil"))
        guardian = opened.enter_context(guarding(ward, guardian_events))
        try:
            tell = on_event or on_terminal(silent)
            supply = open_supply(ward.driver, ward.address, within, wall, transcript, interruption.between_messages)
            opened.callback(close_or_tell, supply, tell)
            sensors = []
            for rule in rig.sensors:
                sensor: Sensor = (
                    coil_thermometer(rule, supply, wall)
                    if rule.is_coil
                    else open_sensor(rule.driver, rule.address, wall)
                )
                sensors.append(OpenSensor(rule, sensor))
                opened.callback(close_or_tell, sensors[-1].sensor, tell)
        except InstrumentDisconnected as error:
            raise InstrumentDisconnected(f"{error}; {attached()}") from error
        yield CoilBench(supply, wall, guardian, interruption, tuple(sensors))


def open_virtual_sensors(
    rig: Rig, supply: PowerSupply, field_mT: Callable[[], float], clock: Clock
) -> tuple[OpenSensor, ...]:
    """Open and return the simulated sensors of a rig file.

    Parameters
    ----------
    rig : Rig
        Contents of the rig file.
    supply : PowerSupply
        The simulated supply. Its current and voltage give the temperature of the coil.
    field_mT : callable
        Returns the true magnetic field, mT, for the other sensors.
    clock : Clock
        The simulated clock.
    """
    from eimi_lab.virtual.virtual_sensors import open_virtual_sensor

    return tuple(
        OpenSensor(
            rule,
            coil_thermometer(rule, supply, clock) if rule.is_coil else open_virtual_sensor(rule, field_mT, clock),
        )
        for rule in rig.sensors
    )


def close_or_tell(instrument: Camera | PowerSupply | Sensor, on_event: OnEvent) -> None:
    """Close an instrument, and send an error as a warning to `on_event`."""
    try:
        instrument.close()
    except InstrumentError as error:
        on_event(Warned(message=str(error)))


def attached() -> str:
    """Return a text that lists the serial ports and cameras of this computer."""
    from eimi_drivers.discovery import list_cameras, list_serial_ports

    return (
        f"serial ports of this computer: {_addresses(list_serial_ports)}; cameras: {_addresses(list_cameras)}; "
        f"{WITHOUT_INSTRUMENT}"
    )


def _addresses(search: Callable[[], Iterable[Found]]) -> str:
    """Return the addresses of the instruments that `search` finds, separated by commas; "none" if there are none."""
    try:
        return ", ".join(instrument.address for instrument in search()) or "none"
    except OSError as error:
        return str(error)

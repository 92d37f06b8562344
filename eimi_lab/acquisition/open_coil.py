"""Open the supply and the sensors of a rig, start the guardian process, and end all of them after use.

A rig is the set of instruments that a rig file lists. The guardian process switches the supply off if the run dies.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, closing, contextmanager
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
    """The open supply of a coil, the clock, the guardian of the supply, and the open sensors of a rig file.

    The guardian is the process that switches the coil off if the run dies; None for a simulated supply, which ends
    together with the run. `interruption` lets a signal such as Ctrl-C interrupt long operations of the supply.
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
    """Open the supply and the sensors of a rig with real instruments, and close them at the end of the context.

    Parameters
    ----------
    rig : Rig
        The instruments, with the limits that apply.
    transcript : Path or None
        New file that records every message to and from the supply.
    on_event : OnEvent or None
        Receives a warning if a sensor cannot be closed. By default the warning is printed.
    guardian_events : int or None
        File descriptor to which the guardian (the process that switches the coil off if the run dies) writes its events
        (records of what happened) as lines of JSON. None writes no events.

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
            supply = opened.enter_context(
                closing(open_supply(ward.driver, ward.address, within, wall, transcript, interruption.between_messages))
            )
            sensors = []
            for rule in rig.sensors:
                sensor: Sensor = (
                    coil_thermometer(rule, supply, wall)
                    if rule.is_coil
                    else open_sensor(rule.driver, rule.address, wall)
                )
                sensors.append(OpenSensor(rule, sensor))
                opened.callback(close_or_tell, sensors[-1].sensor, on_event or on_terminal(silent))
        except InstrumentDisconnected as error:
            raise InstrumentDisconnected(f"{error}; {attached()}") from error
        yield CoilBench(supply, wall, guardian, interruption, tuple(sensors))


def open_virtual_sensors(
    rig: Rig, supply: PowerSupply, field_mT: Callable[[], float], clock: Clock
) -> tuple[OpenSensor, ...]:
    """Open and return the sensors of a virtual rig, whose instruments are simulated.

    Parameters
    ----------
    rig : Rig
        The rig file, which lists the sensors.
    supply : PowerSupply
        The simulated supply. A sensor that uses the coil as a thermometer reads the current and voltage of this supply.
    field_mT : callable
        Returns the true magnetic field, mT, which every other sensor measures.
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


def close_or_tell(instrument: Camera | Sensor, on_event: OnEvent) -> None:
    """Close a camera or a sensor, and send an error as a warning event to `on_event`.

    The error does not end the run, because the coil is off and the states (load steps) are stored.
    """
    try:
        instrument.close()
    except InstrumentError as error:
        on_event(Warned(message=str(error)))


def attached() -> str:
    """Return a text that lists the serial ports and cameras of this computer.

    The text is part of the error message about an instrument that was not found.
    """
    from eimi_drivers.discovery import list_cameras, list_serial_ports

    return (
        f"serial ports of this computer: {_addresses(list_serial_ports)}; cameras: {_addresses(list_cameras)}; "
        f"{WITHOUT_INSTRUMENT}"
    )


def _addresses(search: Callable[[], Iterable[Found]]) -> str:
    """Return a text with the addresses of the attached instruments that `search` finds, separated by commas.

    `search` lists the serial ports or the cameras of this computer. If there are none, the text is "none". If the
    operating system cannot list them, the text gives the reason.
    """
    try:
        return ", ".join(instrument.address for instrument in search()) or "none"
    except OSError as error:
        return str(error)

"""Open the instruments of a rig for one run, and close them after it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from eimi_drivers.cameras.settings import NO_SETTINGS, CameraSettings
from eimi_drivers.interfaces import Camera, Clock, InstrumentError, PowerSupply, Sensor
from eimi_lab.acquisition.event_words import on_terminal
from eimi_lab.acquisition.events import OnEvent, Warned
from eimi_lab.acquisition.guardian import Guardian, Ward, guarding
from eimi_lab.acquisition.interruption import Interruption
from eimi_lab.acquisition.playback import Cue
from eimi_lab.acquisition.sensing import OpenSensor
from eimi_lab.acquisition.supply_lock import only_run_on
from eimi_lab.config.protocol import SupplyLimits
from eimi_lab.config.rig import Rig
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.process.awake import kept_awake
from eimi_lab.process.progress import silent


@dataclass(frozen=True)
class Bench:
    """The open instruments of a run.

    truth: material and geometry of a virtual beam; None on a real bench. guardian: switches the supply off if the run
    dies; None for a simulated supply, which ends with the run. camera_settings: values read back from the camera after
    it was set up. cue: present state of the run, for a recording. interruption: called by supply and camera during long
    operations, so that a signal can interrupt them. relay: swaps the leads of the coil; None if a person has to.
    sensors: the sensors of the rig.
    """

    supply: PowerSupply
    camera: Camera
    clock: Clock
    truth: dict[str, Any] | None = None
    guardian: Guardian | None = None
    camera_settings: CameraSettings = NO_SETTINGS
    cue: Cue = field(default_factory=Cue)
    interruption: Interruption = field(default_factory=Interruption)
    relay: Callable[[], None] | None = None
    sensors: tuple[OpenSensor, ...] = ()


@contextmanager
def open_bench(
    rig: Rig,
    specimen: SpecimenFile,
    limits: SupplyLimits,
    transcript: Path | None = None,
    *,
    on_event: OnEvent | None = None,
    guardian_events: int | None = None,
) -> Iterator[Bench]:
    """Open the instruments of a rig, and close them at the end of the context.

    Closing does not switch the supply off; `switching_off` does that.

    Parameters
    ----------
    rig : Rig
        The instruments, with their limits.
    specimen : SpecimenFile
        The specimen, for a virtual rig.
    limits : SupplyLimits
        Limits of the protocol. Of each limit, the stricter value of rig and protocol applies.
    transcript : Path or None
        New file that records every message to and from the supply. A virtual supply exchanges no messages.
    on_event : OnEvent or None
        Receives a warning if the camera cannot be closed. By default the warning is printed.
    guardian_events : int or None
        File descriptor to which the guardian writes its events as lines of JSON; it also prints them on standard error.

    Raises
    ------
    InstrumentError
        If an instrument cannot be opened, or if another run uses the supply.
    """
    limited = rig.model_copy(
        update={"supply": rig.supply.model_copy(update={"limits": rig.supply.limits.stricter(limits)})}
    )
    if rig.simulated:
        from eimi_lab.virtual.virtual_rig import open_virtual_rig
        from eimi_lab.virtual.virtual_sensors import open_virtual_sensor

        supply, camera, clock, truth = open_virtual_rig(limited, specimen)
        with closing(supply), closing(camera):
            emulated = tuple(OpenSensor(rule, open_virtual_sensor(rule, camera, clock)) for rule in rig.sensors)
            yield Bench(supply, camera, clock, truth, relay=camera.swap_leads, sensors=emulated)
        return
    from eimi_drivers.cameras.timed import TimedCamera
    from eimi_drivers.clock import WallClock
    from eimi_drivers.interfaces import InstrumentDisconnected
    from eimi_drivers.sensors.sensor_names import open_sensor
    from eimi_drivers.supplies.supply_names import open_supply
    from eimi_lab.acquisition.added_driver import pack
    from eimi_lab.acquisition.cameras import open_rig_camera

    wall, cue, interruption = WallClock(), Cue(), Interruption()
    driver = rig.supply.driver
    within = limited.supply.opened_with
    ward = Ward(driver, rig.supply.address, within.current_A, within.voltage_V, pack(driver), within.off_below_A)
    with ExitStack() as opened:
        opened.enter_context(only_run_on(rig.supply.address))
        opened.enter_context(kept_awake("a run with current in a coil"))
        guardian = opened.enter_context(guarding(ward, guardian_events))
        try:
            supply = opened.enter_context(
                closing(open_supply(ward.driver, ward.address, within, wall, transcript, interruption.between_messages))
            )
            eye = TimedCamera(
                f"camera {rig.camera.source}",
                lambda: open_rig_camera(rig, specimen, wall, cue),
                time.process_time if rig.virtual else time.monotonic,
                interruption.while_waiting,
            )
            opened.callback(_close_or_tell, eye, on_event or on_terminal(silent))
            sensors = []
            for rule in rig.sensors:
                sensors.append(OpenSensor(rule, open_sensor(rule.driver, rule.address, wall)))
                opened.callback(_close_or_tell, sensors[-1].sensor, on_event or on_terminal(silent))
        except InstrumentDisconnected as error:
            raise InstrumentDisconnected(f"{error}; {_attached()}") from error
        yield Bench(
            supply,
            eye,
            wall,
            _truth(rig, specimen),
            guardian,
            eye.settings,
            cue,
            interruption,
            sensors=tuple(sensors),
        )


def _truth(rig: Rig, specimen: SpecimenFile) -> dict[str, Any] | None:
    """Return material and geometry of a virtual beam; None on a real bench."""
    if rig.virtual is None:
        return None
    from eimi_lab.virtual.virtual_rig import truth_of

    return truth_of(rig, specimen)


def _close_or_tell(instrument: Camera | Sensor, on_event: OnEvent) -> None:
    """Close a camera or a sensor; an error becomes a warning: the coil is off and the states are stored by then."""
    try:
        instrument.close()
    except InstrumentError as error:
        on_event(Warned(message=str(error)))


def _attached() -> str:
    """Return a list of the attached instruments, for the error about an instrument that was not found."""
    from eimi_drivers.discovery import list_cameras, list_serial_ports

    ports = ", ".join(port.address for port in list_serial_ports()) or "none"
    cameras = ", ".join(camera.address for camera in list_cameras()) or "none"
    return (
        f"serial ports of this computer: {ports}; cameras: {cameras}; `eimi instruments` shows more, and --rig virtual "
        "needs no instrument"
    )

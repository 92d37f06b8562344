"""Open the instruments of a rig file for one run, and close them after the run."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from eimi_drivers.cameras.settings import NO_SETTINGS, CameraSettings
from eimi_drivers.interfaces import Camera, Clock, PowerSupply
from eimi_lab.acquisition.event_words import on_terminal
from eimi_lab.acquisition.events import OnEvent
from eimi_lab.acquisition.guardian import Guardian
from eimi_lab.acquisition.interruption import Interruption
from eimi_lab.acquisition.open_coil import attached, close_or_tell, open_coil, open_virtual_sensors
from eimi_lab.acquisition.playback import Cue
from eimi_lab.acquisition.sensing import OpenSensor
from eimi_lab.config.protocol import SupplyLimits
from eimi_lab.config.rig import Rig
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.process.progress import silent


@dataclass(frozen=True)
class Bench:
    """The open instruments of a run.

    Attributes
    ----------
    supply, camera, clock
        The supply of the coil, the camera, and the clock of the run.
    truth : dict or None
        Material and geometry of a virtual (simulated) beam; None on a real bench.
    guardian : Guardian or None
        Switches the supply off if the run dies; None for a simulated supply.
    camera_settings : CameraSettings
        Settings that were read back from the camera.
    cue : Cue
        Number of the present state (load step); a camera that plays a recording chooses its picture by this number.
    interruption : Interruption
        Lets a signal interrupt long operations of supply and camera.
    relay : callable or None
        Swaps the leads of the coil; None without a relay.
    sensors : tuple of OpenSensor
        The sensors.
    steps_known : bool
        Whether the supply sets its current in the same steps as the supply in the rig file; false for a stand-in.
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
    steps_known: bool = True


@contextmanager
def open_bench(
    rig: Rig,
    specimen: SpecimenFile,
    limits: SupplyLimits,
    transcript: Path | None = None,
    *,
    on_event: OnEvent | None = None,
    guardian_events: int | None = None,
    rate_Hz: float | None = None,
) -> Iterator[Bench]:
    """Open the instruments of a rig file for a run, and close them at the end of the context.

    The supply is not switched off at the end; use `switching_off` inside the context.

    Parameters
    ----------
    rig : Rig
        The instruments, with their limits.
    specimen : SpecimenFile
        The specimen, for a virtual beam.
    limits : SupplyLimits
        Limits of the protocol. The smaller limit of rig and protocol applies.
    transcript : Path or None
        New file for every message to and from a real supply.
    on_event : OnEvent or None
        Receives a warning if an instrument cannot be closed; None prints the warning.
    guardian_events : int or None
        File descriptor for the events of the guardian (the process that switches the coil off if the run dies).
    rate_Hz : float or None
        Frame rate of the camera, Hz, if the rig file gives none.

    Yields
    ------
    Bench
        The open instruments.

    Raises
    ------
    InstrumentError
        If an instrument cannot be opened, or if another run uses the supply.
    """
    rig = rig.model_copy(update={"camera": rig.camera.at_rate(rate_Hz)})
    limited = rig.model_copy(
        update={"supply": rig.supply.model_copy(update={"limits": rig.supply.limits.stricter(limits)})}
    )
    if rig.simulated:
        from eimi_lab.virtual.virtual_rig import open_virtual_rig

        supply, camera, clock, truth = open_virtual_rig(limited, specimen)
        with closing(supply), closing(camera):
            emulated = open_virtual_sensors(rig, supply, camera.field_mT, clock)
            yield Bench(
                supply,
                camera,
                clock,
                truth,
                camera_settings=camera.settings,
                relay=camera.swap_leads,
                sensors=emulated,
            )
        return
    from eimi_drivers.cameras.timed import TimedCamera
    from eimi_drivers.interfaces import InstrumentDisconnected
    from eimi_lab.acquisition.cameras import open_rig_camera

    cue = Cue()
    with (
        open_coil(limited, transcript, on_event=on_event, guardian_events=guardian_events) as coil,
        ExitStack() as opened,
    ):
        try:
            eye = TimedCamera(
                f"camera {rig.camera.source}",
                lambda: open_rig_camera(rig, specimen, coil.clock, cue),
                time.process_time if rig.virtual else time.monotonic,
                coil.interruption.while_waiting,
            )
        except InstrumentDisconnected as error:
            raise InstrumentDisconnected(f"{error}; {attached()}") from error
        opened.callback(close_or_tell, eye, on_event or on_terminal(silent))
        yield Bench(
            coil.supply,
            eye,
            coil.clock,
            _truth(rig, specimen),
            coil.guardian,
            eye.settings,
            cue,
            coil.interruption,
            sensors=coil.sensors,
        )


def _truth(rig: Rig, specimen: SpecimenFile) -> dict[str, Any] | None:
    """Return the material and the geometry of a virtual beam; None on a real bench."""
    if rig.virtual is None:
        return None
    from eimi_lab.virtual.virtual_rig import truth_of

    return truth_of(rig, specimen)

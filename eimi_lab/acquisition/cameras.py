"""The camera that a rig names: a device, a recording, or the virtual beam in the coil of an emulated supply."""

from __future__ import annotations

from eimi_drivers.cameras.camera_names import open_camera
from eimi_drivers.interfaces import Camera, Clock
from eimi_lab.acquisition.playback import Cue, PlayedCamera
from eimi_lab.config.rig import NO_PLAYBACK, Rig
from eimi_lab.config.specimen import SpecimenFile


def open_rig_camera(rig: Rig, specimen: SpecimenFile, clock: Clock, cue: Cue) -> Camera:
    """Open it and set it up. cue: tells a recording which state the run is at.

    Raises InstrumentError, and InputError for a specimen that the virtual beam cannot be.
    """
    chosen = rig.camera
    if rig.virtual:
        from eimi_drivers.emulators.coil_line import RemoteCoil
        from eimi_lab.virtual.virtual_rig import virtual_camera

        return virtual_camera(rig, specimen, RemoteCoil(str(chosen.source)), clock)

    def open_it() -> Camera:
        return open_camera(chosen.driver, chosen.source, chosen.settings)

    return open_it() if chosen.playback == NO_PLAYBACK else PlayedCamera(open_it, chosen.playback, cue)

"""Open the camera of a rig file: a device, a recording, or a virtual beam."""

from __future__ import annotations

from eimi_drivers.cameras.camera_names import open_camera
from eimi_drivers.interfaces import Camera, Clock
from eimi_lab.acquisition.playback import Cue, PlayedCamera
from eimi_lab.config.rig import NO_PLAYBACK, Rig
from eimi_lab.config.specimen import SpecimenFile


def open_rig_camera(rig: Rig, specimen: SpecimenFile, clock: Clock, cue: Cue) -> Camera:
    """Open the camera of a rig file, apply its settings, and return it.

    Parameters
    ----------
    rig : Rig
        Contents of the rig file, which lists the instruments.
    specimen : SpecimenFile
        The specimen, for a virtual beam.
    clock : Clock
        Clock of the run, for a virtual beam.
    cue : Cue
        Number of the present state (load step), for a camera that plays stored pictures back.

    Raises
    ------
    InstrumentError
        If the camera cannot be opened or set up.
    InputError
        If the virtual beam cannot represent the specimen.
    """
    chosen = rig.camera
    if rig.virtual:
        from eimi_drivers.emulators.coil_line import RemoteCoil
        from eimi_lab.virtual.virtual_rig import virtual_camera

        return virtual_camera(rig, specimen, RemoteCoil(str(chosen.source)), clock)

    def open_it() -> Camera:
        return open_camera(chosen.driver, chosen.source, chosen.settings)

    return open_it() if chosen.playback == NO_PLAYBACK else PlayedCamera(open_it, chosen.playback, cue)

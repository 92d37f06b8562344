"""Open the camera of a rig: a device, a recording, or a virtual beam in the coil of an emulated supply."""

from __future__ import annotations

from eimi_drivers.cameras.camera_names import open_camera
from eimi_drivers.interfaces import Camera, Clock
from eimi_lab.acquisition.playback import Cue, PlayedCamera
from eimi_lab.config.rig import NO_PLAYBACK, Rig
from eimi_lab.config.specimen import SpecimenFile


def open_rig_camera(rig: Rig, specimen: SpecimenFile, clock: Clock, cue: Cue) -> Camera:
    """Open the camera of a rig and apply its settings.

    Parameters
    ----------
    rig : Rig
        Names the camera and its settings.
    specimen : SpecimenFile
        The specimen, for a virtual beam.
    clock : Clock
        Clock of a virtual beam.
    cue : Cue
        Holds the present state of the run, for a recording with one picture for each state.

    Raises
    ------
    InstrumentError
        If the camera cannot be opened or set up.
    InputError
        If a virtual beam cannot represent the specimen.
    """
    chosen = rig.camera
    if rig.virtual:
        from eimi_drivers.emulators.coil_line import RemoteCoil
        from eimi_lab.virtual.virtual_rig import virtual_camera

        return virtual_camera(rig, specimen, RemoteCoil(str(chosen.source)), clock)

    def open_it() -> Camera:
        return open_camera(chosen.driver, chosen.source, chosen.settings)

    return open_it() if chosen.playback == NO_PLAYBACK else PlayedCamera(open_it, chosen.playback, cue)

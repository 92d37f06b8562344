"""Open the camera of a rig: a device, a recording, or a virtual beam in the coil of an emulated supply.

A rig is the set of instruments that a rig file lists.
"""

from __future__ import annotations

from eimi_drivers.cameras.camera_names import open_camera
from eimi_drivers.interfaces import Camera, Clock
from eimi_lab.acquisition.playback import Cue, PlayedCamera
from eimi_lab.config.rig import NO_PLAYBACK, Rig
from eimi_lab.config.specimen import SpecimenFile


def open_rig_camera(rig: Rig, specimen: SpecimenFile, clock: Clock, cue: Cue) -> Camera:
    """Return the open camera of a rig (the instruments of a rig file), with the settings of the camera applied.

    Parameters
    ----------
    rig : Rig
        Rig file, which gives the driver, the source and the settings of the camera.
    specimen : SpecimenFile
        The specimen. Only a virtual beam uses it.
    clock : Clock
        Clock of the run. Only a virtual beam uses it.
    cue : Cue
        Holds the number of the present state (load step) of the run, for a recording with one picture for each state.

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

"""The virtual rig: an emulated supply and a simulated camera behind the drivers' own interfaces.

Current -> coil (time constant, noise) -> field -> the beam's finite-element shape -> a frame. The supply is the
ordinary Korad driver on an emulator in the same process, so that the acquisition runs the code that it runs on a
bench, in simulated seconds.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from eimi_drivers.clock import SimulatedClock
from eimi_drivers.emulators.korad import KoradDialect
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.interfaces import Clock, Frame, Identity, Limits, PowerSupply
from eimi_drivers.supplies.korad import KoradSupply
from eimi_drivers.supplies.transport import InProcessTransport
from eimi_lab.config.materials import TrueMaterial
from eimi_lab.config.rig import Rig, Virtual
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.errors import InputError
from eimi_lab.virtual.beam import VirtualBeam
from eimi_lab.virtual.optics import Scene, expose, make_scene
from eimi_lab.vision.beam_frame import BeamFrame

_FRAME_PERIOD_S = 0.1
_CLAMP_HALF_WIDTH_MM, _CLAMP_HEIGHT_MM = 12.0, 40.0


class VirtualCamera:
    """Looks at the virtual beam; each frame takes a tenth of a simulated second."""

    def __init__(
        self,
        beam: VirtualBeam,
        coil: CoilSupply,
        clock: Clock,
        frame: BeamFrame,
        mT_per_A: float,
        virtual: Virtual,
        depth_mm: float,
    ) -> None:
        self._perspective = frame.perspective(depth_mm, virtual.frame_size_px)
        self._beam, self._coil, self._clock, self._frame = beam, coil, clock, frame
        self._mT_per_A, self._virtual = mT_per_A, virtual
        self._rng = np.random.default_rng(virtual.seed)
        self._number = 0
        self._scene: Scene | None = None
        half, high = _CLAMP_HALF_WIDTH_MM, _CLAMP_HEIGHT_MM
        self._clamp_px = frame.to_px(np.array([[-high, -half], [0.0, -half], [0.0, half], [-high, half]]))

    def identify(self) -> Identity:
        """The camera's name; its seed is in the rig file."""
        width, height = self._virtual.frame_size_px
        return Identity("virtual", f"eimi-lab simulated camera {width} x {height}", "in-process")

    def flush(self) -> None:
        """Nothing is ever buffered."""

    def grab(self, timeout_s: float) -> Frame:
        """Expose one frame of the beam in the coil's present field."""
        self._clock.sleep(_FRAME_PERIOD_S)
        field_mT = self._mT_per_A * self._coil.coil_current_A()
        if self._scene is None or self._beam.moves(field_mT):
            outline, magnet = self._beam.outlines_mm(field_mT)
            near, far = self._perspective.faces(outline) if self._perspective else (outline, None)
            self._scene = make_scene(
                self._virtual.optics,
                self._virtual.frame_size_px,
                self._frame.to_px(near),
                None if magnet is None else self._frame.to_px(magnet),
                self._clamp_px,
                far_px=None if far is None else self._frame.to_px(far),
            )
        self._number += 1
        return Frame(expose(self._scene, self._rng), self._number, self._clock.now())

    def close(self) -> None:
        """Nothing to release."""


def open_virtual_rig(rig: Rig, specimen: SpecimenFile) -> tuple[PowerSupply, VirtualCamera, Clock, dict[str, Any]]:
    """Supply, camera, clock and the truth, which only scoring may read.

    Raises InputError when the rig does not know the specimen's material.
    """
    virtual = rig.virtual
    if virtual is None:
        raise InputError(f"rig {rig.name!r}: has no [virtual] table, so there is nothing to simulate")
    material = _material(virtual, specimen)
    clock = SimulatedClock()
    coil = CoilSupply(
        clock,
        time_constant_s=virtual.coil_time_constant_s,
        current_noise_A=virtual.current_noise_A,
        seed=virtual.seed,
    )
    supply = KoradSupply(
        InProcessTransport(KoradDialect(coil), clock),
        Limits(rig.supply.limits.current_A, rig.supply.limits.voltage_V),
        clock,
    )
    frame = BeamFrame(rig.calibration)
    beam = VirtualBeam(specimen.mechanics(), material, virtual.mesh, frame.gravity_deg, frame.field_deg)
    camera = VirtualCamera(
        beam, coil, clock, frame, rig.calibration.coil_constant_mT_per_A, virtual, specimen.specimen.depth_mm
    )
    truth = {
        "model": material.model,
        "parameters": material.parameters,
        "mesh": list(virtual.mesh),
        "seed": virtual.seed,
        "optics": asdict(virtual.optics),
    }
    return supply, camera, clock, truth


def _material(virtual: Virtual, specimen: SpecimenFile) -> TrueMaterial:
    name, known = specimen.specimen.material, virtual.materials.silicone
    if name not in known:
        raise InputError(
            f"specimen {specimen.specimen.name!r}: material = {name!r} is none that the virtual rig knows: "
            f"{', '.join(known)}"
        )
    return known[name]

"""The virtual rig: an emulated supply and a simulated camera with the interfaces of the drivers, in simulated time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Any, Protocol

import numpy as np

import eimi_fitting.beam.specimen as mechanics
from eimi_drivers.cameras.settings import CameraSettings
from eimi_drivers.clock import SimulatedClock
from eimi_drivers.emulators.coil_line import RemoteCoil
from eimi_drivers.emulators.korad import KoradDialect
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.interfaces import Clock, Frame, Identity, InstrumentError, PowerSupply
from eimi_drivers.supplies.korad import KoradSupply
from eimi_drivers.supplies.transport import InProcessTransport
from eimi_fitting.beam.rest_modes import with_modes
from eimi_lab.config.calibration import Calibration
from eimi_lab.config.materials import TrueBench, TrueMaterial
from eimi_lab.config.rig import Rig, Virtual
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.process.errors import InputError
from eimi_lab.virtual.beam import VirtualBeam, VirtualLoads
from eimi_lab.virtual.moving_beam import MovingBeam
from eimi_lab.virtual.moving_outlines import MovingOutlines, Outlines
from eimi_lab.virtual.optics import Scene, expose, make_scene
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.field_at_beam import stated_background_T, stated_coil

_FRAME_RATE_HZ = 10.0
_SAME_SHAPE = 1e-6  # rad; smaller changes of the shape are invisible
_CLAMP_HALF_WIDTH_MM, _CLAMP_HEIGHT_MM = 12.0, 40.0


class Coil(Protocol):
    """The interface of an object that returns the current of the coil."""

    def coil_current_A(self) -> float:
        """Return the true current of the coil at this moment, A."""


class VirtualCamera:
    """A camera that sees the virtual beam.

    The beam moves if the camera has a frame rate or the material relaxes. Otherwise, it is always in equilibrium.

    Parameters
    ----------
    beam
        The virtual beam.
    coil
        The coil around the beam.
    clock
        The clock of the rig.
    frame
        Conversion between the pixels of the picture and mm in the beam frame (x along the straight beam, y across).
    mT_per_A
        Coil constant: the field at the magnet for each ampere, mT/A.
    virtual
        The table [virtual] of the rig file: the parameters of the simulation.
    background_mT
        Field along the axis of the coil without a current, mT.
    frame_rate_Hz
        Frames per second that are stored in a buffer; None to expose when a frame is requested.
    specimen
        The true specimen; None for a beam that is always at rest.
    strongest_mT
        Largest magnitude of the coil's field, mT.
    """

    def __init__(
        self,
        beam: VirtualBeam,
        coil: Coil,
        clock: Clock,
        frame: BeamFrame,
        mT_per_A: float,
        virtual: Virtual,
        background_mT: float,
        frame_rate_Hz: float | None,
        specimen: mechanics.Specimen | None,
        strongest_mT: float,
    ) -> None:
        self._beam, self._coil, self._clock, self._frame = beam, coil, clock, frame
        self._mT_per_A, self._virtual, self._background_mT = mT_per_A, virtual, background_mT
        self.settings = CameraSettings(frame_rate_Hz=frame_rate_Hz)
        self._period_s = 1.0 / (frame_rate_Hz or _FRAME_RATE_HZ)
        self._runs_freely = frame_rate_Hz is not None
        self._specimen, self._strongest_mT = specimen, strongest_mT
        self._is_moving = specimen is not None and (self._runs_freely or beam.relaxes)
        self._motion: tuple[MovingBeam, MovingOutlines] | None = None
        self._coordinates = np.zeros(0)
        self._rng = np.random.default_rng(virtual.seed)
        self._number = 0
        self._leads_swapped = False
        self._exposed_s = clock.now()
        self._scene: Scene | None = None
        self._last = clock.now(), 0.0
        half, high = _CLAMP_HALF_WIDTH_MM, _CLAMP_HEIGHT_MM
        self._clamp_px = frame.to_px(np.array([[-high, -half], [0.0, -half], [0.0, half], [-high, half]]))

    def swap_leads(self) -> None:
        """Swap the leads of the coil, as a relay would. The same current then causes the opposite field."""
        self._leads_swapped = not self._leads_swapped

    def field_mT(self) -> float:
        """Return the present true field (coil and background) at the magnet along the axis of the coil, mT."""
        current_A = self._coil.coil_current_A()
        return self._background_mT + self._mT_per_A * (-current_A if self._leads_swapped else current_A)

    def identify(self) -> Identity:
        """Return the identity of the virtual camera."""
        width, height = self._virtual.frame_size_px
        return Identity("virtual", f"eimi-lab simulated camera {width} x {height}", "in-process")

    def flush(self) -> None:
        """Discard the frames that wait in the buffer."""
        if self._runs_freely:
            missed = max(0, int((self._clock.now() - self._exposed_s) / self._period_s))
            self._number += missed
            self._exposed_s += missed * self._period_s

    def grab(self, timeout_s: float) -> Frame:
        """Return the next frame of the beam in the field of the coil. `timeout_s` has no effect.

        Raises InstrumentError if the beam has no equilibrium, or if the process that emulates the coil does not answer.
        """
        self._clock.sleep(max(0.0, self._exposed_s + self._period_s - self._clock.now()))
        self._exposed_s = self._exposed_s + self._period_s if self._runs_freely else self._clock.now()
        try:
            outlines = self._moved() if self._is_moving else self._still()
        except ArithmeticError as error:
            raise InstrumentError(f"virtual camera: {error}") from error
        if outlines:
            outline, magnet = outlines
            self._scene = make_scene(
                self._virtual.optics,
                self._virtual.frame_size_px,
                self._frame.to_px(outline),
                None if magnet is None else self._frame.to_px(magnet),
                self._clamp_px,
            )
        assert self._scene is not None
        self._number += 1
        return Frame(expose(self._scene, self._rng), self._number, self._exposed_s)

    def _current_A(self, time_s: float) -> float:
        """Return the current of the coil at the time of an exposure, A.

        For a coil in another process, the result is the present current.
        """
        if isinstance(self._coil, CoilSupply):
            return self._coil.coil_current_at_A(time_s)
        return self._coil.coil_current_A()

    def _field_at_mT(self, time_s: float) -> float:
        current_A = self._current_A(time_s)
        return self._mT_per_A * (-current_A if self._leads_swapped else current_A)

    def _still(self) -> Outlines | None:
        """Return the outlines of the beam at rest in the present field; None if the beam looks as in the last frame."""
        field_mT = self._field_at_mT(self._exposed_s)
        return self._beam.outlines_mm(field_mT) if self._scene is None or self._beam.moves(field_mT) else None

    def _moved(self) -> Outlines | None:
        """Return the outlines of the moving beam at the exposure; None if the beam looks as in the last frame."""
        now_mT = self._field_at_mT(self._exposed_s)
        if self._motion is None:
            assert self._specimen is not None
            moving = self._beam.moving()
            moving.start(self._exposed_s, now_mT)
            shapes = MovingOutlines(self._beam.outlines_mm, moving, self._specimen, self._strongest_mT)
            self._motion, self._last = (moving, shapes), (self._exposed_s, now_mT)
        (last_s, last_mT), (moving, shapes) = self._last, self._motion

        def between(time_s: float) -> float:
            if isinstance(self._coil, CoilSupply):
                return self._field_at_mT(time_s)
            return float(np.interp(time_s, [last_s, self._exposed_s], [last_mT, now_mT]))

        (coordinates,) = moving.advance(self._exposed_s, between)
        self._last = self._exposed_s, now_mT
        if self._scene is not None and np.abs(coordinates - self._coordinates).max() < _SAME_SHAPE:
            return None
        self._coordinates = coordinates
        return shapes.at(coordinates)

    def close(self) -> None:
        """Close the connection to an emulated coil in another process, if there is one."""
        if isinstance(self._coil, RemoteCoil):
            self._coil.close()


def open_virtual_rig(rig: Rig, specimen: SpecimenFile) -> tuple[PowerSupply, VirtualCamera, Clock, dict[str, Any]]:
    """Create the instruments of the virtual rig with a specimen.

    Returns
    -------
    supply, camera, clock
        The drivers of supply and camera, and the simulated clock.
    truth
        The true material and the settings of the simulation, by name.

    Raises
    ------
    InputError
        If the rig has no table [virtual] (the parameters of a simulation), if the table does not define the material of
        the specimen, or if the calibration places the lens inside the specimen.
    """
    virtual = _virtual(rig)
    _material(virtual, specimen)
    supply, coil, clock = _virtual_coil(rig, virtual)
    # only the comparison of a result with the truth may use the last value
    return supply, virtual_camera(rig, specimen, coil, clock), clock, truth_of(rig, specimen)


def open_virtual_coil(rig: Rig) -> tuple[PowerSupply, Callable[[], float], Clock]:
    """Create the supply of the virtual rig without a camera.

    Returns
    -------
    supply
        The driver of the supply.
    field_mT
        Function that returns the true field along the axis of the coil, mT.
    clock
        The simulated clock.

    Raises
    ------
    InputError
        If the rig has no table [virtual] (the parameters of a simulation).
    """
    supply, coil, clock = _virtual_coil(rig, _virtual(rig))
    return supply, true_field_mT(rig, coil), clock


def true_field_mT(rig: Rig, coil: Coil) -> Callable[[], float]:
    """Return a function that returns the present true field (coil and background) along the axis of the coil, mT."""
    bench = _virtual(rig).materials.bench or TrueBench()
    mT_per_A = bench.coil_constant_mT_per_A or rig.calibration.mT_per_A
    offset_mT = _along_axis_mT(rig.calibration, bench)
    return lambda: offset_mT + mT_per_A * coil.coil_current_A()


def _virtual_coil(rig: Rig, virtual: Virtual) -> tuple[PowerSupply, CoilSupply, SimulatedClock]:
    clock = SimulatedClock()
    coil = CoilSupply(
        clock,
        time_constant_s=virtual.coil_time_constant_s,
        current_noise_A=virtual.current_noise_A,
        seed=virtual.seed,
    )
    supply = KoradSupply(
        InProcessTransport(KoradDialect(coil), clock),
        rig.supply.opened_with,
        clock,
    )
    return supply, coil, clock


def _along_axis_mT(calibration: Calibration, bench: TrueBench) -> float:
    """Return the true background field along the axis of the coil, mT."""
    true_calibration = calibration.model_copy(update=_hidden(bench))
    axis_rad = np.radians(BeamFrame(true_calibration).field_deg)
    return 1e3 * float(stated_background_T(true_calibration) @ [np.cos(axis_rad), np.sin(axis_rad)])


def virtual_camera(rig: Rig, specimen: SpecimenFile, coil: Coil, clock: Clock) -> VirtualCamera:
    """Create a simulated camera that sees a specimen in a coil.

    Raises InputError if the rig file has no table [virtual] (the parameters of the simulation), if the table does not
    define the material of the specimen, or if the calibration places the lens inside the specimen.
    """
    virtual, frame = _virtual(rig), BeamFrame(rig.calibration)
    material = _material(virtual, specimen)
    try:
        view = frame.view(specimen.specimen.depth_mm, virtual.frame_size_px)
    except ValueError as error:
        raise InputError(f"rig {rig.name!r}: calibration: {error}") from error
    gravity_deg = frame.gravity_deg if rig.calibration.gravity else None
    bench = virtual.materials.bench or TrueBench()
    mT_per_A = bench.coil_constant_mT_per_A or rig.calibration.mT_per_A
    strongest_mT = abs(mT_per_A) * rig.supply.limits.current_A
    true_beam, true_field = _true_values(specimen, rig.calibration, bench)
    x_T, y_T = stated_background_T(true_field).tolist()
    loads = VirtualLoads(gravity_deg, frame.field_deg, (x_T, y_T), stated_coil(true_field, true_beam))
    beam = VirtualBeam(true_beam, material, virtual.mesh, loads, strongest_mT, view)
    offset_mT = _along_axis_mT(rig.calibration, bench)
    rate_Hz = rig.camera.frame_rate_Hz
    return VirtualCamera(beam, coil, clock, frame, mT_per_A, virtual, offset_mT, rate_Hz, true_beam, strongest_mT)


def truth_of(rig: Rig, specimen: SpecimenFile) -> dict[str, Any]:
    """Return the true material of the virtual beam, and the mesh, the seed and the optics of the simulation, by name.

    Raises InputError if the rig file has no table [virtual] (the parameters of the simulation), or if the table does
    not define the material of the specimen.
    """
    virtual = _virtual(rig)
    material = _material(virtual, specimen)
    return {
        "model": material.model,
        "parameters": material.parameters,
        **({"prony_h": material.prony_h, "prony_tau_s": material.prony_tau_s} if material.prony_h else {}),
        "mesh": list(virtual.mesh),
        "seed": virtual.seed,
        "optics": asdict(virtual.optics),
        **({"bench": bench.model_dump(exclude_unset=True)} if (bench := virtual.materials.bench) else {}),
    }


def _true_values(
    specimen: SpecimenFile, calibration: Calibration, bench: TrueBench
) -> tuple[mechanics.Specimen, Calibration]:
    """Return the true specimen and calibration of the frames: the values of the files plus hidden errors."""
    # a fit reads the files; `bench` holds what it does not know, such as an error of the direction of the magnet
    beam = specimen.mechanics()
    if beam.magnet:
        turned_deg = beam.magnet.magnetisation_angle_deg + bench.magnetisation_angle_deg
        beam = replace(beam, magnet=replace(beam.magnet, magnetisation_angle_deg=turned_deg))
    beam = with_modes(beam, (bench.cast_bend_mm,), (0.5 * bench.taper_mm,))
    return beam, calibration.model_copy(update=_hidden(bench))


def _hidden(bench: TrueBench) -> dict[str, Any]:
    return {key: value for key in ("background_field_mT", "field") if (value := getattr(bench, key)) is not None}


def _virtual(rig: Rig) -> Virtual:
    if rig.virtual is None:
        raise InputError(f"rig {rig.name!r}: has no [virtual] table, which the simulation needs")
    return rig.virtual


def _material(virtual: Virtual, specimen: SpecimenFile) -> TrueMaterial:
    name, materials = specimen.specimen.material, virtual.materials.silicone
    if name not in materials:
        raise InputError(
            f"specimen {specimen.specimen.name!r}: material = {name!r} is not defined in the virtual rig; defined are "
            f"{', '.join(materials)}"
        )
    return materials[name]

"""rig.toml: the supply, the camera and the coil of a bench, with their addresses and the camera's calibration."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

from pydantic import ConfigDict, Field, field_validator, model_validator

from eimi_drivers.cameras.camera_names import CAMERAS
from eimi_drivers.cameras.settings import CameraSettings
from eimi_drivers.emulators.coil_line import ADDRESS
from eimi_drivers.installed import did_you_mean
from eimi_drivers.interfaces import Limits
from eimi_drivers.supplies.supply_names import SUPPLIES
from eimi_drivers.supplies.transport import check_address
from eimi_lab.config.calibration import Calibration, load_calibration
from eimi_lab.config.interlock import READINGS, Interlock, check_readings
from eimi_lab.config.materials import TrueMaterials, load_materials
from eimi_lab.config.protocol import SupplyLimits
from eimi_lab.config.sensor import RigSensor, check_sensors
from eimi_lab.config.simulated_optics import Optics
from eimi_lab.config.toml import Document, Table, check, locate, parse_table, read_text
from eimi_lab.config.uncertainty import OfRig
from eimi_lab.process.errors import InputError
from eimi_lab.process.paths import named_in

VIRTUAL = "virtual"
PLAYER = "opencv"
"""The driver that plays recordings."""


def _one_of(driver: str, drivers: list[str]) -> str:
    if driver not in drivers:
        raise ValueError(f"is not a driver; there are {', '.join(drivers)}{did_you_mean(driver, drivers)}")
    return driver


class Supply(Table):
    """The coil's power supply."""

    driver: str
    """Name of the driver; `eimi instruments` lists what is connected."""
    address: str = Field(min_length=1)
    """A serial port or a VISA resource, as the driver requires; a channel number follows after #."""
    limits: SupplyLimits
    """Limits that the coil tolerates; the protocol also has limits, and the stricter ones apply."""
    off_below_A: float | None = Field(default=None, gt=0)
    """Measured current below which the coil counts as off. The default is 20 mA, or more if a healthy unit of the
    family shows more at zero."""

    @field_validator("driver")
    @classmethod
    def _exists(cls, driver: str) -> str:
        return _one_of(driver, [*SUPPLIES, VIRTUAL])

    @property
    def opened_with(self) -> Limits:
        """The current limit, the voltage limit and the off limit with which the driver is opened."""
        return Limits(self.limits.current_A, self.limits.voltage_V, self.off_below_A)

    @field_validator("address")
    @classmethod
    def _opens_no_file(cls, address: str) -> str:
        check_address(address)
        return address


class CoilRating(Table):
    """Thermal rating of the coil, see `eimi_lab.acquisition.heating`."""

    continuous_current_A: float = Field(gt=0)
    """Current that the coil tolerates without limit of time."""
    thermal_time_constant_s: float = Field(gt=0)
    """Time in which 63 % of the temperature change after a change of current takes place."""


class Playback(Table):
    """How a recording replaces the camera."""

    picture_a_state: bool = False
    """true: all frames of a state show the same picture. false: every frame shows the next picture."""
    loop: bool = False
    """Whether the recording starts again after its last picture."""


NO_PLAYBACK = Playback()


class Camera(Table):
    """The side camera. If a setting is absent, the camera keeps its present value."""

    driver: str
    """opencv, basler, aravis, gentl, virtual, or the name of a driver from another package."""
    source: int | str
    """The number of a device, a path, a serial number, the IP address of a GigE camera, or the address of an emulated
    coil."""
    exposure_s: float | None = Field(default=None, gt=0)
    """Exposure time. A setting is written to the camera and read back; an absent one is left unchanged."""
    gain: float | None = None
    """Gain: in dB for Basler and GenICam cameras, in the device's own unit through OpenCV."""
    gamma: float | None = Field(default=None, gt=0)
    """Gamma: the exponent for Basler and GenICam cameras, in the device's own unit through OpenCV."""
    region: Annotated[tuple[int, int, int, int], Field(strict=False)] | None = None
    """Left, top, width and height in pixels; pixels of the calibration count from its upper left corner."""
    bit_depth: int | None = Field(default=None, ge=8, le=16)
    """Bits per pixel, 8 to 16."""
    frame_rate_Hz: float | None = Field(default=None, gt=0)
    """Frames per second of a camera that runs freely; needed to record the swing of a beam at a constant rate. If it is
    absent, the driver chooses when the camera exposes."""
    pixel_format: str | None = None
    """Pixel format of a GenICam camera by its name there, such as "Mono12Packed" or "BayerRG8"."""
    trigger: str | None = None
    """For a GenICam camera: "software", which is the default without a frame rate, or an input such as "Line1"."""
    playback: Playback = NO_PLAYBACK
    """How a folder of pictures or a video replaces the camera."""

    @field_validator("driver")
    @classmethod
    def _exists(cls, driver: str) -> str:
        return _one_of(driver, [*CAMERAS, VIRTUAL])

    @field_validator("region")
    @classmethod
    def _inside(cls, region: tuple[int, int, int, int] | None) -> tuple[int, int, int, int] | None:
        if region is not None and (min(region[:2]) < 0 or min(region[2:]) < 1):
            raise ValueError("should be left, top, width and height in pixels")
        return region

    @model_validator(mode="after")
    def _no_settings_of_a_virtual_camera(self) -> Camera:
        fixed = [name for name in self.settings.chosen() if name != "frame_rate_Hz"]
        if self.driver == VIRTUAL and (names := ", ".join(fixed)):
            raise ValueError(f"has no {names} to set with driver = 'virtual'; [virtual] describes that camera")
        return self

    @model_validator(mode="after")
    def _one_pace(self) -> Camera:
        if self.trigger is not None and self.frame_rate_Hz is not None:
            raise ValueError(
                f"trigger = {self.trigger!r} and frame_rate_Hz = {self.frame_rate_Hz:g} exclude each other: leave one "
                "of them out"
            )
        return self

    @model_validator(mode="after")
    def _playback_of_a_recording(self) -> Camera:
        if self.playback != NO_PLAYBACK and (self.driver != PLAYER or str(self.source).isdecimal()):
            raise ValueError(f"playback is for recordings, with driver = {PLAYER!r} and a folder or a file as source")
        return self

    def at_rate(self, rate_Hz: float | None) -> Camera:
        """Return the camera with this frame rate, unless it has a frame rate or a trigger, or plays a recording."""
        plays = self.driver == PLAYER and not str(self.source).isdecimal()
        if rate_Hz is None or self.frame_rate_Hz is not None or self.trigger is not None or plays:
            return self
        return self.model_copy(update={"frame_rate_Hz": rate_Hz})

    @property
    def settings(self) -> CameraSettings:
        """The settings to write to the camera before the first frame."""
        return CameraSettings(
            exposure_s=self.exposure_s,
            gain=self.gain,
            gamma=self.gamma,
            region=self.region,
            bit_depth=self.bit_depth,
            frame_rate_Hz=self.frame_rate_Hz,
            pixel_format=self.pixel_format,
            trigger=self.trigger,
        )


class Virtual(Table):
    """The virtual rig: a simulated coil, beam and camera behind the driver interfaces."""

    model_config = ConfigDict(strict=False)  # pydantic cannot create a dataclass from a table in strict mode

    seed: int = Field(ge=0)
    """Seed of all random numbers."""
    coil_time_constant_s: float = Field(gt=0)
    """Time constant with which the coil's current follows its set-point."""
    current_noise_A: float = Field(ge=0)
    """Standard deviation of the measured current."""
    frame_size_px: tuple[int, int]
    """Width and height of the frames."""
    mesh: tuple[int, int, int]
    """Number of elements along and across the beam, and the refinement factor in depth."""
    optics: Optics = Optics()
    """Back-light, lens and sensor."""
    materials: TrueMaterials
    """Name of the file beside the rig with the true materials of virtual specimens; no fit reads it."""

    @model_validator(mode="after")
    def _positive(self) -> Virtual:
        for name in ("frame_size_px", "mesh"):
            if min(getattr(self, name)) < 1:
                raise ValueError(f"{name} = {list(getattr(self, name))} must be positive numbers")
        return self


class Rig(Document):
    """The contents of rig.toml.

    In the file, ``calibration`` and ``virtual.materials`` are names of files beside it. The true materials are in a
    separate file because a dataset stores the rig's text, which must not reveal them.
    """

    name: str = Field(min_length=1)
    """Name of the bench; datasets with the same name share the error of its current."""
    supply: Supply
    """The coil's power supply."""
    camera: Camera
    """The side camera."""
    calibration: Calibration
    """Name of the calibration file beside this one."""
    coil: CoilRating | None = None
    """Thermal rating of the coil; a protocol that would overheat it is refused."""
    virtual: Virtual | None = None
    """The virtual rig; required with the virtual camera and allowed only there."""
    sensors: Annotated[tuple[RigSensor, ...], Field(strict=False)] = ()
    """Gaussmeters, thermometers and other sensors, each in a table [[sensors]]."""
    interlocks: Annotated[tuple[Interlock, ...], Field(strict=False)] = ()
    """Bounds of readings, each in a table [[interlocks]]; the coil is switched off if a reading leaves them."""
    uncertainty: OfRig | None = None
    """Standard uncertainty of the current's zero. 0 means exact, an absent key means unknown."""

    @model_validator(mode="after")
    def _consistently_virtual(self) -> Rig:
        virtual_camera = self.camera.driver == VIRTUAL
        if self.simulated and not virtual_camera:
            raise ValueError(
                f"camera.driver = {self.camera.driver!r} cannot see the simulated coil of supply.driver = 'virtual'; "
                "it must be 'virtual' too; or use an emulated supply, which `eimi emulate` serves"
            )
        if virtual_camera and not self.simulated and not ADDRESS.fullmatch(str(self.camera.source)):
            raise ValueError(
                f"camera.source = {self.camera.source!r} must be the address of an emulated coil, "
                "TCPIP::HOST::PORT::SOCKET as `eimi emulate` prints it, for a virtual beam beside "
                f"supply.driver = {self.supply.driver!r}"
            )
        if virtual_camera != (self.virtual is not None):
            raise ValueError("the table [virtual] belongs with camera.driver = 'virtual', and only there")
        return self

    @model_validator(mode="after")
    def _calibrated_coil(self) -> Rig:
        if self.calibration.coil_constant_mT_per_A is None:
            raise ValueError("the calibration of a rig needs coil_constant_mT_per_A and field_angle_deg of its coil")
        return self

    @model_validator(mode="after")
    def _interlocks_on_readings_of_this_bench(self) -> Rig:
        check_sensors(self.sensors, self.simulated)
        check_readings(self.interlocks, (*READINGS, *(sensor.name for sensor in self.sensors)))
        return self

    @property
    def simulated(self) -> bool:
        """Whether both the supply and the camera are virtual, so that time is simulated."""
        return self.supply.driver == VIRTUAL


def load_rig(name: str | Path) -> Rig:
    """Read a rig with its calibration from a path, or a shipped rig by its name ("virtual").

    Raises
    ------
    InputError
        If the rig, its calibration or its materials cannot be read or are not valid.
    """
    file = locate(name, "rigs")
    text = read_text(file)
    table = parse_table(text, file)
    _replace_by_file(table, "calibration", file, load_calibration)
    if isinstance(table.get("virtual"), dict):
        _replace_by_file(table["virtual"], "materials", file, load_materials)
    return check(Rig, table, text, file)


def _replace_by_file(table: dict[str, Any], key: str, rig: Path, load: Callable[[Path], Document]) -> None:
    """Replace the name of a file beside the rig by the file's contents."""
    name = table.get(key)
    if isinstance(name, str):
        path = named_in(rig, name)
        if not path.is_file():
            raise InputError(f"{rig}: {key} = {name!r}: no such file beside the rig")
        table[key] = load(path)
    elif name is not None:
        raise InputError(f"{rig}: {key} should be the name of a file beside the rig")

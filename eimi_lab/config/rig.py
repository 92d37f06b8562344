"""Read rig.toml: the supply, the camera and the coil of a bench, with their addresses and limits."""

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
from eimi_drivers.supplies.address import check_address
from eimi_drivers.supplies.supply_names import SUPPLIES, current_step_A
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
_VIRTUAL_SUPPLY = "korad"  # driver of the simulated supply
PLAYER = "opencv"
"""Name of the driver that plays a folder of pictures or a video instead of a camera."""


def _one_of(driver: str, drivers: list[str]) -> str:
    if driver not in drivers:
        raise ValueError(f"is not a driver; the drivers are {', '.join(drivers)}{did_you_mean(driver, drivers)}")
    return driver


class Supply(Table):
    """The power supply of the coil."""

    driver: str
    """Name of the driver; `eimi instruments` lists the connected instruments with their drivers."""
    address: str = Field(min_length=1)
    """A serial port or a VISA resource, as the driver requires. A channel number is written after #."""
    limits: SupplyLimits
    """Largest current and voltage that the coil tolerates. The protocol also has limits; the smaller value applies."""
    off_below_A: float | None = Field(default=None, gt=0)
    """Measured current below which the coil counts as off. The default is 20 mA. The default is larger for supplies
    whose measured current is normally larger although no current flows.
    """

    @field_validator("driver")
    @classmethod
    def _exists(cls, driver: str) -> str:
        return _one_of(driver, [*SUPPLIES, VIRTUAL])

    @property
    def opened_with(self) -> Limits:
        """The limits for the driver: largest current, largest voltage, and the current below which the coil is off."""
        return Limits(self.limits.current_A, self.limits.voltage_V, self.off_below_A)

    @field_validator("address")
    @classmethod
    def _opens_no_file(cls, address: str) -> str:
        check_address(address)
        return address


class CoilRating(Table):
    """The thermal rating of the coil, from which the temperature of the coil in a run is predicted."""

    continuous_current_A: float = Field(gt=0)
    """Largest current that the coil tolerates for an unlimited time."""
    thermal_time_constant_s: float = Field(gt=0)
    """Time after a change of the current in which 63 % of the change of temperature takes place."""


class Playback(Table):
    """How a folder of pictures or a video replaces the camera."""

    picture_a_state: bool = False
    """true: all frames of a state show the same picture. false: every frame shows the next picture."""
    loop: bool = False
    """Whether the first picture follows after the last picture."""


NO_PLAYBACK = Playback()


class Camera(Table):
    """The table [camera] of a rig file."""

    driver: str
    """opencv, basler, aravis, gentl, virtual, or the name of a driver from another package."""
    source: int | str
    """The camera: the number of a device, a path, a serial number, or the IP address of a GigE camera. For the virtual
    camera with a supply of `eimi emulate`: the address that `eimi emulate` prints.
    """
    exposure_s: float | None = Field(default=None, gt=0)
    """Exposure time. This and all other settings are written to the camera and read back. If a setting is absent, the
    camera keeps its present value.
    """
    gain: float | None = None
    """Gain: in dB for Basler and GenICam cameras; in a unit of the device for OpenCV."""
    gamma: float | None = Field(default=None, gt=0)
    """Gamma: the exponent for Basler and GenICam cameras; in a unit of the device for OpenCV."""
    region: Annotated[tuple[int, int, int, int], Field(strict=False)] | None = None
    """Region of the sensor that is read: left, top, width and height in pixels. Pixels in the calibration are counted
    from the upper left corner of this region.
    """
    bit_depth: int | None = Field(default=None, ge=8, le=16)
    """Bits per pixel, 8 to 16."""
    frame_rate_Hz: float | None = Field(default=None, gt=0)
    """Frames per second, for a camera without trigger. A ring-down at a constant rate needs this key, or
    ring_down.rate_Hz in the protocol. By default, the driver decides when the camera exposes.
    """
    pixel_format: str | None = None
    """Pixel format of a GenICam camera, such as "Mono12Packed" or "BayerRG8"."""
    trigger: str | None = None
    """Trigger of a GenICam camera: "software", or an input such as "Line1". Without frame_rate_Hz the default is
    "software".
    """
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
            raise ValueError("should be left and top (0 or more), width and height (1 or more) in pixels")
        return region

    @model_validator(mode="after")
    def _no_settings_of_a_virtual_camera(self) -> Camera:
        fixed = [name for name in self.settings.chosen() if name != "frame_rate_Hz"]
        if self.driver == VIRTUAL and (names := ", ".join(fixed)):
            raise ValueError(
                f"should not have {names} with driver = 'virtual'; the table [virtual] describes the virtual camera"
            )
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
            raise ValueError(
                f"playback is only for driver = {PLAYER!r} with a folder of pictures or a video as source; leave it out"
            )
        return self

    def at_rate(self, rate_Hz: float | None) -> Camera:
        """Return the table [camera] with the frame rate ``rate_Hz``.

        The table stays unchanged for None, for a camera with a rate or a trigger, and for frames read from files.
        """
        plays = self.driver == PLAYER and not str(self.source).isdecimal()
        if rate_Hz is None or self.frame_rate_Hz is not None or self.trigger is not None or plays:
            return self
        return self.model_copy(update={"frame_rate_Hz": rate_Hz})

    @property
    def settings(self) -> CameraSettings:
        """The settings that are written to the camera before the first frame."""
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
    """The virtual rig: a simulated coil, beam and camera."""

    model_config = ConfigDict(strict=False)  # pydantic cannot create a dataclass from a table in strict mode

    seed: int = Field(ge=0)
    """Seed of the random number generator."""
    coil_time_constant_s: float = Field(gt=0)
    """Time constant with which the current of the coil follows its set-point."""
    current_noise_A: float = Field(ge=0)
    """Standard deviation of the noise of the measured current."""
    frame_size_px: tuple[int, int]
    """Width and height of the frames."""
    mesh: tuple[int, int, int]
    """Number of elements along the beam and across it, and number of elements in each part of the depth in addition to
    the usual number.
    """
    optics: Optics = Optics()
    """Back-light, lens and sensor of the virtual camera."""
    materials: TrueMaterials
    """Name of the file, in the folder of the rig, with the true materials of virtual specimens; no fit reads it."""

    @model_validator(mode="after")
    def _positive(self) -> Virtual:
        for name in ("frame_size_px", "mesh"):
            if min(getattr(self, name)) < 1:
                raise ValueError(f"{name} = {list(getattr(self, name))} should be numbers above 0")
        return self


# A dataset contains the text of the rig file and must not reveal the materials, which are therefore in a separate file.
class Rig(Document):
    """The contents of rig.toml: the supply, the camera, the coil and the sensors of a bench."""

    name: str = Field(min_length=1)
    """Name of the bench. The error of the current is assumed to be the same in all datasets with this name."""
    supply: Supply
    """The power supply of the coil."""
    camera: Camera
    """The camera that takes the pictures of the beam."""
    calibration: Calibration
    """Name of the calibration file, which is in the same folder."""
    coil: CoilRating | None = None
    """Thermal rating of the coil. A run that could overheat the coil is refused."""
    virtual: Virtual | None = None
    """The virtual rig. This table is required with the virtual camera, and not allowed with another camera."""
    sensors: Annotated[tuple[RigSensor, ...], Field(strict=False)] = ()
    """Gaussmeters, thermometers and other sensors, each in a table [[sensors]]."""
    interlocks: Annotated[tuple[Interlock, ...], Field(strict=False)] = ()
    """Bounds of readings, each in a table [[interlocks]]. The coil is switched off if a reading is outside its
    bounds.
    """
    uncertainty: OfRig | None = None
    """Standard uncertainty of the zero of the current. 0 means exact; an absent key means unknown."""

    @model_validator(mode="after")
    def _consistently_virtual(self) -> Rig:
        virtual_camera = self.camera.driver == VIRTUAL
        if self.simulated and not virtual_camera:
            raise ValueError(
                f"camera.driver = {self.camera.driver!r} does not suit supply.driver = 'virtual', because a real "
                "camera cannot see a simulated beam; use camera.driver = 'virtual', or an emulated supply of "
                "`eimi emulate`"
            )
        if virtual_camera and not self.simulated and not ADDRESS.fullmatch(str(self.camera.source)):
            raise ValueError(
                f"camera.source = {self.camera.source!r} should be the address that `eimi emulate` prints, such as "
                "TCPIP::127.0.0.1::5555::SOCKET; the virtual camera then films a beam in the coil of the emulated "
                "supply; without `eimi emulate`, use supply.driver = 'virtual'"
            )
        if virtual_camera != (self.virtual is not None):
            raise ValueError(
                "the table [virtual] is required with camera.driver = 'virtual', and not allowed with another camera"
            )
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
        """Whether the supply is simulated inside this program."""
        return self.supply.driver == VIRTUAL

    @property
    def current_step_A(self) -> str | None:
        """The step in which the supply sets its current, A; None if its driver does not state a step."""
        return current_step_A(_VIRTUAL_SUPPLY if self.simulated else self.supply.driver)


def load_rig(name: str | Path) -> Rig:
    """Read a rig with its calibration from a path, or a shipped rig by its name ("virtual").

    Raises
    ------
    InputError
        If the rig file, the calibration file or the materials file cannot be read or is not valid.
    """
    file = locate(name, "rigs")
    text = read_text(file)
    table = parse_table(text, file)
    _replace_by_file(table, "calibration", file, load_calibration)
    if isinstance(table.get("virtual"), dict):
        _replace_by_file(table["virtual"], "materials", file, load_materials)
    return check(Rig, table, text, file)


def _replace_by_file(table: dict[str, Any], key: str, rig: Path, load: Callable[[Path], Document]) -> None:
    """Replace the name of a file in ``table[key]`` by the contents of the file.

    ``rig`` is the path of the rig file, in whose folder the file is.
    """
    name = table.get(key)
    if isinstance(name, str):
        path = named_in(rig, name)
        if not path.is_file():
            raise InputError(f"{rig}: {key} = {name!r}: there is no such file in the folder of the rig")
        table[key] = load(path)
    elif name is not None:
        raise InputError(f"{rig}: {key} should be the name of a file in the folder of the rig")

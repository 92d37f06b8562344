"""rig.toml: which supply and which camera, where they are, and how the camera sees the beam."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

from pydantic import ConfigDict, Field, field_validator, model_validator

from eimi_drivers.cameras.camera_names import CAMERAS
from eimi_drivers.cameras.settings import CameraSettings
from eimi_drivers.emulators.coil_line import ADDRESS
from eimi_drivers.installed import did_you_mean
from eimi_drivers.supplies.supply_names import SUPPLIES
from eimi_lab.config.calibration import Calibration, load_calibration
from eimi_lab.config.materials import TrueMaterials, load_materials
from eimi_lab.config.protocol import SupplyLimits
from eimi_lab.config.simulated_optics import Optics
from eimi_lab.config.toml import Document, Table, check, locate, parse_table, read_text
from eimi_lab.config.uncertainty import OfRig
from eimi_lab.process.errors import InputError

VIRTUAL = "virtual"
PLAYER = "opencv"
"""The driver that plays recordings."""


def _one_of(driver: str, known: list[str]) -> str:
    if driver not in known:
        raise ValueError(f"is not a driver; there are {', '.join(known)}{did_you_mean(driver, known)}")
    return driver


class Supply(Table):
    """The coil's power supply; an address is a serial port or a VISA resource, whichever the driver takes."""

    driver: str
    """Which driver serves it; `eimi instruments` lists what is connected."""
    address: str = Field(min_length=1)
    """A serial port or a VISA resource, as the driver takes it; a channel follows after #."""
    limits: SupplyLimits
    """What the coil bears; the protocol has limits too, the stricter of the two holds."""

    @field_validator("driver")
    @classmethod
    def _exists(cls, driver: str) -> str:
        return _one_of(driver, [*SUPPLIES, VIRTUAL])


class CoilRating(Table):
    """What the coil bears: a current for ever, and how slowly it warms up and cools down.

    See `eimi_lab.acquisition.heating`.
    """

    continuous_current_A: float = Field(gt=0)
    """Borne for ever."""
    thermal_time_constant_s: float = Field(gt=0)
    """After so long at another current 63 % of the change in temperature is done."""


class Playback(Table):
    """How a recording plays the camera.

    picture_a_state: the first picture is held until the second state begins, and so on; otherwise every frame that is
    asked for is the next picture. loop: begins again after the last.
    """

    picture_a_state: bool = False
    """Each picture is held for a whole state; else every frame is the next picture."""
    loop: bool = False
    """Begins again after the last."""


NO_PLAYBACK = Playback()


class Camera(Table):
    """The side camera; source is the number of a device, or a path, as the driver takes it.

    The settings are `CameraSettings`, by the same names and in the same units; one that is left out stays as the
    camera has it. With a region, pixels of the calibration count from its upper left corner.
    """

    driver: str
    """opencv, basler, virtual, or one of a package of your own."""
    source: int | str
    """The number of a device, a path, or where an emulated coil is."""
    exposure_s: float | None = Field(default=None, gt=0)
    """What is left out stays as the camera has it; what is set is read back."""
    gain: float | None = None
    """dB on Basler cameras, the device's own unit through OpenCV."""
    gamma: float | None = Field(default=None, gt=0)
    """The exponent on Basler cameras, the device's own unit through OpenCV."""
    region: Annotated[tuple[int, int, int, int], Field(strict=False)] | None = None
    """Left, top, width, height in pixels; the calibration then counts from its corner."""
    bit_depth: int | None = Field(default=None, ge=8, le=16)
    """Of a pixel, 8 to 16."""
    playback: Playback = NO_PLAYBACK
    """How a folder of pictures or a video plays the camera."""

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
    def _virtual_as_it_is(self) -> Camera:
        if self.driver == VIRTUAL and (names := ", ".join(self.settings.chosen())):
            raise ValueError(f"has no {names} to set with driver = 'virtual'; [virtual] says what that camera sees")
        return self

    @model_validator(mode="after")
    def _recorded(self) -> Camera:
        if self.playback != NO_PLAYBACK and (self.driver != PLAYER or str(self.source).isdecimal()):
            raise ValueError(f"playback is for recordings, with driver = {PLAYER!r} and a folder or a file as source")
        return self

    @property
    def settings(self) -> CameraSettings:
        """What to set on the camera before the first frame."""
        return CameraSettings(self.exposure_s, self.gain, self.gamma, self.region, self.bit_depth)


class Virtual(Table):
    """The virtual rig behind the driver interfaces: coil, beam and optics, all from one seed."""

    model_config = ConfigDict(strict=False)  # a dataclass cannot be filled from a table in strict mode

    seed: int = Field(ge=0)
    """Of all that is random."""
    coil_time_constant_s: float = Field(gt=0)
    """Of the coil's current."""
    current_noise_A: float = Field(ge=0)
    """Standard deviation of the read-back."""
    frame_size_px: tuple[int, int]
    """Width and height."""
    mesh: tuple[int, int, int]
    """Elements along and across, and times as many in depth."""
    optics: Optics = Optics()
    """Back-light, lens and sensor."""
    materials: TrueMaterials
    """Name of the file beside the rig that says what virtual specimens are made of; no fit reads it."""

    @model_validator(mode="after")
    def _positive(self) -> Virtual:
        for name in ("frame_size_px", "mesh"):
            if min(getattr(self, name)) < 1:
                raise ValueError(f"{name} = {list(getattr(self, name))} must be positive numbers")
        return self


class Rig(Document):
    """A whole rig.toml. In the file, `calibration` is the name of a file beside it, and so is `virtual.materials`:
    a dataset keeps the rig's text, and the hidden material must not be in it. uncertainty: of the supply's current_A.
    """

    name: str = Field(min_length=1)
    """What the bench is called: datasets of one name share the error of its current."""
    supply: Supply
    """The coil's power supply."""
    camera: Camera
    """The side camera."""
    calibration: Calibration
    """Name of the calibration file beside this one."""
    coil: CoilRating | None = None
    """What the coil bears: a protocol that would overheat it is refused."""
    virtual: Virtual | None = None
    """The virtual rig; belongs with the virtual camera."""
    uncertainty: OfRig | None = None
    """Standard uncertainty of the current's zero. 0 is exact, absent is not known."""

    @model_validator(mode="after")
    def _virtual_as_a_whole(self) -> Rig:
        seen = self.camera.driver == VIRTUAL
        if self.simulated and not seen:
            raise ValueError(
                f"camera.driver = {self.camera.driver!r} sees nothing of supply.driver = 'virtual', whose seconds are "
                "simulated; it must be 'virtual', too, or take an emulated supply, which `eimi emulate` serves"
            )
        if seen and not self.simulated and not ADDRESS.fullmatch(str(self.camera.source)):
            raise ValueError(
                f"camera.source = {self.camera.source!r} must be where an emulated coil is, TCPIP::HOST::PORT::SOCKET "
                f"as `eimi emulate` tells it, for a virtual beam beside supply.driver = {self.supply.driver!r}"
            )
        if seen != (self.virtual is not None):
            raise ValueError("the table [virtual] belongs with camera.driver = 'virtual', and only there")
        return self

    @property
    def simulated(self) -> bool:
        """Whether the supply is virtual as well as the camera, so that seconds are simulated."""
        return self.supply.driver == VIRTUAL


def load_rig(name: str | Path) -> Rig:
    """Read a rig, or a shipped one by its name ("virtual"), with its calibration. Raises InputError."""
    file = locate(name, "rigs")
    text = read_text(file)
    table = parse_table(text, file)
    _replace_by_file(table, "calibration", file, load_calibration)
    if isinstance(table.get("virtual"), dict):
        _replace_by_file(table["virtual"], "materials", file, load_materials)
    return check(Rig, table, text, file)


def _replace_by_file(table: dict[str, Any], key: str, rig: Path, load: Callable[[Path], Document]) -> None:
    """Put what the file beside the rig says in the place of its name."""
    beside = table.get(key)
    if isinstance(beside, str):
        path = rig.parent / beside
        if not path.is_file():
            raise InputError(f"{rig}: {key} = {beside!r}: no such file beside the rig")
        table[key] = load(path)
    elif beside is not None:
        raise InputError(f"{rig}: {key} should be the name of a file beside the rig")

"""rig.toml: which supply and which camera, where they are, and how the camera sees the beam."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

from pydantic import ConfigDict, Field, field_validator, model_validator

from eimi_drivers.cameras.opening import CAMERAS
from eimi_drivers.cameras.settings import CameraSettings
from eimi_drivers.supplies.opening import SUPPLIES
from eimi_lab.config.calibration import Calibration, load_calibration
from eimi_lab.config.materials import TrueMaterials, load_materials
from eimi_lab.config.protocol import SupplyLimits
from eimi_lab.config.reading import Document, Table, check, locate, parse_table, read_text
from eimi_lab.errors import InputError
from eimi_lab.virtual.optics import Optics

VIRTUAL = "virtual"


def _one_of(driver: str, known: list[str]) -> str:
    if driver not in known:
        raise ValueError(f"is not a driver; there are {', '.join(known)}")
    return driver


class Supply(Table):
    """The coil's power supply; an address is a serial port or a VISA resource, whichever the driver takes."""

    driver: str
    address: str = Field(min_length=1)
    limits: SupplyLimits

    @field_validator("driver")
    @classmethod
    def _exists(cls, driver: str) -> str:
        return _one_of(driver, [*SUPPLIES, VIRTUAL])


class CoilRating(Table):
    """What the coil bears: a current for ever, and how slowly it warms up and cools down.

    See `eimi_lab.acquisition.heating`.
    """

    continuous_current_A: float = Field(gt=0)
    thermal_time_constant_s: float = Field(gt=0)


class Camera(Table):
    """The side camera; source is the number of a device, or a path, as the driver takes it.

    The settings are `CameraSettings`, by the same names and in the same units; one that is left out stays as the
    camera has it. With a region, pixels of the calibration count from its upper left corner.
    """

    driver: str
    source: int | str
    exposure_s: float | None = Field(default=None, gt=0)
    gain: float | None = None
    gamma: float | None = Field(default=None, gt=0)
    region: Annotated[tuple[int, int, int, int], Field(strict=False)] | None = None
    bit_depth: int | None = Field(default=None, ge=8, le=16)

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

    @property
    def settings(self) -> CameraSettings:
        """What to set on the camera before the first frame."""
        return CameraSettings(self.exposure_s, self.gain, self.gamma, self.region, self.bit_depth)


class Virtual(Table):
    """The virtual rig behind the driver interfaces: coil, beam and optics, all from one seed."""

    model_config = ConfigDict(strict=False)  # a dataclass cannot be filled from a table in strict mode

    seed: int = Field(ge=0)
    coil_time_constant_s: float = Field(gt=0)
    current_noise_A: float = Field(ge=0)
    frame_size_px: tuple[int, int]
    mesh: tuple[int, int]
    optics: Optics = Optics()
    materials: TrueMaterials

    @model_validator(mode="after")
    def _positive(self) -> Virtual:
        for name in ("frame_size_px", "mesh"):
            if min(getattr(self, name)) < 1:
                raise ValueError(f"{name} = {list(getattr(self, name))} must be two positive numbers")
        return self


class Rig(Document):
    """A whole rig.toml. In the file, `calibration` is the name of a file beside it, and so is `virtual.materials`:
    a dataset keeps the rig's text, and the hidden material must not be in it.
    """

    name: str = Field(min_length=1)
    supply: Supply
    camera: Camera
    calibration: Calibration
    coil: CoilRating | None = None
    virtual: Virtual | None = None

    @model_validator(mode="after")
    def _virtual_as_a_whole(self) -> Rig:
        drivers = {self.supply.driver, self.camera.driver}
        if VIRTUAL in drivers and drivers != {VIRTUAL}:
            raise ValueError("supply.driver and camera.driver must both be 'virtual', or neither: they share a beam")
        if (VIRTUAL in drivers) != (self.virtual is not None):
            raise ValueError("the table [virtual] belongs with driver = 'virtual', and only there")
        return self


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

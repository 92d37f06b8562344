"""The instruments that a rig names, opened for one run and closed after it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from typing import Any

from eimi_drivers.interfaces import Camera, Clock, PowerSupply
from eimi_lab.config.protocol import SupplyLimits
from eimi_lab.config.rig import Rig
from eimi_lab.config.specimen import SpecimenFile


@dataclass(frozen=True)
class Bench:
    """A supply, a camera and their time. truth is what a virtual rig is made of, None on a real bench."""

    supply: PowerSupply
    camera: Camera
    clock: Clock
    truth: dict[str, Any] | None = None


@contextmanager
def open_bench(rig: Rig, specimen: SpecimenFile, limits: SupplyLimits) -> Iterator[Bench]:
    """Open the rig's instruments within the stricter of the rig's limits and `limits`. Raises InstrumentError.

    Leaving closes them; it does not switch off: `switching_off` does.
    """
    stricter = rig.supply.limits.stricter(limits)
    if rig.virtual:
        from eimi_lab.virtual.rig import open_virtual_rig

        limited = rig.model_copy(update={"supply": rig.supply.model_copy(update={"limits": stricter})})
        supply, camera, clock, truth = open_virtual_rig(limited, specimen)
        with closing(supply), closing(camera):
            yield Bench(supply, camera, clock, truth)
        return
    from eimi_drivers.cameras.opening import open_camera
    from eimi_drivers.clock import WallClock
    from eimi_drivers.interfaces import Limits
    from eimi_drivers.supplies.opening import open_supply

    wall = WallClock()
    opened = open_supply(rig.supply.driver, rig.supply.address, Limits(stricter.current_A, stricter.voltage_V), wall)
    with closing(opened), closing(open_camera(rig.camera.driver, rig.camera.source)) as eye:
        yield Bench(opened, eye, wall)

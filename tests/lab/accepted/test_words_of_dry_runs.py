"""A dry run prints the stored text for each kind of protocol and rig."""

# If a change is wanted, read the differences before you copy a new description over the accepted one.

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from eimi_drivers.interfaces import Limits
from eimi_lab.acquisition import dry_run
from eimi_lab.acquisition.events import Settled, StateStored
from eimi_lab.config.interlock import Interlock
from eimi_lab.config.protocol import Conditioning, RingDown, Transients, load_protocol
from eimi_lab.config.rig import CoilRating, Rig, load_rig
from eimi_lab.config.sensor import RigSensor
from eimi_lab.config.specimen import load_specimen
from tests.shared.accepted_numbers import check

ACCEPTED = Path(__file__).parent / "dry_runs"
SPECIMEN = load_specimen("type1")
PLAIN = load_protocol("dragon_skin_10")
FULL = PLAIN.model_copy(
    update={
        "conditioning": Conditioning(cycles=3, current_A=1.4),
        "ring_down": RingDown(seconds=9.0, repeats=4, from_A=1.3, rate_Hz=120.0),
        "transients": Transients(frames_per_state=12),
    }
)
ONCE = PLAIN.model_copy(
    update={
        "conditioning": Conditioning(cycles=1, current_A=1.4),
        "ring_down": RingDown(seconds=9.0),
        "transients": Transients(frames_per_state=0),
    }
)
BOTH = PLAIN.model_copy(
    update={"current": PLAIN.current.model_copy(update={"both_polarities": True}), "transients": ONCE.transients}
)
HIGH = ONCE.model_copy(update={"limits": PLAIN.limits.model_copy(update={"voltage_V": 60.0})})
VIRTUAL = load_rig("virtual")
HALL = RigSensor(name="hall", driver="lakeshore-425", address="COM7", measures="field")


def real(driver: str, voltage_V: float = 20.0, **more: Any) -> Rig:
    # Return the virtual rig with a real supply whose current limit is smaller than that of the protocol.
    limits = VIRTUAL.supply.limits.model_copy(update={"current_A": 1.55, "voltage_V": voltage_V})
    supply = VIRTUAL.supply.model_copy(
        update={"driver": driver, "address": "/dev/ttyUSB3", "limits": limits, "off_below_A": 0.03}
    )
    camera = VIRTUAL.camera.model_copy(update={"driver": "opencv"})
    return VIRTUAL.model_copy(update={"supply": supply, "camera": camera, "virtual": None, **more})


RATED = real(
    "korad",
    coil=CoilRating(continuous_current_A=1.2, thermal_time_constant_s=300.0),
    sensors=(HALL,),
    interlocks=(Interlock(reading="hall", maximum=8.0, longest_silence_s=5.0),),
)
RUNS: dict[str, tuple[Any, Any, bool]] = {
    "with all parts": (FULL, RATED, True),
    "of one cycle": (ONCE, RATED, False),
    "on the virtual rig": (PLAIN, VIRTUAL, True),
    "of both polarities": (BOTH, real("korad"), True),
    "of both polarities on the virtual rig": (BOTH, VIRTUAL, False),
    "on a bipolar supply": (BOTH, real("kepco-bop"), False),
    "with another driver": (FULL, real("other"), True),
    "with a high voltage": (HIGH, real("korad", 50.0), False),
}


@pytest.mark.parametrize("name", RUNS)
def test_a_dry_run_says_the_accepted_words(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    protocol, rig, has_details = RUNS[name]
    lines: list[str] = []
    made: list[Any] = []
    driver_of, coil_of = dry_run.supply_driver, dry_run.CoilSupply

    def supply_driver(driver: str) -> Any:
        lines.append(f"the driver {driver} is asked for")
        return SimpleNamespace(without_contact="the output stays on") if driver == "other" else driver_of(driver)

    def coil_supply(clock: Any, **ratings: float) -> Any:
        lines.append(f"the emulated supply has {ratings}")
        return coil_of(clock, **ratings)

    def acquire(protocol: Any, specimen: Any, rig: Any, bench: Any, path: Path, on_event: Any) -> None:
        made.append((protocol, specimen, path.name, rig.interlocks))
        supply = bench.supply
        bench.clock.sleep(12.5)
        supply.identify()
        supply.set_current(0.25)
        on_event(Settled(state=3, waited_s=1.5, at_rest=True))
        on_event(StateStored(state=3, current_A=0.25, waited_s=1.5, flags=("A",)))
        bench.relay()
        lines.append(f"limits {Limits(supply.limits.current_A, supply.limits.voltage_V, supply.limits.off_below_A)}")
        frame = bench.camera.grab(5.0)
        lines.append(f"frame {frame.number} of {frame.image.shape} at {frame.timestamp_s:.4f} s")

    monkeypatch.setattr(dry_run, "supply_driver", supply_driver)
    monkeypatch.setattr(dry_run, "CoilSupply", coil_supply)
    monkeypatch.setattr(dry_run, "acquire", acquire)
    details = (lambda text: lines.append(f"detail: {text}")) if has_details else None
    dry_run.dry_run(protocol, SPECIMEN, rig, lambda text: lines.append(f"said: {text}"), details)
    assert made == [(protocol, SPECIMEN, "dry_run.h5", ())]
    check(lines, ACCEPTED / f"{name.replace(' ', '_')}.txt", tmp_path, relative=1e-6, absolute=1e-9)

"""What a run would do, down to the bytes on the wire: the run itself on an emulated supply, in simulated seconds."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from eimi_drivers.clock import SimulatedClock
from eimi_drivers.emulators.serve import DIALECTS, emulate
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.interfaces import Clock, Frame, Identity, Limits
from eimi_drivers.supplies.supply_names import supply_driver
from eimi_drivers.supplies.transport import InProcessTransport, Responder
from eimi_lab.acquisition.coil import without_contact
from eimi_lab.acquisition.event_words import in_words
from eimi_lab.acquisition.events import Event, StateStored
from eimi_lab.acquisition.heating import hottest
from eimi_lab.acquisition.open_bench import Bench
from eimi_lab.acquisition.run import acquire
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.rig import Rig
from eimi_lab.config.specimen import SpecimenFile

STAND_IN, BIPOLAR_STAND_IN = "korad", "kepco-bop"  # for a supply that has no wire or no emulator
FRAME_S = 1 / 30
ABOVE_LIMITS = 1.2  # what the stand-in is made for, since protections are set above the limits
GENESYS_V = 30.0  # the rating that the emulated Genesys names
RESISTANCE_OHM = 0.01  # the coil's is not known; so small a one is never in the way of the voltage limit


class _Wire(InProcessTransport):
    """A transport that tells every message as it is sent."""

    def __init__(self, responder: Responder, clock: Clock, address: str, say: Callable[[str], None]) -> None:
        super().__init__(responder, clock, address)
        self._say = say

    def write(self, message: bytes) -> None:
        """See `Transport.write`."""
        self._say(message.decode("ascii", "backslashreplace").rstrip())
        super().write(message)


class _BeamAtRest:
    """A camera in front of a beam that never moves."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._random = np.random.default_rng(0)
        self._number = 0

    def identify(self) -> Identity:
        """No camera."""
        return Identity("dry run", "no camera", "none")

    def flush(self) -> None:
        """Nothing is buffered."""

    def grab(self, timeout_s: float) -> Frame:
        """The next frame, a frame's time later."""
        self._clock.sleep(FRAME_S)
        self._number += 1
        image = np.full((32, 32), 200.0)
        image[:, 12:20] = 20.0
        image += self._random.normal(0.0, 2.0, image.shape)
        return Frame(image.astype(np.uint8), self._number, self._clock.now())

    def close(self) -> None:
        """Nothing to release."""


def dry_run(protocol: Protocol, specimen: SpecimenFile, rig: Rig, say: Callable[[str], None]) -> None:
    """Tell every step of a run and every message to the supply, with the time at which it would come.

    The beam settles at once, so that the duration is the shortest possible; the longest is told beside it. A driver of
    another package has no emulator here: its messages are not told, and the times are those of a stand-in.

    Raises InputError as the run would, InstrumentError for a channel that the supply does not have.
    """
    clock = SimulatedClock()
    limits = rig.supply.limits.stricter(protocol.limits)
    driver, address = rig.supply.driver, rig.supply.address
    told = driver in DIALECTS or rig.simulated
    stand_in = BIPOLAR_STAND_IN if min(protocol.currents_A) < 0 else STAND_IN
    language, place = (driver, address) if driver in DIALECTS else (stand_in, "dry run")
    coil = CoilSupply(
        clock,
        resistance_ohm=RESISTANCE_OHM,
        max_current_A=limits.current_A * ABOVE_LIMITS,
        max_voltage_V=max(limits.voltage_V * ABOVE_LIMITS, GENESYS_V),
    )

    def say_message(message: str) -> None:
        if told:
            say(f"{clock.now():9.2f} s  > {message}")

    wire = _Wire(emulate(language, coil, place), clock, place, say_message)
    supply = supply_driver(language)(wire, Limits(limits.current_A, limits.voltage_V, rig.supply.off_below_A), clock)

    currents = protocol.currents_A
    constant = rig.calibration.coil_constant_mT_per_A
    say(f"{protocol.name} on {specimen.specimen.name} with rig {rig.name}: {len(currents)} states")
    say(f"limits: {limits.current_A:g} A, {limits.voltage_V:g} V; ramps of {protocol.ramp.rate_A_per_s:g} A/s")
    if rig.coil:
        worst = hottest(protocol, rig.coil)
        say(f"coil: at most {100 * worst.share:.0f} % of the heat that it bears, at the end of {worst.stage}")
    cycles = protocol.conditioning.cycles if protocol.conditioning else 0
    if protocol.conditioning:
        say(f"conditioning: {cycles} cycles to {protocol.conditioning.current_A:g} A and back to 0")
    for index, current in enumerate(currents):
        say(f"state {index}: {current:g} A, {current * constant:.4g} mT, {protocol.frames_per_state} frames")
    if protocol.transients.frames_per_state:
        say(f"transients: at most {protocol.transients.frames_per_state} frames of each state while the beam settles")
    if protocol.release:
        say(f"release: to zero in one step, recorded for {protocol.release.seconds:g} s")
    if not rig.virtual:
        say(f"if the cable is pulled or the computer dies: {without_contact(supply_driver(driver))}")
    if told:
        because = ", as the virtual supply has no wire" if rig.simulated else ""
        say(f"messages to the supply, in the language of {language}{because}:")
    else:
        say(
            f"messages to the supply: not shown, since the driver {driver} comes from another package and has no "
            f"emulator here; the times are those of {language}"
        )

    def say_stored(event: Event) -> None:
        if isinstance(event, StateStored):
            say(f"{clock.now():9.2f} s  state {event.state} stored: {in_words(event)}")

    with TemporaryDirectory() as folder:
        bench = Bench(supply, _BeamAtRest(clock), clock)
        acquire(protocol, specimen, rig, bench, Path(folder) / "dry_run.h5", say_stored)
    shortest = clock.now()
    settled = len(currents) + (min(cycles, 2) + 2 if cycles else 0)
    longest = shortest + settled * (protocol.settle.timeout_s - protocol.settle.drift_window_s)
    say(f"duration: {shortest:.0f} s where the beam rests at once, {longest:.0f} s where it never does")

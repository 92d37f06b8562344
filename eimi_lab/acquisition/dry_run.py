"""List the steps of a run and the messages to the supply, without using an instrument."""

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
from eimi_lab.acquisition.event_words import in_words, protection_in_words
from eimi_lab.acquisition.events import Event, StateStored
from eimi_lab.acquisition.heating import hottest
from eimi_lab.acquisition.open_bench import Bench
from eimi_lab.acquisition.polarity import swaps_leads
from eimi_lab.acquisition.run import acquire
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.rig import Rig
from eimi_lab.config.specimen import SpecimenFile

FIRST_STATES, LAST_STATES = 6, 2
"""Numbers of states at the beginning and at the end of a run that a summary lists. The other states are listed only
with -v.
"""

STAND_IN, BIPOLAR_STAND_IN = "korad", "kepco-bop"  # emulated in place of a simulated supply or one without an emulator
FRAME_S = 1 / 30
ABOVE_LIMITS = 1.2  # rating of the emulated supply divided by the limits, because protections are set above the limits
GENESYS_V = 30.0  # voltage rating of the emulated Genesys
RESISTANCE_OHM = 0.01  # assumed resistance of the coil; so small that the voltage limit is never reached


class _Wire(InProcessTransport):
    """The connection to an emulated supply; every message is also passed to the function `say`."""

    def __init__(self, responder: Responder, clock: Clock, address: str, say: Callable[[str], None]) -> None:
        super().__init__(responder, clock, address)
        self._say = say

    def write(self, message: bytes) -> None:
        self._say(message.decode("ascii", "backslashreplace").rstrip())
        super().write(message)


class _BeamAtRest:
    """A simulated camera that shows a beam at rest."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._random = np.random.default_rng(0)
        self._number = 0

    def identify(self) -> Identity:
        return Identity("dry run", "no camera", "none")

    def flush(self) -> None:
        """Do nothing."""

    def grab(self, timeout_s: float) -> Frame:
        """Return a frame of the beam at rest, and advance the simulated time by the time between two frames."""
        self._clock.sleep(FRAME_S)
        self._number += 1
        image = np.full((32, 32), 200.0)
        image[:, 12:20] = 20.0
        image += self._random.normal(0.0, 2.0, image.shape)
        return Frame(image.astype(np.uint8), self._number, self._clock.now())

    def close(self) -> None:
        """Do nothing."""


def dry_run(
    protocol: Protocol,
    specimen: SpecimenFile,
    rig: Rig,
    say: Callable[[str], None],
    say_detail: Callable[[str], None] | None = None,
) -> None:
    """List the steps of a run and the messages to its supply, without using an instrument.

    If the driver has no emulator in this program, no messages are listed. For a virtual supply, which exchanges no
    messages, the messages to an emulated real supply are listed.

    Parameters
    ----------
    protocol : Protocol
        The currents of the run, and the times to wait.
    specimen : SpecimenFile
        The beam.
    rig : Rig
        Contents of the rig file: limits and drivers.
    say : callable
        Receives each step as a line of text, and at the end the shortest and the longest duration.
    say_detail : callable, optional
        Receives the messages to the supply and other details as lines of text; by default `say`.

    Raises
    ------
    InputError
        If the protocol, the specimen and the rig do not fit together.
    InstrumentError
        If the supply does not have the output (channel) that its address names.
    """
    clock, detail = SimulatedClock(), say_detail or say
    limits = rig.supply.limits.stricter(protocol.limits)
    driver, address = rig.supply.driver, rig.supply.address
    shows_messages = driver in DIALECTS or rig.simulated
    is_reversed = min(protocol.currents_A) < 0 and not swaps_leads(protocol, rig)
    stand_in = BIPOLAR_STAND_IN if is_reversed else STAND_IN
    language, place = (driver, address) if driver in DIALECTS else (stand_in, "dry run")
    coil = CoilSupply(
        clock,
        resistance_ohm=RESISTANCE_OHM,
        max_current_A=limits.current_A * ABOVE_LIMITS,
        max_voltage_V=max(limits.voltage_V * ABOVE_LIMITS, GENESYS_V),
    )

    def say_message(message: str) -> None:
        if shows_messages:
            detail(f"{clock.now():9.2f} s  > {message}")

    wire = _Wire(emulate(language, coil, place), clock, place, say_message)
    supply = supply_driver(language)(wire, Limits(limits.current_A, limits.voltage_V, rig.supply.off_below_A), clock)

    currents = protocol.currents_A
    constant = rig.calibration.mT_per_A
    say(f"{protocol.name} on {specimen.specimen.name} with rig {rig.name}: {len(currents)} states")
    say(
        f"limits of the supply: {limits.current_A:g} A, {limits.voltage_V:g} V; each ramp changes the current by "
        f"{protocol.ramp.rate_A_per_s:g} A/s"
    )
    if rig.coil:
        worst = hottest(protocol, rig.coil)
        say(f"coil: heated to at most {100 * worst.share:.0f} % of the allowed heat, at the end of {worst.stage}")
    for sensor in rig.sensors:
        listed = (
            f"sensor {sensor.name}: driver {sensor.driver} at the address {sensor.address}, measures {sensor.measures}"
        )
        say(f"{listed}; a dry run does not read the sensor")
    for interlock in rig.interlocks:
        say(f"interlock: {interlock.in_words}")
    cycles = protocol.conditioning.cycles if protocol.conditioning else 0
    if protocol.conditioning:
        repeated = "1 cycle" if cycles == 1 else f"{cycles} cycles"
        say(f"conditioning: {repeated} to {protocol.conditioning.current_A:g} A and back to 0")
    for index, current in enumerate(currents):
        between = FIRST_STATES <= index < len(currents) - LAST_STATES
        if say_detail and index == FIRST_STATES and between:
            say(f"… {len(currents) - FIRST_STATES - LAST_STATES} states between …")
        tell_state = detail if between else say
        tell_state(f"state {index}: {current:g} A, {current * constant:.4g} mT, {protocol.frames_per_state} frames")
    if protocol.transients.frames_per_state:
        say(f"transients: at most {protocol.transients.frames_per_state} frames of each state while the beam settles")
    if rule := protocol.ring_down:
        times = f", {rule.repeats} times" if rule.repeats > 1 else ""
        rate = f" at {rule.rate_Hz:g} Hz" if rule.rate_Hz else ""
        say(
            f"ring-down: from {protocol.ring_down_from_A:g} A to zero in one step, recorded for {rule.seconds:g} s"
            f"{rate}{times}"
        )
    if not rig.virtual:
        readings = tuple(interlock.reading for interlock in rig.interlocks)
        say(protection_in_words(without_contact(supply_driver(driver)), readings))
    if shows_messages:
        because = ", as for a real supply, because the virtual supply exchanges no messages" if rig.simulated else ""
        detail(f"messages to a supply with the driver {language}{because}:")
    else:
        say(
            f"messages to the supply: not shown, because the driver {driver} comes from another package and has no "
            f"emulator here; the times are those of a supply with the driver {language}"
        )

    def say_stored(event: Event) -> None:
        if isinstance(event, StateStored):
            detail(f"{clock.now():9.2f} s  state {event.state} stored: {in_words(event)}")

    def say_swapped() -> None:
        who = "the virtual rig swaps" if rig.simulated else "the coil is off while a person swaps"
        say(f"{clock.now():9.2f} s  {who} the leads of the coil")

    with TemporaryDirectory() as folder:
        # The steps of aim-tti depend on the model of the supply, which only a run can ask.
        steps_known = rig.simulated or (language == driver and driver != "aim-tti")
        bench = Bench(supply, _BeamAtRest(clock), clock, relay=say_swapped, steps_known=steps_known)
        without_interlocks = rig.model_copy(update={"interlocks": ()})  # interlocks concern the real coil
        acquire(protocol, specimen, without_interlocks, bench, Path(folder) / "dry_run.h5", say_stored)
    shortest = clock.now()
    settle = protocol.settle
    in_state_s = max(0.0, settle.timeout_s - max(settle.drift_window_s, settle.dwell_s))
    others = (min(cycles, 2) + 2 if cycles else 0) + (rule.repeats if rule else 0)  # in cycles and before ring-downs
    longest = shortest + len(currents) * in_state_s + others * (settle.timeout_s - settle.drift_window_s)
    say(f"duration: {shortest:.0f} s if the beam is at rest at once, {longest:.0f} s if it never comes to rest")

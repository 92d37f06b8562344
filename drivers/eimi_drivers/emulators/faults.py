"""Define the faults that an emulated instrument can have, and emulate the faults of its line (the connection to it)."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum

from eimi_drivers.clock import WallClock
from eimi_drivers.interfaces import Clock
from eimi_drivers.supplies.transport import Responder

SLEEPS_FOR_S, RESTARTS_WITHIN_S = 12.0, 1.0
SHORTED_A, DRIFTS_TO_A, OFFSET_A, HUNTING_A = 0.8, 2.4, 0.015, 0.2


class Fault(Enum):
    """A fault of an emulated instrument, of the line (the connection) to the instrument, or of an emulated coil.

    Attributes
    ----------
    effect : str
        What the fault does.
    correct : str
        What a correct program does when the fault occurs.
    """

    SILENCE = (
        "every message is lost and nothing answers",
        "stops waiting after its time limit, tries to switch off, and reports that the coil may still be on",
    )
    SLEEP = (
        f"every message is lost for {SLEEPS_FOR_S:g} s; then the supply works again, and its output is unchanged",
        "switches the coil off as soon as the supply answers again",
    )
    GARBAGE = (
        "every message is obeyed, but its answer is unreadable",
        "uses no value from such an answer, tries to switch off, and reports that the coil may still be on",
    )
    PARTIAL = (
        "every message is obeyed, but the second half of its answer is lost",
        "uses no value from such an answer, tries to switch off, and reports that the coil may still be on",
    )
    SLOW = (
        "every message is obeyed, but its answer is late",
        "waits, and does not take a late answer for the answer to the next query",
    )
    DROP = (
        "the data connection is cut once and can be reopened at the same address",
        "reopens the connection, asks for the identity, and switches the coil off",
    )
    DISCONNECT = (
        "the data connection is cut permanently",
        "reports that the coil may still be on",
    )
    REENUMERATE = (
        "the data connection is cut; the supply returns at another address",
        "reports that the coil may still be on, or finds the supply by its serial number and switches it off",
    )
    SWAP = (
        "the data connection is cut; another supply of the same model, which is off, then answers at the same address",
        "compares the identities, sends nothing to the other supply, and reports that the coil may still be on",
    )

    SHORTED = (
        (
            f"the regulator is shorted: {SHORTED_A:g} A flow even if the output is off; the supply still reports the "
            "set-points that were set"
        ),
        "measures after switching off, and reports that the coil may still be on, with the measured current",
    )
    DRIFT = (
        (
            f"the current rises to {DRIFTS_TO_A:g} A at 1 A/s while the output is on; the supply still reports the "
            "set-point that was set"
        ),
        "measures the current regularly, and switches off when the current differs from the set-point",
    )
    FALLEN = (
        "no current flows although the supply reports that its output is on",
        "measures the current regularly, and ends the run when no current flows",
    )
    OFFSET = (
        f"the meter adds {1000 * OFFSET_A:g} mA to every current, which is within the accuracy of many supplies",
        "raises no alarm, and reports the coil as off",
    )
    LOCKED = (
        "a person uses the front panel: commands are not obeyed",
        "reads every set-point and the output back, and reports that the coil may still be on",
    )
    HUNTING = (
        f"the current oscillates by {HUNTING_A:g} A without end",
        "does not accept the current as settled, and switches off",
    )
    TRIP = (
        "a protection switches the output off",
        "notices the trip, does not switch on again, and reports the trip",
    )
    BROWNOUT = (
        (
            f"the mains fail briefly: nothing answers for {RESTARTS_WITHIN_S:g} s, then the supply has the settings "
            "that it has after power-up"
        ),
        "notices that the output is off without a command, and does not continue as if the output were on",
    )

    def __init__(self, effect: str, correct: str) -> None:
        self.effect = effect
        self.correct = correct

    @property
    def word(self) -> str:
        """Return the name of the fault in the options of commands, such as "silence"."""
        return self.name.lower()


LINE_FAULTS = frozenset(list(Fault)[: list(Fault).index(Fault.SHORTED)]) - {Fault.SWAP}
"""The faults that `FaultyInstrument.inject` accepts."""


class FaultyInstrument:
    """An emulated instrument whose line (connection to the driver) can have faults.

    Parameters
    ----------
    instrument : Responder
        The emulated instrument.
    clock : Clock, optional
        The clock of the instrument; by default the wall clock.
    late_s : float
        The delay of an answer with the fault SLOW, s.

    Attributes
    ----------
    instrument : Responder
        The instrument that answers at present.
    lost : bool
        True if the line is cut until `reconnect` is called.
    """

    garbage = b"\xfe\x81?\x9c\n#\r"

    def __init__(self, instrument: Responder, clock: Clock | None = None, late_s: float = 0.3) -> None:
        self.late_s = late_s
        self.instrument = instrument
        self.lost = False
        self._clock = clock or WallClock()
        self._fault: Fault | None = None
        self._concerns: Callable[[bytes], bool] = bool
        self._next: Responder | None = None
        self._silent_until_s = -float("inf")

    def inject(self, fault: Fault | None, concerns: Callable[[bytes], bool] = bool) -> None:
        """Begin a fault of the line (the connection to the instrument), or end the present fault.

        Parameters
        ----------
        fault : Fault or None
            One of `LINE_FAULTS`; None ends the present fault.
        concerns : callable
            Takes a message and returns whether the fault applies to this message; by default to all messages.

        Raises
        ------
        ValueError
            The fault is not one of `LINE_FAULTS`.
        """
        if fault is not None and fault not in LINE_FAULTS:
            raise ValueError(
                f"{fault.word} is not a fault of the line (connection); begin it with the function begin_fault of "
                "eimi_drivers.emulators.spoiling"
            )
        self._fault, self._concerns = fault, concerns
        if fault is Fault.SLEEP:
            self.be_silent(SLEEPS_FOR_S)
            self._fault = None

    def be_silent(self, seconds: float) -> None:
        """Lose every message for `seconds` (s) from now on."""
        self._silent_until_s = self._clock.now() + seconds

    def swap(self, other: Responder, concerns: Callable[[bytes], bool] = bool) -> None:
        """Cut the line (the connection) at the next message for which `concerns` returns True.

        After the line is reopened, the instrument `other` answers.
        """
        self._fault, self._concerns, self._next = Fault.DROP, concerns, other

    def reconnect(self) -> None:
        """Restore a line (connection) that was cut permanently."""
        self.lost, self._fault = False, None

    def receive(self, data: bytes) -> bytes:
        """Receive a message, and return the answer of the instrument, which the present fault may change or remove.

        Raises
        ------
        ConnectionResetError
            The present fault cuts the connection.
        """
        fault = self._fault if self._concerns(data) else None
        if self.lost or fault in {Fault.DISCONNECT, Fault.REENUMERATE}:
            self.lost = True
            raise ConnectionResetError("the line was cut")
        if fault is Fault.DROP:
            self._fault = None
            self.instrument, self._next = self._next or self.instrument, None
            raise ConnectionResetError("the line was interrupted")
        if fault is Fault.SILENCE or self._clock.now() < self._silent_until_s:
            return b""
        answer = self.instrument.receive(data)
        if fault is Fault.SLOW and answer:
            self._clock.sleep(self.late_s)
        if fault is Fault.PARTIAL:
            return answer[: len(answer) // 2]
        return self.garbage if fault is Fault.GARBAGE and answer else answer

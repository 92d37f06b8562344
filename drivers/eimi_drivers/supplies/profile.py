"""Describe one family of SCPI supplies: its messages, its protections and its watchdog.

Placeholders in the messages: ``{value}`` is a set-point, ``{channel}`` the channel, ``{limit}`` the current limit of
the driver. ``{voltage}`` and ``{current}`` are the limits of the driver times `PROTECTION_MARGIN`.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Watchdog:
    """The messages for a watchdog, a timer inside the supply that switches the output off if no message arrives.

    ``{seconds}`` in a message stands for `seconds`.

    Parameters
    ----------
    arm : tuple of str
        Messages that start the timer.
    verify : tuple of (str, float or None)
        Queries that verify the timer, with the right answer; None stands for `seconds`.
    disarm : str
        Message that stops the timer.
    seconds : int
        Time after which the timer switches the output off, s.
    effect : str
        Description of the timer for the user.
    expired : tuple of (str, float), optional
        Query, and its answer if the timer has switched the output off.
    """

    arm: tuple[str, ...]
    verify: tuple[tuple[str, float | None], ...]
    disarm: str
    seconds: int = 10
    effect: str = "the supply's own watchdog switches every output off {seconds} s after the last message"
    expired: tuple[str, float] | None = None


@dataclass(frozen=True)
class Register:
    """A status register in which the supply reports tripped protections.

    Parameters
    ----------
    question : str
        Query for the register; the answer is a whole number.
    trips : tuple of (int, str)
        Bits that report a tripped protection, with their meaning.
    """

    question: str
    trips: tuple[tuple[int, str], ...]


@dataclass(frozen=True)
class Profile:
    """The messages of one family of SCPI supplies.

    Parameters
    ----------
    driver : str
        Name of the driver.
    channels : tuple of int
        Lowest and highest channel number.
    baud_rate : int
        Speed of a serial line, bit/s.
    stop_bits : int
        Number of stop bits on a serial line.
    remote : str
        First message on a serial line, which permits remote control; empty if not needed.
    select : str
        Message that selects the channel; empty if not needed.
    modes : tuple of (str, str, str)
        Required modes, such as constant current: query, beginning of the right answer (alternatives are separated by
        ``|``), and command.
    set_voltage, set_current : str
        Commands that set the voltage (V) and the current (A).
    voltage_set, current_set : str
        Queries for the set-points of voltage (V) and current (A).
    measure_voltage, measure_current : str
        Queries for the measured voltage (V) and current (A).
    protect : tuple of str
        Messages that switch the protections on.
    armed : tuple of (str, str)
        Queries that verify the protections, with the right answer: a trip level, or 1 or 0 for a switch.
    protections : str
        Description of the protections for the user.
    on, off : tuple of str
        Messages that switch the output on and off.
    output : str
        Query for the output; the answer is 1 or ON if the output is on, 0 or OFF if it is off.
    output_bit : int
        0, or the bit for channel 1 if the answer to `output` is a hexadecimal status word.
    trip : tuple of str
        Queries whose answer is 1 or YES if a protection has tripped.
    registers : tuple of Register
        Status registers that report tripped protections.
    errors : str
        Query for the oldest error; empty if the family has no error queue.
    query_delay_s : float
        Time between sending a query and reading the answer, s.
    watchdog : Watchdog, optional
        Timer that switches the output off if no message arrives.
    reads_zero_within_A : float
        Largest current that a healthy supply measures when no current flows, A; 0 if not known or below 20 mA.
    """

    driver: str
    channels: tuple[int, int] = (1, 1)
    baud_rate: int = 9600
    stop_bits: int = 1
    remote: str = ""
    select: str = ""
    modes: tuple[tuple[str, str, str], ...] = ()
    set_voltage: str = "VOLT {value}"
    voltage_set: str = "VOLT?"
    set_current: str = "CURR {value}"
    current_set: str = "CURR?"
    measure_voltage: str = "MEAS:VOLT?"
    measure_current: str = "MEAS:CURR?"
    protect: tuple[str, ...] = ()
    armed: tuple[tuple[str, str], ...] = ()
    protections: str = ""
    on: tuple[str, ...] = ("OUTP 1",)
    off: tuple[str, ...] = ("OUTP 0",)
    output: str = "OUTP?"
    output_bit: int = 0
    trip: tuple[str, ...] = ()
    registers: tuple[Register, ...] = ()
    errors: str = "SYST:ERR?"
    query_delay_s: float = 0.0
    watchdog: Watchdog | None = None
    reads_zero_within_A: float = 0.0

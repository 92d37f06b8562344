"""Describe one family of SCPI supplies: its commands and queries, its protections and its watchdog.

In a message ``{value}`` is a set-point, ``{channel}`` the channel in use and ``{limit}`` the driver's limit of the
current. ``{voltage}`` and ``{current}`` are the driver's limits times `PROTECTION_MARGIN`.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Watchdog:
    """State the messages of a timer in the supply that switches the output off if the computer has failed.

    Parameters
    ----------
    arm : tuple of str
        Messages that start the timer, sent in this order before the output is switched on; ``{seconds}`` is its time.
    verify : tuple of (str, float or None)
        Queries, each with the number that must be answered; None stands for the seconds.
    disarm : str
        Message that stops the timer, sent after the output was switched off.
    seconds : int
        The time (s) until the output is switched off. A run sends a message every 2 s.
    effect : str
        What the timer does, in words for the user; ``{seconds}`` is its time.
    expired : tuple of (str, float), optional
        A query and the number that it answers after the timer has switched the output off.
    """

    arm: tuple[str, ...]
    verify: tuple[tuple[str, float | None], ...]
    disarm: str
    seconds: int = 10
    effect: str = "the supply's own watchdog switches every output off {seconds} s after the last message"
    expired: tuple[str, float] | None = None


@dataclass(frozen=True)
class Register:
    """State a register of the supply that reports trips.

    Parameters
    ----------
    question : str
        The query, answered by a whole number.
    trips : tuple of (int, str)
        The bits that report a trip, each with its meaning in words. The other bits do not report trips.
    """

    question: str
    trips: tuple[tuple[int, str], ...]


@dataclass(frozen=True)
class Profile:
    """State the messages of one family.

    Parameters
    ----------
    driver : str
        The name in a rig file.
    channels : tuple of int
        The lowest and the highest channel.
    baud_rate : int
        The speed of a serial line, bit/s.
    stop_bits : int
        The number of stop bits on a serial line.
    remote : str
        Message that moves the supply into remote mode on a serial line, sent before the first message and again after
        the line was reopened; empty if the family needs none. An emulator in the same process gets it too.
    select : str
        Message that selects the channel, sent before every message that concerns a channel; empty if the family names
        the channel in each message or has one channel.
    modes : tuple of (str, str, str)
        Settings that determine what a set-point means or whether it has an effect: a query, the beginning of the right
        answer (alternatives are separated by ``|``), and the message that changes the setting to this answer. The query
        is sent before every set-point other than zero, and the message only if the answer is wrong.
    set_voltage, voltage_set, set_current, current_set, measure_voltage, measure_current : str
        The commands that set a quantity, and the queries for the set-points and the measured values.
    protect : tuple of str
        Messages that arm the supply's own protections, sent before `on`.
    armed : tuple of (str, str)
        Queries that read the protections back, each with the level or the switch (0 or 1) that must be answered. If the
        answer has two parts, such as ``13.2,ON``, the first is the level and the second must be on.
    protections : str
        The armed protections in words, for the user.
    on, off : tuple of str
        Messages that switch the output, sent in this order.
    output : str
        The query whether the output is on, answered by 1 or 0, ON or OFF.
    output_bit : int
        If it is not 0, `output` is answered by a hexadecimal status word. This bit belongs to channel 1, and the next
        higher bit to channel 2.
    trip : tuple of str
        The queries whether a protection tripped, answered by 1 or 0, YES or NO.
    registers : tuple of Register
        The registers that report trips.
    errors : str
        The query for the oldest entry of the error queue; empty if the family has no such queue.
    query_delay_s : float
        Wait between a query and reading its answer, s.
    watchdog : Watchdog, optional
        The supply's own watchdog or output timer.
    reads_zero_within_A : float
        The largest current (A) that a healthy unit shows when no current is set. It is used only if it is above 20 mA,
        see `eimi_drivers.supplies.off`. The value 0 means that this current is smaller, or was not looked up.
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

"""Describe one family of SCPI supplies: its commands and queries, its protections and its watchdog.

A watchdog is a timer inside the supply that switches the output off if no message arrives.

The messages contain placeholders. ``{value}`` is a set-point, ``{channel}`` is the channel in use, and ``{limit}`` is
the current limit of the driver. ``{voltage}`` and ``{current}`` are the limits of the driver times `PROTECTION_MARGIN`.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Watchdog:
    """The messages for a timer inside the supply that switches the output off if the computer fails.

    Parameters
    ----------
    arm : tuple of str
        Messages that start the timer, which are sent in this order before the output is switched on. ``{seconds}``
        stands for `seconds`.
    verify : tuple of (str, float or None)
        Queries that verify the timer, each with the number that the supply must answer. None stands for `seconds`.
    disarm : str
        Message that stops the timer, which is sent after the output was switched off.
    seconds : int
        The time of the timer, s. A run sends a message to the supply every 2 s.
    effect : str
        A description of the timer for the user. ``{seconds}`` stands for `seconds`.
    expired : tuple of (str, float), optional
        A query, and the number that the supply answers if the timer has switched the output off.
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
        The query for the register. The supply answers a whole number.
    trips : tuple of (int, str)
        The bits that report a tripped protection, each with its meaning in words. The other bits have other meanings.
    """

    question: str
    trips: tuple[tuple[int, str], ...]


@dataclass(frozen=True)
class Profile:
    """The messages of one family of SCPI supplies.

    Parameters
    ----------
    driver : str
        The name of the driver in a rig file, which lists the instruments of a set-up.
    channels : tuple of int
        The lowest and the highest channel number.
    baud_rate : int
        The speed of a serial line, bit/s.
    stop_bits : int
        The number of stop bits on a serial line.
    remote : str
        Message that brings the supply into remote mode on a serial line. The message is sent before the first message
        and again after the line was reopened. Empty if the family needs no such message.
    select : str
        Message that selects the channel, which is sent before every message that concerns a channel. Empty if each
        message contains the channel, or if the family has one channel.
    modes : tuple of (str, str, str)
        Modes in which the supply must be, so that its set-points are the voltage and the current of the coil, such as
        constant current. Each entry has three parts: a query, the beginning of the right answer (alternatives are
        separated by ``|``), and the command that selects the mode. The query is sent before every set-point except a
        current of zero. The command is sent if the answer is wrong.
    set_voltage, set_current : str
        The commands that set the voltage (V) and the current (A).
    voltage_set, current_set : str
        The queries for the set-points of voltage (V) and current (A).
    measure_voltage, measure_current : str
        The queries for the measured voltage (V) and current (A).
    protect : tuple of str
        Messages that arm (switch on) the protections inside the supply, which are sent before `on`.
    armed : tuple of (str, str)
        Queries that verify the protections, each with the trip level or the state of the switch (0 or 1) that the
        supply must answer. If the answer has two parts, such as ``13.2,ON``, the first part is the trip level and the
        second part must be ON.
    protections : str
        A description of the armed protections for the user.
    on, off : tuple of str
        Messages that switch the output on and off, each in the order in which the messages are sent.
    output : str
        The query for the output. The supply answers 1 or ON if the output is on, 0 or OFF if it is off.
    output_bit : int
        0, or the bit for channel 1 in the hexadecimal status word with which the supply answers `output`. The next
        higher bit is for channel 2.
    trip : tuple of str
        Queries for the protections. The supply answers 1 or YES if the protection has tripped, 0 or NO if not.
    registers : tuple of Register
        The status registers that report tripped protections.
    errors : str
        The query for the oldest entry of the error queue. Empty if the family has no error queue.
    query_delay_s : float
        The time between sending a query and reading the answer, s.
    watchdog : Watchdog, optional
        The watchdog or the output timer inside the supply.
    reads_zero_within_A : float
        The largest current that a healthy supply measures when no current flows, A. Up to this current, and always up
        to 20 mA, the coil counts as off by default. 0 if the largest current is below 20 mA or not known.
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

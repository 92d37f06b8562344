"""The faults that can keep a coil on, and the required reaction of a measurement to each fault."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass

from benchmarks.spoilt_bench import UNIDENTIFIED, Trial, wait_until
from eimi_drivers.emulators.faults import SLEEPS_FOR_S


@dataclass(frozen=True)
class Fault:
    """A fault that is caused during a run, and the required reaction of the run.

    Attributes
    ----------
    name : str
        Name of the fault.
    driver : str
        Name of the supply's driver.
    transport : str
        Connection: "pty" or "port" (serial port), "tcp" or "hislip".
    act : callable
        Causes the fault in a trial; returns the time (s, monotonic clock) at which the timing begins.
    said : str
        Regular expression that a message must match.
    off_within_s : float
        Time limit for the coil, s.
    unread : bool
        Whether nobody reads the error messages of the run.
    flows_on : bool
        Whether the current continues although the output is off.
    out_of_reach : bool
        Whether no program can switch the coil off; the time limit is then that of a warning.
    not_said : str
        Regular expression that no message may match; empty for none.
    """

    name: str
    driver: str
    transport: str
    act: Callable[[Trial], float]
    said: str
    off_within_s: float
    unread: bool = False
    flows_on: bool = False
    out_of_reach: bool = False
    not_said: str = ""


def _silent_for(trial: Trial, seconds: float, then: Callable[[], object]) -> float:
    trial.supply.tell("silence")
    time.sleep(0.1)
    then()
    time.sleep(seconds)
    trial.supply.tell("none")
    return time.monotonic()


def _cut(trial: Trial, number: signal.Signals) -> float:
    trial.supply.tell("drop")
    time.sleep(0.05)
    return trial.send(number)


def _slow(trial: Trial) -> float:
    trial.supply.tell("slow")
    time.sleep(0.5)
    return trial.send(signal.SIGTERM)


def _refused_then_stopped(trial: Trial) -> float:
    trial.send(signal.SIGTSTP)
    wait_until(lambda: any("Ctrl-Z" in line for line in trial.lines), "no word of Ctrl-Z")
    return trial.send(signal.SIGINT)


def _second_run(trial: Trial) -> float:
    stored = trial.acknowledged()
    second = trial.start("second.h5")
    assert second.stderr is not None
    for line in second.stderr:
        trial.hear(f"second: {line}")
    trial.hear(f"second: status {second.wait(60)}")
    wait_until(lambda: trial.acknowledged() > stored, "the first run did not go on")
    return trial.send(signal.SIGTERM)


def _signal_guardian(trial: Trial, number: signal.Signals) -> float:
    os.kill(trial.guardian, number)
    return time.monotonic()


def _dead_computer(trial: Trial) -> float:
    for process in (trial.guardian, trial.process.pid):
        os.kill(process, signal.SIGKILL)
    return time.monotonic()


def _stopped_together(trial: Trial, seconds: float) -> float:
    for number in (signal.SIGSTOP, signal.SIGCONT):
        for process in (trial.process.pid, trial.guardian):
            os.kill(process, number)
        if number == signal.SIGSTOP:
            time.sleep(seconds)
    return time.monotonic()


def _spoilt_then_sent(trial: Trial, fault: str, number: signal.Signals) -> float:
    trial.supply.tell(fault)
    time.sleep(0.1)
    return trial.send(number)


def _spoilt(trial: Trial, fault: str) -> float:
    began = time.monotonic()
    trial.supply.tell(fault)
    return began


def _asleep(trial: Trial) -> float:
    trial.supply.tell("sleep")
    return time.monotonic() + SLEEPS_FOR_S


def _step_clock(trial: Trial) -> float:
    return _silent_for(trial, 3.0, lambda: trial.spoil("clock"))


STOPPED = "stopped by SIG"
MAY_BE_ON = r"MAY STILL BE ON: 0\.800 A measured"
OFF_TARGET = r"A measured at a set-point of 1\.5 A"
LINES = (("korad", "pty"), ("scpi", "tcp"), ("scpi", "hislip"))
"""Driver and transport of three lines: a serial line, a socket and HiSLIP."""

ALL_LINES = (*LINES, ("keysight-n6700", "tcp"), ("genesys", "pty"))
"""`LINES`, a line to a supply with a watchdog, and a line to a supply with a serial number and an address."""


def _line(driver: str, transport: str) -> str:
    """Return the connection and, if needed, the driver of a supply as text, such as "tcp keysight-n6700"."""
    return transport if (driver, transport) in LINES else f"{transport} {driver}"


ON = "MAY STILL BE ON"
CUT = (("korad", "port"), ("genesys", "port"), ("scpi", "tcp"), ("keysight-n6700", "tcp"), ("scpi", "hislip"))
"""Lines that can be cut. The supplies on the second and on the fourth line have a serial number."""

TOOK_OVER = "stood still for more than 5 s.*switched off"
DIED = "the run died; .*: the coil was switched off"
DIED_OR_UNIDENTIFIED = f"{DIED}|{UNIDENTIFIED}"
FAULTS = (
    *(
        Fault(f"{number.name} {transport} {driver}", driver, transport, lambda t, n=number: t.send(n), said, within)
        for driver, transport in (("korad", "pty"), ("genesys", "pty"), ("scpi", "pty"), ("scpi", "tcp"))
        for number, said, within in (
            (signal.SIGINT, STOPPED, 4.0),
            (signal.SIGTERM, STOPPED, 4.0),
            (signal.SIGHUP, STOPPED, 4.0),
            (signal.SIGKILL, DIED, 3.0),
            (signal.SIGSTOP, TOOK_OVER, 9.0),
        )
    ),
    *(
        Fault(
            f"shorted regulator, {number.name} {transport}",
            driver,
            transport,
            lambda t, n=number: _spoilt_then_sent(t, "shorted", n),
            MAY_BE_ON,
            6.0,
            flows_on=True,
        )
        for driver, transport in LINES
        for number in (signal.SIGTERM, signal.SIGKILL)
    ),
    *(
        Fault(
            f"{fault} {transport}",
            driver,
            transport,
            lambda t, f=fault: _spoilt(t, f),
            OFF_TARGET,
            3.0,
        )
        for driver, transport in LINES
        for fault in ("drift", "fallen")
    ),
    *(
        Fault(
            f"contact that opens an interlock, {transport}",
            driver,
            transport,
            lambda t: _spoilt(t, "contact"),
            r"interlock coil_voltage_V: 15\S* measured, above maximum = 12",
            3.0,
        )
        for driver, transport in LINES
    ),
    *(
        Fault(
            f"run and guardian stopped for 12 s, {transport}",
            driver,
            transport,
            lambda t: _stopped_together(t, 12.0),
            "stood still for",
            3.0,
        )
        for driver, transport in LINES
    ),
    *(
        Fault(
            f"{fault} {transport} {driver}",
            driver,
            transport,
            lambda t, f=fault: _spoilt(t, f),
            ON,
            3.0,
            out_of_reach=True,
        )
        for driver, transport in CUT
        for fault in ("swap", "reenumerate", "disconnect")
    ),
    *(
        Fault(
            f"{fault}, SIGKILL {transport} {driver}",
            driver,
            transport,
            lambda t, f=fault: _spoilt_then_sent(t, f, signal.SIGKILL),
            ON,
            3.0,
            out_of_reach=True,
        )
        for driver, transport in CUT
        for fault in ("swap", "disconnect")
    ),
    *(
        Fault(f"sleep {_line(driver, transport)}", driver, transport, _asleep, ON, 3.0)
        for driver, transport in ALL_LINES
    ),
    *(
        Fault(
            f"brownout {_line(driver, transport)}",
            driver,
            transport,
            lambda t: _spoilt(t, "brownout"),
            f"this run did not switch it off|a person switched the output off|{OFF_TARGET}|no complete answer within",
            3.0,
        )
        for driver, transport in ALL_LINES
    ),
    *(
        Fault(
            f"offset, {number.name} {_line(driver, transport)}",
            driver,
            transport,
            lambda t, n=number: _spoilt_then_sent(t, "offset", n),
            r"the coil (is|was switched) off, below 0\.(02|15) A measured",
            within,
            not_said=ON,
        )
        for driver, transport in ALL_LINES
        for number, within in ((signal.SIGTERM, 4.0), (signal.SIGKILL, 3.0))
    ),
    *(
        Fault(
            f"locked, {number.name} {_line(driver, transport)}",
            driver,
            transport,
            lambda t, n=number: _spoilt_then_sent(t, "locked", n),
            ON,
            3.0,
            out_of_reach=True,
        )
        for driver, transport in ALL_LINES
        for number in (signal.SIGTERM, signal.SIGKILL)
    ),
    Fault("two Ctrl-C", "korad", "pty", lambda t: t.send(signal.SIGINT, signal.SIGINT, pause_s=0.1), STOPPED, 2.5),
    Fault("Ctrl-Z", "scpi", "tcp", _refused_then_stopped, "Ctrl-Z is refused", 4.0),
    Fault("grab never returns", "korad", "pty", lambda t: t.spoil("grab"), "did not return from grab", 10.0),
    Fault("flush never returns", "scpi", "tcp", lambda t: t.spoil("flush"), "did not return from flush", 10.0),
    Fault("grab keeps Python's lock", "korad", "pty", lambda t: t.spoil("grab-locked"), TOOK_OVER, 9.0),
    Fault(
        "grab never returns, Ctrl-C",
        "scpi",
        "tcp",
        lambda t: (t.spoil("grab"), t.send(signal.SIGINT))[1],
        STOPPED,
        4.0,
    ),
    Fault("close never returns", "scpi", "tcp", lambda t: (t.spoil("close"), t.send(signal.SIGINT))[1], STOPPED, 4.0),
    Fault("stderr unread", "korad", "pty", lambda t: t.send(signal.SIGTERM), "", 4.0, unread=True),
    Fault("stderr unread, killed", "scpi", "tcp", lambda t: t.send(signal.SIGKILL), "", 3.0, unread=True),
    Fault(
        "guardian killed", "korad", "pty", lambda t: _signal_guardian(t, signal.SIGKILL), "guardian process ended", 6.0
    ),
    Fault("guardian stopped", "scpi", "tcp", lambda t: _signal_guardian(t, signal.SIGSTOP), "does not answer", 6.0),
    Fault("line cut, stopped", "scpi", "tcp", lambda t: _cut(t, signal.SIGTERM), "", 6.0),
    Fault("line cut, killed", "scpi", "tcp", lambda t: _cut(t, signal.SIGKILL), DIED_OR_UNIDENTIFIED, 6.0),
    Fault("line cut, stopped, HiSLIP", "scpi", "hislip", lambda t: _cut(t, signal.SIGTERM), "", 6.0),
    Fault("line cut, killed, HiSLIP", "scpi", "hislip", lambda t: _cut(t, signal.SIGKILL), DIED_OR_UNIDENTIFIED, 6.0),
    Fault(
        "silent for 3 s, killed",
        "korad",
        "pty",
        lambda t: _silent_for(t, 3.0, lambda: t.send(signal.SIGKILL)),
        DIED,
        5.0,
    ),
    Fault("silent for 15 s", "scpi", "tcp", lambda t: _silent_for(t, 15.0, lambda: None), "", 6.0),
    Fault("clock steps back, silent for 3 s", "scpi", "tcp", _step_clock, "", 6.0),
    Fault("slow supply", "korad", "pty", _slow, STOPPED, 8.0),
    Fault("cable pulled", "keysight-n6700", "tcp", lambda t: _spoilt(t, "silence"), "MAY STILL BE ON", 13.0),
    Fault(
        "computer dead",
        "keysight-n6700",
        "tcp",
        _dead_computer,
        "killed together: the supply's own watchdog switches every output off",
        13.0,
    ),
    Fault("second acquire", "scpi", "pty", _second_run, "second: status 1", 4.0),
    Fault("second acquire, TCP", "scpi", "tcp", _second_run, "another run uses this supply.*second: status 1", 4.0),
    Fault("second acquire, Korad", "korad", "pty", _second_run, "second: status 1", 4.0),
)

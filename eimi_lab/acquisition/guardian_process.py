"""Run the guardian process: wait until the run dies or stands still, and then switch the coil off."""

from __future__ import annotations

import json
import logging
import os
import signal
import sys
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from eimi_drivers.clock import WallClock
from eimi_drivers.interfaces import AnotherSupply, InstrumentError, Off, PowerSupply, SwitchOffFailed
from eimi_drivers.supplies.address import pseudo_terminal
from eimi_drivers.supplies.off import measured_off, off_limit_A, switch_off
from eimi_drivers.supplies.supply_names import open_supply
from eimi_drivers.supplies.transport import share_ports
from eimi_drivers.supplies.visa import load_visa
from eimi_lab.acquisition.added_driver import unpack
from eimi_lab.acquisition.doubt import doubted_after
from eimi_lab.acquisition.event_lines import sending_events
from eimi_lab.acquisition.event_words import in_words
from eimi_lab.acquisition.events import (
    EmulatedSupplyGone,
    Event,
    GuardianTookOver,
    OffNotConfirmed,
    OnEvent,
    RunKilled,
    Takeover,
    Warned,
    off_confirmed,
)
from eimi_lab.acquisition.guardian import (
    ALLOW,
    ARM,
    BEAT,
    DISARM,
    HERE,
    READY,
    RECOGNISED,
    SILENT_FOR_S,
    STILL_FOR_S,
    SUPPLY,
    TAKE_OVER,
    TAKING_OVER,
    Ward,
)
from eimi_lab.process.console import when_closed
from eimi_lab.process.detached import Starter, be_shut_down_last, ended_with_others
from eimi_lab.process.log import VARIABLE, log_to_stderr
from eimi_lab.process.pipes import never_wait_to_write, readable, received
from eimi_lab.process.scope import move_to_own_scope
from eimi_lab.process.stderr import never_blocking

_log = logging.getLogger("eimi_lab.acquisition.guardian_process")  # the process runs this module as __main__

TRY_FOR_S = 3600.0  # time for a person to reconnect a cable or to come to the bench
TRY_AGAIN_AFTER_S, TRY_AGAIN_LATER_S = 0.1, 1.0
REPORT_EVERY_S = 60.0
DOUBTED_AFTER_S = 2.0
ENDED_WITH_OTHERS = (
    "if the program that started eimi ends all its processes at once, it also ends the guardian process, and nobody "
    "switches the coil off (the guardian process is in a job object of Windows); start eimi from a terminal of "
    "Windows"
)
FROM_RUN, TO_RUN = 0, 1

DIED: Takeover = "run_died"
STANDS_STILL: Takeover = "run_stood_still"
ASKED: Takeover = "run_could_not_switch_off"


def stand_guard(ward: Ward, on_event: OnEvent) -> None:
    """Wait until the run ends or takes no step for too long, and switch the coil off if it may still be on.

    Parameters
    ----------
    ward : Ward
        The supply of the coil.
    on_event : OnEvent
        Receives the events (records of what happened).
    """
    for name in ("SIGINT", "SIGHUP", "SIGTERM", "SIGPIPE", "SIGBREAK"):  # the guardian must not end before the run
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    when_closed(_stay)
    be_shut_down_last()
    if ended_with_others():
        on_event(Warned(message=ENDED_WITH_OTHERS))
    run = Starter()
    never_wait_to_write(TO_RUN)
    load_visa(ward.address)
    scoped = move_to_own_scope("eimi-guardian", f"switches the supply at {ward.address} off if its run dies")
    _log.info("the guardian process runs in a systemd scope of its own: %s", scoped)
    _say(READY)
    takeover, ward = _wait_until_needed(ward)
    if takeover:
        if takeover == STANDS_STILL:
            share_ports()  # the run, which stands still, holds the locks of the ports
            _say(TAKING_OVER)
        on_event(GuardianTookOver(takeover=takeover, address=ward.address))
        doubt = OffNotConfirmed(
            by="guardian",
            reason=f"the supply did not confirm within {DOUBTED_AFTER_S:g} s that its output is off",
            takeover=takeover,
            trying_process=os.getpid(),
        )
        # A run that asked the guardian to switch off has already reported that the coil may be on.
        with doubted_after(DOUBTED_AFTER_S, None if takeover == ASKED else doubt, on_event):
            switch_off_for_the_run(ward, takeover, run, on_event)


def _wait_until_needed(ward: Ward) -> tuple[Takeover | None, Ward]:
    """Wait until the run ends, takes no step for too long, or asks the guardian process to switch the coil off.

    Returns the reason for switching off (None if the coil is off), and the supply of the run.
    """
    armed, patience_s, heard_s, unfinished = False, STILL_FOR_S, time.monotonic(), b""
    while True:
        if readable(FROM_RUN, SILENT_FOR_S / 4):
            data = os.read(FROM_RUN, 4096)
            if not data:
                return DIED if armed else None, ward
            heard_s = time.monotonic()
            *messages, unfinished = (unfinished + data).split(b"\n")
            for message in messages:
                patience_s = STILL_FOR_S
                if message in {ARM, DISARM}:
                    armed = message == ARM
                    _log.info("armed" if armed else "disarmed")
                elif message == TAKE_OVER:
                    return ASKED, ward
                elif message.startswith(SUPPLY):
                    text, serial_number = json.loads(message.removeprefix(SUPPLY))
                    ward = replace(ward, identity=(text, serial_number))
                elif message == RECOGNISED:
                    ward = replace(ward, recognised=True)
                elif message.startswith(ALLOW):
                    patience_s = float(message.removeprefix(ALLOW))
                else:
                    assert message == BEAT
        elif armed and time.monotonic() - heard_s > patience_s:
            return STANDS_STILL, ward
        _say(HERE)


def switch_off_for_the_run(ward: Ward, takeover: Takeover, run: Starter, on_event: OnEvent) -> None:
    """Try to switch the supply off until the coil is off or a time limit has passed.

    A run that stands still is killed after a failed attempt, because it may occupy the supply.

    Parameters
    ----------
    ward : Ward
        The supply of the coil.
    takeover : str
        Reason for switching off.
    run : Starter
        The process of the run.
    on_event : OnEvent
        Receives the result and reports about failed attempts.
    """
    began = time.monotonic()
    reported_s = began - REPORT_EVERY_S + DOUBTED_AFTER_S
    pause_s = TRY_AGAIN_AFTER_S
    killed = False
    was_on = {True} if ward.recognised else set()
    while True:
        try:
            off, remark = _try_once(ward, was_on)
        except Exception as error:  # an error in a library must not leave the coil on
            measured_A = error.current_A if isinstance(error, SwitchOffFailed) else None
            limit_A = error.limit_A if isinstance(error, SwitchOffFailed) else None
            why = " ".join((str(error) if measured_A is not None else f"{type(error).__name__}: {error}").split())
            _log.info("switching off failed: %s", why)
        else:
            on_event(off_confirmed(off, "guardian", takeover, killed, ward.address, remark))
            return
        emulated = pseudo_terminal(ward.address)
        if emulated and not Path(emulated).exists():
            on_event(EmulatedSupplyGone(takeover=takeover, address=ward.address))
            return
        if takeover == STANDS_STILL and not killed and measured_A is None and run.runs():
            on_event(RunKilled(address=ward.address, reason=why))
            run.kill()
            killed = True
            continue
        not_off = OffNotConfirmed(
            by="guardian",
            reason=why,
            current_A=measured_A,
            limit_A=limit_A,
            takeover=takeover,
            run_killed=killed,
            trying_process=os.getpid(),
        )
        if time.monotonic() - began > TRY_FOR_S:
            on_event(replace(not_off, trying_process=None))
            return
        if time.monotonic() - reported_s > REPORT_EVERY_S:
            reported_s = time.monotonic()
            on_event(not_off)
        time.sleep(pause_s)
        pause_s = min(2 * pause_s, TRY_AGAIN_LATER_S)


def _try_once(ward: Ward, was_on: set[bool]) -> tuple[Off | None, str]:
    """Switch the supply off, and return its measured current and a text about harmless failures.

    Raises an error if the supply was not confirmed off, or may not be the supply of the coil. `was_on` contains True
    after an attempt found the output on.
    """
    clock, remark = WallClock(), ""
    supply = open_supply(ward.driver, ward.address, ward.limits, clock)
    try:
        unidentified = _compare(ward, supply)
        found_off = ward.identity is not None and _find_off(supply, was_on)
        try:
            # No ramp: it would begin at the measured current, which may be twice the set-point during a fault.
            off = switch_off(supply, clock)
        except SwitchOffFailed as error:
            if error.current_A is not None:  # a current flows: this is the supply of the coil
                was_on.add(True)
            if error.current_A is not None or found_off or not _is_known_by_identity(ward) or supply.output_on():
                raise
            off = measured_off(supply.measure, off_limit_A(supply), clock, ward.address)
            unidentified = _compare(ward, supply)  # the line may have been reopened
            remark = f"; one step of switching the supply off failed ({error})"
        measured = f", {off.current_A:.2f} A measured" if off else ""
        if unidentified:
            raise SwitchOffFailed(
                f"{ward.address}: a supply was switched off{measured}, but it did not answer with its identity, so "
                f"it is perhaps not the supply of the coil ({unidentified})"
            )
        if not was_on and not _is_known_by_identity(ward):
            observed = "already off" if found_off else "never seen to be on"
            raise SwitchOffFailed(
                f"{ward.address}: the output of the supply was {observed}{measured}, but the supply has no "
                "serial number, so that it is perhaps not the supply of the coil"
            )
        return (replace(off, found_off=found_off) if off else off), remark
    finally:
        with suppress(Exception):
            supply.close()


def _compare(ward: Ward, supply: PowerSupply) -> str:
    """Return the error with which the supply failed to identify itself, in words; empty if its identity is right.

    The result is also empty if the run never sent an identity to the guardian. Raises AnotherSupply if the supply
    gave another identity.
    """
    if ward.identity is None:
        return ""
    try:
        answered = supply.identify()
    except AnotherSupply:
        raise
    except InstrumentError as error:
        return str(error)
    if (answered.text, answered.serial_number) != ward.identity:
        raise AnotherSupply(
            f"{ward.address}: another supply answers: {answered.text!r} {answered.serial_number} instead of "
            f"{' '.join(ward.identity)!r}, the supply of the run"
        )
    return ""


def _find_off(supply: PowerSupply, was_on: set[bool]) -> bool:
    # Return whether the output is off and has never been found on.
    # `was_on` remembers whether the output was found on: it is empty, or contains True.
    with suppress(InstrumentError):
        if supply.output_on():
            was_on.add(True)
        return not was_on
    return False


def _is_known_by_identity(ward: Ward) -> bool:
    # Return whether the identity of a supply is enough to recognise the supply of the coil. It is not enough without a
    # serial number, because another supply of the same model has the same identity.
    return ward.identity is None or bool(ward.identity[1]) or pseudo_terminal(ward.address) != ""


def _stay() -> None:
    """Do nothing when Windows closes the console or logs the user off."""


def _say(message: bytes) -> None:
    with suppress(OSError):  # the run has ended or does not read the pipe
        os.write(TO_RUN, message)


def _print(event: Event) -> None:
    """Print the sentence for an event on standard error."""
    if not isinstance(event, GuardianTookOver):
        with suppress(OSError):  # the terminal may be gone with the run
            print(f"eimi guardian: {in_words(event)}", file=sys.stderr)


def main(ward: str, events: str | None = None) -> None:
    """Run the guardian process, which switches the coil off if the run dies or takes no step for too long.

    Parameters
    ----------
    ward : str
        The fields of a `Ward` (driver, address and limits of the supply) as JSON.
    events : str or None
        Text that names the file descriptor for the events; None writes no events.
    """
    with never_blocking(), sending_events(_print, None if events is None else received(events)) as on_event:
        log_to_stderr(os.environ.get(VARIABLE, ""))
        guarded = Ward(**json.loads(ward))
        unpack(guarded.driver, guarded.packed)
        stand_guard(guarded, on_event)


if __name__ == "__main__":
    main(*sys.argv[1:])

"""The guardian process itself: it waits for the end or the standstill of the run, and then switches off.

Until then it touches no port. What it needs it has imported before it says that it is ready, and the run switches the
output on only after that.
"""

from __future__ import annotations

import json
import logging
import os
import re
import select
import signal
import sys
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from eimi_drivers.interfaces import Limits, PowerSupply, SwitchOffFailed
from eimi_drivers.supplies.supply_names import open_supply
from eimi_drivers.supplies.transport import share_ports
from eimi_lab.acquisition.added_driver import unpack
from eimi_lab.acquisition.event_lines import heard_by
from eimi_lab.acquisition.event_words import in_words
from eimi_lab.acquisition.events import (
    EmulatedSupplyGone,
    Event,
    GuardianTookOver,
    OffConfirmed,
    OffNotConfirmed,
    OnEvent,
    RunKilled,
    Takeover,
)
from eimi_lab.acquisition.guardian import (
    ALLOW,
    ARM,
    BEAT,
    DISARM,
    HERE,
    READY,
    SILENT_FOR_S,
    STILL_FOR_S,
    TAKE_OVER,
    TAKING_OVER,
    Ward,
)
from eimi_lab.process.log import VARIABLE, log_to_stderr
from eimi_lab.process.stderr import never_blocking

_log = logging.getLogger("eimi_lab.acquisition.guardian_process")  # the process runs this module as __main__

TRY_FOR_S = 3600.0  # a cable may be put back; a person who was told will have come by then
TRY_AGAIN_AFTER_S, TRY_AGAIN_LATER_S = 0.1, 1.0
TELL_EVERY_S = 60.0
FROM_RUN, TO_RUN = 0, 1

DIED: Takeover = "run_died"
STANDS_STILL: Takeover = "run_stood_still"
ASKED: Takeover = "run_could_not_switch_off"


def stand_guard(ward: Ward, on_event: OnEvent) -> None:
    """Wait until it is needed, if ever, and switch off."""
    for name in ("SIGINT", "SIGHUP", "SIGTERM", "SIGPIPE"):  # it ends when the run does, no sooner
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    run = os.getppid()
    os.set_blocking(TO_RUN, False)
    _say(READY)
    if takeover := _wait_until_needed():
        if takeover == STANDS_STILL:
            share_ports()  # the run has them locked
            _say(TAKING_OVER)
        on_event(GuardianTookOver(takeover=takeover, address=ward.address))
        switch_off(ward, takeover, run, on_event)


def _wait_until_needed() -> Takeover | None:
    """Return why the coil has to be switched off; None where the run ended well."""
    armed, patience_s, heard_s, unfinished = False, STILL_FOR_S, time.monotonic(), b""
    while True:
        if select.select([FROM_RUN], [], [], SILENT_FOR_S / 4)[0]:
            data = os.read(FROM_RUN, 4096)
            if not data:
                return DIED if armed else None
            heard_s = time.monotonic()
            *messages, unfinished = (unfinished + data).split(b"\n")
            for message in messages:
                patience_s = STILL_FOR_S
                if message in {ARM, DISARM}:
                    armed = message == ARM
                    _log.info("armed" if armed else "disarmed")
                elif message == TAKE_OVER:
                    return ASKED
                elif message.startswith(ALLOW):
                    patience_s = float(message.removeprefix(ALLOW))
                else:
                    assert message == BEAT
        elif armed and time.monotonic() - heard_s > patience_s:
            return STANDS_STILL
        _say(HERE)


def switch_off(ward: Ward, takeover: Takeover, run: int, on_event: OnEvent) -> None:
    """Ramp down, zero, off, verify, again and again until the supply says that it is off.

    A run that stands still keeps its connection, and some supplies serve one at a time: where the first attempt fails,
    that process, `run`, is ended.
    """
    began = time.monotonic()
    told_s = began - TELL_EVERY_S + 2.0
    pause_s = TRY_AGAIN_AFTER_S
    killed = False
    while True:
        try:
            remark = _try_once(ward)
        except Exception as error:  # a library's mistake must not leave the coil on
            why = " ".join(f"{type(error).__name__}: {error}".split())
            _log.info("switching off failed: %s", why)
        else:
            on_event(
                OffConfirmed(
                    by="guardian",
                    determined_by="commanded",
                    takeover=takeover,
                    run_killed=killed,
                    address=ward.address,
                    remark=remark,
                )
            )
            return
        emulated = re.search(r"/dev/pts/\d+", ward.address)
        if emulated and not Path(emulated[0]).exists():
            on_event(EmulatedSupplyGone(takeover=takeover, address=ward.address))
            return
        if takeover == STANDS_STILL and not killed and os.getppid() == run:
            on_event(RunKilled(address=ward.address, reason=why))
            with suppress(ProcessLookupError):
                os.kill(run, signal.SIGKILL)
            killed = True
            continue
        not_off = OffNotConfirmed(
            by="guardian", reason=why, takeover=takeover, run_killed=killed, trying_process=os.getpid()
        )
        if time.monotonic() - began > TRY_FOR_S:
            on_event(replace(not_off, trying_process=None))
            return
        if time.monotonic() - told_s > TELL_EVERY_S:
            told_s = time.monotonic()
            on_event(not_off)
        time.sleep(pause_s)
        pause_s = min(2 * pause_s, TRY_AGAIN_LATER_S)


def _try_once(ward: Ward) -> str:
    """Open, half way toward zero, off, close; why there was no ramp, in words.

    Raises whatever went wrong before the supply said that it is off.
    """
    supply = open_supply(ward.driver, ward.address, Limits(ward.current_A, ward.voltage_V))
    try:
        without_ramp = _ramp_down(supply)
        try:
            supply.safe_off()
        except SwitchOffFailed as error:
            if supply.output_on():
                raise
            return f", and says so; not every stage went well ({error})"
        return without_ramp
    finally:
        with suppress(Exception):
            supply.close()


def _ramp_down(supply: PowerSupply) -> str:
    """Half way toward zero. The beam's swing no longer matters and time does: the supply is spared half the leap."""
    try:
        supply.set_current(supply.measure().current_A / 2)
    except Exception as error:  # as above; the stages that follow matter more
        return f", straight to zero ({' '.join(str(error).split())})"
    return ""


def _say(message: bytes) -> None:
    with suppress(OSError):  # the run is gone, or does not listen
        os.write(TO_RUN, message)


def _tell(event: Event) -> None:
    """Say on standard error what came of it."""
    if not isinstance(event, GuardianTookOver):
        with suppress(OSError):  # the terminal may be gone with the run
            print(f"eimi guardian: {in_words(event)}", file=sys.stderr, flush=True)


def main(ward: str, events: str | None = None) -> None:
    """Stand guard over a supply, given as JSON. events: the number of a descriptor that somebody may read."""
    with never_blocking(), heard_by(_tell, None if events is None else int(events)) as on_event:
        log_to_stderr(os.environ.get(VARIABLE, ""))
        guarded = Ward(**json.loads(ward))
        unpack(guarded.driver, guarded.packed)
        stand_guard(guarded, on_event)


if __name__ == "__main__":
    main(*sys.argv[1:])

"""The messages of a run are recorded in a transcript, and a driver can be tested with this transcript."""

from __future__ import annotations

import errno
import os
from io import StringIO
from pathlib import Path

import pytest

from eimi_drivers.clock import SimulatedClock, WallClock
from eimi_drivers.emulators import DIALECTS, CoilSupply, emulate, serve_tcp
from eimi_drivers.emulators.faults import Fault, FaultyInstrument
from eimi_drivers.interfaces import InstrumentError, InstrumentTimeout, Limits, PowerSupply, Reading
from eimi_drivers.supplies import SUPPLIES, open_supply
from eimi_drivers.supplies.transcript import (
    RecordingTransport,
    ReplayedTransport,
    TranscriptMismatch,
    escaped,
    unescaped,
)
from eimi_drivers.supplies.transport import InProcessTransport

LIMITS = Limits(1.0, 12.0)


def run(supply: PowerSupply) -> Reading:
    supply.identify()
    supply.set_voltage(12.0)
    supply.set_current(0.7)
    supply.set_output(True)
    reading = supply.measure()
    supply.check()
    supply.safe_off()
    return reading


def replayed(driver: str, file: Path) -> tuple[PowerSupply, ReplayedTransport]:
    link = ReplayedTransport(file)
    return SUPPLIES[driver](link, LIMITS, SimulatedClock()), link


@pytest.mark.parametrize("driver", DIALECTS)
def test_a_driver_repeats_its_transcript(driver: str, tmp_path: Path) -> None:
    clock, file = SimulatedClock(), tmp_path / "wire.txt"
    link = InProcessTransport(emulate(driver, CoilSupply(clock)), clock, "in-process")
    supply = SUPPLIES[driver](RecordingTransport(link, file, clock), LIMITS, clock)
    reading = run(supply)
    supply.close()
    again, wire = replayed(driver, file)
    assert run(again) == reading
    wire.assert_complete()
    assert len(file.read_text().splitlines()) > 20


def test_a_message_that_differs_from_the_transcript_is_reported(tmp_path: Path) -> None:
    file = tmp_path / "wire.txt"
    file.write_text('0.000000 open somewhere\n0.1 > CURR 0.700\\n\n0.2 > SYST:ERR?\\n\n0.3 < 0,"No error"\\n\n')
    supply, wire = replayed("scpi", file)
    with pytest.raises(TranscriptMismatch, match=r"sent CURR 0\.600.*line 2 of the transcript is: > CURR 0\.700"):
        supply.set_current(0.6)
    with pytest.raises(TranscriptMismatch, match="3 events did not happen, the first of which is in line 2"):
        wire.assert_complete()
    with pytest.raises(TranscriptMismatch, match=r"sent CURR\?.* after the end"):
        supply.set_current(0.7)


def test_faults_of_the_line_are_played_back(tmp_path: Path) -> None:
    clock, file = SimulatedClock(), tmp_path / "wire.txt"
    line = FaultyInstrument(emulate("scpi", CoilSupply(clock)))
    supply = SUPPLIES["scpi"](RecordingTransport(InProcessTransport(line, clock, "here"), file, clock), LIMITS, clock)
    line.inject(Fault.SILENCE, lambda message: message == b"MEAS:CURR?\n")
    with pytest.raises(InstrumentTimeout):
        supply.measure()
    supply.close()
    again, wire = replayed("scpi", file)
    with pytest.raises(InstrumentTimeout, match="here: no complete answer within 1 s"):
        again.measure()
    wire.assert_complete()
    assert "1.000000 <! InstrumentTimeout here: no complete answer" in file.read_text()


class FullDisk(StringIO):
    # A file on a disk that has no space left.

    def write(self, text: str) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_full_disk_ends_the_recording_but_not_the_messages(tmp_path: Path) -> None:
    clock, file, coil = SimulatedClock(), tmp_path / "wire.txt", CoilSupply(SimulatedClock())
    link = RecordingTransport(InProcessTransport(emulate("scpi", coil), clock), file, clock)
    supply = SUPPLIES["scpi"](link, LIMITS, clock)
    supply.set_current(0.7)
    recorded = file.read_text()
    link._file.close()
    link._file = FullDisk()  # type: ignore[assignment]
    supply.set_output(True)
    assert coil.state.output
    supply.safe_off()
    assert not coil.state.output
    assert link.reopen() is False
    with pytest.raises(InstrumentError, match=r"wire\.txt: later messages are not recorded: No space left on device$"):
        supply.close()
    supply.close()
    assert file.read_text() == recorded


def test_a_transcript_on_a_full_disk_is_refused_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = SimulatedClock()
    link = InProcessTransport(emulate("scpi", CoilSupply(clock)), clock)
    monkeypatch.setattr(Path, "open", lambda *arguments, **options: FullDisk())
    with pytest.raises(OSError, match="No space left"):
        RecordingTransport(link, tmp_path / "wire.txt", clock)


def test_escaping_preserves_all_bytes() -> None:
    raw = bytes(range(256)) + b"\\n \\x00"
    assert unescaped(escaped(raw)) == raw
    assert escaped(raw).isascii()
    assert "\n" not in escaped(raw)


def test_the_messages_on_a_real_port_are_recorded(tmp_path: Path) -> None:
    file = tmp_path / "wire.txt"
    with serve_tcp(emulate("scpi", CoilSupply(WallClock()))) as address:
        supply = open_supply("scpi", address, LIMITS, transcript=file)
        supply.identify()
        supply.close()
        with pytest.raises(FileExistsError):
            open_supply("scpi", address, LIMITS, transcript=file)
    lines = file.read_text().splitlines()
    assert lines[0].endswith(f" open {address}")
    assert [line.split(" ", 1)[1] for line in lines[1:]] == ["> *IDN?\\n", "< EIMI,EMULATED SUPPLY,0,1.0\\n"]

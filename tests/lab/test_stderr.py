"""If nobody reads standard error, the program does not wait, and a late reader gets all messages."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

from eimi_lab.process.stderr import NeverBlocking
from tests.patience import PATIENCE_S


def test_writing_to_a_full_pipe_returns_at_once_and_the_reader_gets_everything_later() -> None:
    reads, writes = os.pipe()
    stream = NeverBlocking(writes)
    lines = [f"line {number} {'.' * 80}\n" for number in range(2000)]  # more than twice the capacity of a pipe
    for line in lines:
        stream.write(line)
    received = bytearray()
    while len(received) < sum(map(len, lines)):
        received += os.read(reads, 65536)
        stream.flush()
    assert received.decode() == "".join(lines)
    assert os.get_blocking(writes)  # the descriptor that other programs share is unchanged
    for end in (reads, writes):
        os.close(end)


def test_excess_lines_are_dropped_and_counted() -> None:
    reads, writes = os.pipe()
    stream = NeverBlocking(writes)
    for number in range(20_000):
        stream.write(f"line {number} {'.' * 80}\n")
    received = bytearray()
    while b"line 19999 " not in received or not received.endswith(b"\n"):
        received += os.read(reads, 65536)
        stream.flush()
    text = received.decode().splitlines()
    dropped = [int(line.split()[1]) for line in text if "were dropped: nobody read them" in line]
    assert len([line for line in text if line.startswith("line ")]) + dropped[-1] == 20_000
    for end in (reads, writes):
        os.close(end)


def test_a_closed_pipe_is_not_an_error() -> None:
    reads, writes = os.pipe()
    os.close(reads)
    stream = NeverBlocking(writes)
    stream.write("nobody hears this\n")
    stream.finish()
    os.close(writes)


@pytest.mark.skipif(sys.platform == "win32", reason="has no timers that send signals")
def test_a_signal_that_raises_within_a_write_sends_no_line_twice() -> None:
    class Interrupted(Exception):
        pass

    def interrupt(number: int, frame: object) -> None:
        raise Interrupted

    reads, writes = os.pipe()
    os.set_blocking(reads, False)
    stream = NeverBlocking(writes)
    received = bytearray()
    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        for number in range(2000):
            with suppress(Interrupted):
                signal.setitimer(
                    signal.ITIMER_REAL, (1 + number % 40) * 1e-6
                )  # the signal arrives before, within and after the write
                stream.write(f"{number}\n")
                time.sleep(1e-3)
                signal.setitimer(signal.ITIMER_REAL, 0)
            with suppress(BlockingIOError):
                received += os.read(reads, 65536)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    lines = received.decode().splitlines()
    assert len(lines) > 1000
    assert lines == sorted(set(lines), key=int)
    for end in (reads, writes):
        os.close(end)


def test_the_message_of_a_command_reaches_a_late_reader() -> None:
    command = [sys.executable, "-m", "eimi_lab", "acquire", "nothing.toml", "--specimen", "type1", "--rig", "virtual"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=PATIENCE_S)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "nothing.toml" in done.stderr


WORKING = """
import os
from eimi_lab import cli
from eimi_lab.process.progress import progress

def app(*arguments, **options):
    with open("dataset", "wb"), progress("work", 1) as report:
        report("done")
        os.write(2, b"what a library in C says")
    print("the result")

cli.app = app
cli.main()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="closes what a program is to begin without")
@pytest.mark.parametrize("closed", [(2,), (0, 1, 2)])
def test_a_program_started_without_standard_streams_works(tmp_path: Path, closed: tuple[int, ...]) -> None:
    done = subprocess.run(
        [sys.executable, "-c", WORKING],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        preexec_fn=lambda: [os.close(descriptor) for descriptor in closed],
        check=False,
        timeout=PATIENCE_S,
    )
    assert done.returncode == 0
    assert done.stdout == (b"" if 1 in closed else b"the result\n")
    assert (tmp_path / "dataset").read_bytes() == b""

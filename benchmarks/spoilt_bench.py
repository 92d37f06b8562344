"""Start a measurement at full current on an emulated supply, cause a fault, and time the switching off."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from benchmarks.kill_campaign import FILES, HEIGHT, PICTURES, WIDTH
from eimi_lab.config.protocol import load_protocol
from tests.shared.processes import WAIT_AT_MOST_S, alive, wait_until

UNIDENTIFIED = "it is perhaps not the supply of the coil"
"""Words of a guardian that switched a supply off but could not confirm the identity of the supply.

The guardian is the process that watches a run and switches the coil off if the run fails.
"""
TRIES_FOR_S = 15.0
"""Time (s) after these words within which the guardian must end. A trial then ends a guardian that still runs."""

SHIPPED = "dragon_skin_10"
FULL_A = 1.5
STATES = 8
NAMES = 6000


class LateAnswer(RuntimeError):
    """An answer of an instrument came too late on a busy computer, so that the run ended before the planned fault."""


class Supply:
    """An emulated supply in a separate process, which reports every change of output, set-point and current.

    `transport` is the connection: "pty" or "port" (serial port), "tcp" or "hislip".
    """

    def __init__(self, driver: str, transport: str) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.emulated_supply", driver, transport],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._process.stdout is not None
        self.driver, self.transport = driver, transport
        # Time (s), output, set-point (A) and true current (A) after each change.
        self.changes: list[tuple[float, bool, float, float]] = []
        self._listener = threading.Thread(target=self._listen, daemon=True)
        lines = [self._process.stdout.readline().strip() for _ in range(2)]  # the two lines come in any order
        self.address = next(line for line in lines if not re.match(r"\d+\.\d{4} ", line))
        if driver not in {"korad", "genesys"} and transport in {"pty", "port"}:
            self.address = f"ASRL{self.address}::INSTR"
        self._listener.start()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            at, on, set_A, true_A = line.split()
            self.changes.append((float(at), on == "1", float(set_A), float(true_A)))

    def tell(self, word: str) -> None:
        """Cause the fault with this name, or end the present fault with `none`."""
        assert self._process.stdin is not None
        print(word, file=self._process.stdin, flush=True)

    def on(self) -> bool:
        return bool(self.changes) and self.changes[-1][1]

    def at_full(self) -> bool:
        """Return whether the output is on and the set-point is the full current."""
        return self.on() and self.changes[-1][2] >= FULL_A - 1e-6

    def off_s(self) -> float:
        """Return the time (s, monotonic clock) at which the output was last switched off."""
        off_s = self.changes[-1][0]
        for at, on, _, _ in reversed(self.changes):
            if on:
                break
            off_s = at
        return off_s

    def true_A(self, at_s: float) -> float:
        """Return the true current (A) of the emulated supply at the time `at_s` (s, monotonic clock)."""
        return next((true_A for change_s, _, _, true_A in reversed(self.changes) if change_s <= at_s), 0.0)

    def close(self) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait(WAIT_AT_MOST_S)


@dataclass
class Trial:
    """One run on an emulated supply, and the messages of the run and of its guardian.

    The guardian is a process that switches the coil off if the run fails.

    Attributes
    ----------
    folder : Path
        Folder with the files of the bench.
    supply : Supply
        The emulated supply.
    unread : bool
        Whether nobody reads the error messages of the run.
    lines : list of str
        The messages.
    arrived_s : list of float
        Arrival time of each message, s on the monotonic clock.
    """

    folder: Path
    supply: Supply
    unread: bool = False
    lines: list[str] = field(default_factory=list)
    arrived_s: list[float] = field(default_factory=list)

    def begin(self) -> None:
        """Start the run, and wait until the full current is set.

        Raises LateAnswer or RuntimeError if the run ends before (see `require_running`).
        """
        self.process = self.start("run.h5", unread=self.unread)
        if not self.unread:
            self._reader = threading.Thread(target=self._read, daemon=True)
            self._reader.start()
        try:
            wait_until(lambda: self.supply.at_full() or self.process.poll() is not None, f"no current of {FULL_A} A")
        except RuntimeError as error:
            raise RuntimeError(f"{error}, and said {self.lines}") from error
        self.require_running()
        self.guardian = self._find_guardian()

    def require_running(self) -> None:
        """Raise an error if the run has ended: LateAnswer if an answer came too late, else RuntimeError."""
        if self.process.poll() is None:
            return
        if not self.unread:
            self._reader.join(WAIT_AT_MOST_S)
        late = ("no complete answer within", "does not answer any more")
        is_late = any(words in line for line in self.lines for words in late)
        kind = LateAnswer if is_late else RuntimeError
        raise kind(f"the run ended before the fault, and said {self.lines}")

    def start(self, output: str, unread: bool = False) -> subprocess.Popen[str]:
        """Start a run that writes the dataset `output`; return its process.

        If `unread` is true, nobody reads its error messages, so that they block the run.
        """
        at = f'driver = "{self.supply.driver}", address = "{self.supply.address}"'
        (self.folder / "rig.toml").write_text(f"""
name = "emulated"
calibration = "calibration.toml"
supply = {{ {at}, limits = {{ current_A = 1.6, voltage_V = 24 }} }}
camera = {{ driver = "opencv", source = "recording" }}

[[interlocks]]
reading = "coil_voltage_V"
maximum = 12.0
""")
        command = [sys.executable, "-m", "benchmarks.spoilt_run", "acquire", "protocol.toml", "--rig", "rig.toml"]
        here = os.pathsep.join([str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
        error_end: int = subprocess.PIPE
        if unread:
            self._pipe, error_end = os.pipe()
            os.set_blocking(error_end, False)
            try:
                while os.write(error_end, b"." * 4096):
                    pass
            except BlockingIOError:
                os.set_blocking(error_end, True)
        process = subprocess.Popen(
            [*command, "--specimen", "specimen.toml", "-o", output],
            cwd=self.folder,
            env=os.environ | {"PYTHONPATH": here},
            stdout=subprocess.DEVNULL,
            stderr=error_end,
            text=True,
        )
        if unread:
            os.close(error_end)
        return process

    def _read(self) -> None:
        assert self.process.stderr is not None
        for line in self.process.stderr:
            self.hear(line)

    def hear(self, line: str) -> None:
        self.arrived_s.append(time.monotonic())
        self.lines.append(line.rstrip())

    def wait_for_words(self, pattern: str, after_s: float) -> float:
        # Wait for a message that contains the pattern; return its time (s), or `after_s` if it came earlier.
        wait_until(lambda: any(re.search(pattern, line) for line in self.lines), f"no word of {pattern!r}")
        first = next(number for number, line in enumerate(self.lines) if re.search(pattern, line))
        return max(after_s, self.arrived_s[first])

    def end_guardian(self) -> None:
        """End the process that switches the coil off after a failed run, if it still runs."""
        if alive(self.guardian):
            os.kill(self.guardian, signal.SIGKILL)

    def _is_unidentified(self) -> bool:
        # Whether the guardian, the process that switches the coil off after a failed run, reported more than
        # `TRIES_FOR_S` s ago that it cannot identify the supply of the coil.
        reported_s = [at_s for line, at_s in zip(self.lines, self.arrived_s, strict=False) if UNIDENTIFIED in line]
        return bool(reported_s) and time.monotonic() - reported_s[0] > TRIES_FOR_S

    def send(self, *numbers: signal.Signals, pause_s: float = 0.0) -> float:
        """Send signals to the run, `pause_s` seconds apart; return the time (s) of the first signal."""
        began = time.monotonic()
        for number in numbers:
            self.process.send_signal(number)
            time.sleep(pause_s)
        return began

    def spoil(self, name: str) -> float:
        """Cause a fault of `benchmarks.spoilt_run`, such as "clock" or "grab"; return its time (s, monotonic clock).

        For a fault of a camera method other than "close", wait until the run calls this method.
        """
        (self.folder / name).touch()
        began = time.monotonic()
        if name not in {"clock", "close"}:
            wait_until((self.folder / "reached").exists, f"{name} was never called")
        return began

    def _find_guardian(self) -> int:
        children = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split()
        return next(int(c) for c in children if b"guardian_process" in Path(f"/proc/{c}/cmdline").read_bytes())

    def acknowledged(self) -> int:
        """Return the number of states that the run reported as stored."""
        return sum(line.startswith("acquire ") for line in self.lines)

    def end(self) -> int:
        """Wait for the end of the run and of its guardian process; return the exit status of the run."""
        try:
            status = self.process.wait(20)
        except subprocess.TimeoutExpired:
            self.process.kill()
            status = self.process.wait(20)
        wait_until(lambda: not alive(self.guardian) or self._is_unidentified(), "the guardian never ended")
        self.end_guardian()
        if not self.unread:
            self._reader.join(WAIT_AT_MOST_S)
        else:
            os.close(self._pipe)
        return status


def make_bench(folder: Path) -> None:
    """Write a specimen, a calibration, a protocol at full current, and pictures of a beam at rest into a folder."""
    text = load_protocol(SHIPPED).text
    begin, end = text.index("[current]"), text.index("[ramp]")
    currents = f"[current]\nvalues_A = {[0.0] + [FULL_A] * (STATES - 1)}\n\n"
    (folder / "protocol.toml").write_text(text[:begin] + currents + text[end:])
    for name in ("specimen.toml", "calibration.toml"):
        (folder / name).write_text(FILES[name])
    recording = folder / "recording"
    recording.mkdir()
    across = np.abs(np.arange(WIDTH) - WIDTH / 2)
    for number in range(PICTURES):
        noise = np.random.default_rng(number).normal(0, 2, (HEIGHT, WIDTH))
        image = 30 + 170 / (1 + np.exp(-(across - 4) / 0.7)) + noise
        cv2.imwrite(str(recording / f"f_{number}.png"), np.clip(image, 0, 255).astype(np.uint8))
    for number in range(PICTURES, NAMES):
        os.link(recording / f"f_{number % PICTURES}.png", recording / f"f_{number}.png")

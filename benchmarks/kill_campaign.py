"""Kill measurements at random moments, and check that the coil is off and that no stored state is lost.

    python -m benchmarks.kill_campaign --runs 500

Each run is an `eimi acquire` on an emulated supply. The signal is TERM, HUP, INT or KILL. The exit status is 0 if every
run passed both checks.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from eimi_drivers.clock import WallClock
from eimi_drivers.emulators.serve import emulate, serve_pty
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.supplies.transport import Responder
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.dataset.recovery import recover

CURRENTS_A = [0.0, 0.1, 0.2, 0.3]
FRAMES, HEIGHT, WIDTH = 2, 48, 64
# Numbers of different pictures and of file names in the recording. The recording must be long: it has no frame rate,
# and a fast machine reads 100 images per state.
PICTURES, NAMES = 16, 4000
SIGNALS = (signal.SIGTERM, signal.SIGHUP, signal.SIGINT, signal.SIGKILL)
DRIVERS = ("scpi", "korad")  # the driver with the faster line first, for short campaigns
WATCH_EVERY_S = 0.002
GIVE_UP_AFTER_S = 600.0
BEFORE_ANY = "stopped before a file was begun"

FILES = {
    "specimen.toml": """
[specimen]
name = "small"
material = "Dragon Skin 10"
length_mm = 10.0
width_mm = 2.0
depth_mm = 2.0
density_kg_m3 = 1070.0
section = "plane-strain"
""",
    "calibration.toml": """
pixels_per_mm = 4.0
coil_constant_mT_per_A = 4.7
clamp_midpoint_px = [32.0, 4.0]
axis_angle_deg = 90.0
gravity_angle_deg = 90.0
field_angle_deg = 0.0
""",
    "protocol.toml": f"""
name = "short"
material = "Dragon Skin 10"
frames_per_state = {FRAMES}
current = {{ values_A = {CURRENTS_A} }}
ramp = {{ rate_A_per_s = 10.0, step_A = 0.3, tolerance_A = 0.02 }}
limits = {{ current_A = 1.0, voltage_V = 10.0 }}
settle = {{ noise_ratio = 1.5, pairs = 2, drift_window_s = 0.02, timeout_s = 5.0 }}
""",
}


class ObservedInstrument:
    """Pass messages on to an emulated instrument, and set the event `first` at the first message."""

    def __init__(self, instrument: Responder) -> None:
        self._instrument = instrument
        self.first = threading.Event()

    def receive(self, data: bytes) -> bytes:
        self.first.set()
        return self._instrument.receive(data)


@dataclass
class RunEnd:
    """The result of a run that has ended.

    Attributes
    ----------
    status : int
        Exit status.
    lines : list of str
        Messages.
    lasted_s : float
        Duration, s.
    on_for_s : float
        Time for which the output stayed on after the signal, s.
    """

    status: int
    lines: list[str]
    lasted_s: float
    on_for_s: float = 0.0

    @property
    def acknowledged(self) -> int:
        """Return the number of states that the run reported as stored."""
        return sum(line.startswith("acquire ") for line in self.lines)


def make_bench(folder: Path) -> None:
    """Write the TOML files of a bench and the pictures for its camera into a folder."""
    recording = folder / "recording"
    recording.mkdir()
    across = np.abs(np.arange(WIDTH) - WIDTH / 2)
    for number in range(PICTURES):
        noise = np.random.default_rng(number).normal(0, 2, (HEIGHT, WIDTH))
        image = 30 + 170 / (1 + np.exp(-(across - 4) / 0.7)) + noise
        cv2.imwrite(str(recording / f"f_{number}.png"), np.clip(image, 0, 255).astype(np.uint8))
    for number in range(PICTURES, NAMES):
        os.link(recording / f"f_{number % PICTURES}.png", recording / f"f_{number}.png")
    for name, text in FILES.items():
        (folder / name).write_text(text)


def run(
    folder: Path,
    address: str,
    instrument: ObservedInstrument,
    coil: CoilSupply,
    driver: str,
    kill: tuple[int, float] | None,
    *more: str,
) -> RunEnd:
    """Run `eimi acquire`, send a signal to it, and return the result.

    Parameters
    ----------
    folder : Path
        Folder with the files of the bench.
    address : str
        Address of the emulated supply.
    instrument : ObservedInstrument
        The emulated supply.
    coil : CoilSupply
        Model of supply and coil, which shows whether the output is on.
    driver : str
        Name of the supply's driver.
    kill : tuple of (int, float) or None
        A signal, and its time after the first message, s; None for no signal.
    *more : str
        Further options of `eimi acquire`.
    """
    (folder / "rig.toml").write_text(f"""
name = "emulated"
calibration = "calibration.toml"
supply = {{ driver = "{driver}", address = "{address}", limits = {{ current_A = 1.0, voltage_V = 10.0 }} }}
camera = {{ driver = "opencv", source = "recording" }}
""")
    command = [sys.executable, "-m", "eimi_lab", "acquire", "protocol.toml", "--specimen", "specimen.toml"]
    process = subprocess.Popen(
        [*command, "--rig", "rig.toml", "-o", "run.h5", *more],
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    lines: list[str] = []
    assert process.stderr is not None
    reader = threading.Thread(target=lines.extend, args=(process.stderr,), daemon=True)
    instrument.first.clear()
    reader.start()
    if not instrument.first.wait(GIVE_UP_AFTER_S):
        process.kill()
        raise RuntimeError(f"the run never spoke to the supply: {lines}")
    began = time.monotonic()
    on_for_s = 0.0
    if kill:
        number, after_s = kill
        time.sleep(after_s)
        process.send_signal(number)
        sent = time.monotonic()
        # The reader ends when both the run and its guardian, the process that switches the coil off, have ended.
        while reader.is_alive() and time.monotonic() - sent < GIVE_UP_AFTER_S:
            if coil.state.output:
                on_for_s = time.monotonic() - sent
            time.sleep(WATCH_EVERY_S)
    reader.join(GIVE_UP_AFTER_S)
    return RunEnd(process.wait(GIVE_UP_AFTER_S), [line.rstrip() for line in lines], time.monotonic() - began, on_for_s)


def stored(path: Path) -> list[float | None]:
    """Read all frames of a dataset; return the current (A) of each state, or None if a state has no current."""
    with open_dataset(path) as dataset:
        for state in dataset.states:
            assert dataset.images(state.index).shape == (FRAMES, HEIGHT, WIDTH)
        return [state.current_A for state in dataset.states]


def faults_of(ended: RunEnd, coil: CoilSupply, folder: Path, off_within_s: float) -> list[str]:
    """Return descriptions of the faults after a killed run; empty without faults.

    A fault is a lost state, or an output that is on for more than `off_within_s` seconds after the signal.
    """
    faults = []
    if coil.state.output or coil.state.set_current_A:
        faults.append("the coil was left on")
    elif ended.on_for_s > off_within_s:
        faults.append(f"the coil was off only after {ended.on_for_s:.2f} s")
    path, whole = folder / "run.h5", folder / "whole.h5"
    if not path.exists():
        return faults + (["acknowledged states have no file"] if ended.acknowledged else [])
    recover(path, whole)
    recovered = stored(whole)
    if recovered != CURRENTS_A[: len(recovered)] or len(recovered) < ended.acknowledged:
        faults.append(f"{ended.acknowledged} states acknowledged, {recovered} recovered")
    return faults


def campaign(runs: int, resumed: float, seed: int, off_within_s: float) -> int:
    """Kill `runs` runs at random moments, print the results, and return the number of runs with a fault.

    `resumed` is the probability that a killed run is resumed. `off_within_s` is the time limit (s) for the coil.
    """
    for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM):  # a child would inherit ignored signals
        signal.signal(number, signal.SIG_DFL)
    random = np.random.default_rng(seed)
    counts: Counter[str] = Counter()
    on_for_s: list[float] = []
    lasting_s: dict[str, float] = {}
    drivers = DRIVERS[:runs]
    for index in range(-len(drivers), runs):  # one complete run for each driver first, to measure its duration
        driver = drivers[index % len(drivers)]
        with tempfile.TemporaryDirectory() as name:
            folder, coil = Path(name), CoilSupply(WallClock())
            make_bench(folder)
            instrument = ObservedInstrument(emulate(driver, coil))
            with serve_pty(instrument) as address:
                if index < 0:
                    unharmed = run(folder, address, instrument, coil, driver, None)
                    lasting_s[driver] = unharmed.lasted_s
                    if unharmed.status != 0 or stored(folder / "run.h5") != CURRENTS_A:
                        raise RuntimeError(f"not even a run that nobody kills is complete: {unharmed.lines[-1:]}")
                    continue
                number = SIGNALS[int(random.integers(len(SIGNALS)))]
                after_s = float(random.uniform(0, lasting_s[driver]))
                ended = run(folder, address, instrument, coil, driver, (number, after_s))
                faults = faults_of(ended, coil, folder, off_within_s)
                on_for_s.append(ended.on_for_s)
                counts[number.name] += 1
                counts["files recovered"] += (folder / "whole.h5").exists()
                counts[BEFORE_ANY] += not (folder / "run.h5").exists()
                counts["killed with the output on"] += ended.on_for_s > 0
                counts["states acknowledged"] += ended.acknowledged
                if (folder / "run.h5").exists() and random.random() < resumed:
                    counts["resumed"] += 1
                    again = run(folder, address, instrument, coil, driver, None, "--resume")
                    if again.status == 0 and stored(folder / "run.h5") == CURRENTS_A and not coil.state.output:
                        counts["resumed and complete"] += 1
                    else:
                        faults.append(f"resuming ended with {again.status}: {again.lines[-1:]}")
        counts["runs"] += 1
        print(f"\r{index + 1} of {runs}", end="", file=sys.stderr, flush=True)
        if faults:
            counts["runs with a fault"] += 1
            print(f"run {index}, {driver}, {number.name} after {after_s:.3f} s: {'; '.join(faults)}", flush=True)
            print("\n".join(f"    {line}" for line in ended.lines), flush=True)
    print(", ".join(f"{counts[number.name]} {number.name}" for number in SIGNALS))
    print(f"coil off within {off_within_s:g} s: {sum(t <= off_within_s for t in on_for_s)} of {counts['runs']}", end="")
    print(f"; {counts['killed with the output on']} found it on; longest {max(on_for_s):.2f} s", end="")
    print(f", median of those {np.median([t for t in on_for_s if t] or [0.0]):.2f} s")
    print(f"files recovered: {counts['files recovered']}; {BEFORE_ANY}: {counts[BEFORE_ANY]}")
    print(f"states acknowledged: {counts['states acknowledged']}")
    print(f"resumed and complete: {counts['resumed and complete']} of {counts['resumed']}")
    print(f"runs with a fault: {counts['runs with a fault']} of {counts['runs']}")
    return counts["runs with a fault"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=500, help="number of runs")
    parser.add_argument("--resumed", type=float, default=0.5, help="share of the runs with a file that are resumed")
    parser.add_argument("--off-within", type=float, default=1.0, help="time limit in seconds for the coil")
    parser.add_argument("--seed", type=int, default=1, help="seed of signals and moments")
    chosen = parser.parse_args()
    sys.exit(1 if campaign(chosen.runs, chosen.resumed, chosen.seed, chosen.off_within) else 0)


if __name__ == "__main__":
    main()

"""Fixtures: a small emulated bench, with TOML files as a user writes them and drawn frames of a beam."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from eimi_drivers.clock import SimulatedClock
from eimi_drivers.emulators.faults import FaultyInstrument
from eimi_drivers.emulators.korad import KoradDialect
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.interfaces import Frame, Identity, Limits
from eimi_drivers.supplies.korad import KoradSupply
from eimi_drivers.supplies.transport import InProcessTransport
from eimi_lab import cli
from eimi_lab.acquisition.event_words import on_terminal
from eimi_lab.acquisition.events import Event, OnEvent, ignore_event
from eimi_lab.acquisition.open_bench import Bench
from eimi_lab.acquisition.run import acquire
from eimi_lab.config.calibration import load_calibration
from eimi_lab.config.protocol import Protocol, load_protocol
from eimi_lab.config.rig import Rig, load_rig
from eimi_lab.config.specimen import SpecimenFile, load_specimen
from eimi_lab.dataset.layout import Header
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.dataset.writing import DatasetWriter
from eimi_lab.process.errors import tell
from eimi_lab.vision.check import Flag

SPECIMEN = """
[specimen]
name = "small"
material = "Dragon Skin 10"
length_mm = 10.0
width_mm = 2.0
depth_mm = 2.0
density_kg_m3 = 1070.0
section = "plane-strain"
"""

PICTURES, NAMES = 24, 3000
"""Numbers of pictures and of file names in the fixture `bench`; several names lead to one picture."""

CALIBRATION = """
pixels_per_mm = 8.0
coil_constant_mT_per_A = 4.7
clamp_midpoint_px = [64.0, 8.0]
axis_angle_deg = 90.0
gravity_angle_deg = 90.0
field_angle_deg = 0.0
"""

PROTOCOL = """
name = "short"
material = "Dragon Skin 10"
frames_per_state = 2

[current]
start_A = 0.0
stop_A = 0.3
step_A = 0.1

[ramp]
rate_A_per_s = 10.0
step_A = 0.1
tolerance_A = 0.02

[limits]
current_A = 1.0
voltage_V = 10.0

[settle]
noise_ratio = 1.5
pairs = 2
drift_window_s = 0.02
timeout_s = 5.0
"""


def draw(seed: int, shift_px: float = 0.0) -> NDArray[np.uint8]:
    # Return a picture, (96, 128), uint8: a dark vertical beam, 16 px wide, shifted to the right by `shift_px`.
    rng = np.random.default_rng(seed)
    across = np.arange(128) - 64 - shift_px
    profile = 30 + 170 / (1 + np.exp(-(np.abs(across) - 8) / 0.7))
    image = np.tile(profile, (96, 1))
    return np.clip(image + rng.normal(0, 2, image.shape), 0, 255).astype(np.uint8)


@pytest.fixture(scope="session")
def texts() -> dict[str, str]:
    # The texts of the three TOML files of an emulated bench: specimen, calibration and protocol.
    return {"specimen": SPECIMEN, "calibration": CALIBRATION, "protocol": PROTOCOL}


@pytest.fixture
def files(tmp_path: Path, texts: dict[str, str]) -> Path:
    # A folder with the three TOML files of an emulated bench.
    for name, text in texts.items():
        (tmp_path / f"{name}.toml").write_text(text)
    return tmp_path


@pytest.fixture(scope="session")
def frame() -> Callable[..., NDArray[np.uint8]]:
    # The function `draw`, which draws a beam from a seed and a displacement in pixels.
    return draw


@pytest.fixture
def pictures(files: Path) -> Path:
    # A folder with four images in `frames/`, their currents in states.csv, and the TOML files of a bench.
    folder = files / "frames"
    folder.mkdir()
    lines = ["frame,current_A"]
    for index in (1, 2, 10, 20):
        cv2.imwrite(str(folder / f"frame_{index}.png"), draw(index))
        lines.append(f"frame_{index}.png,{index / 10}")
    (files / "states.csv").write_text("\n".join(lines) + "\n")
    return files


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str]]:
    # Return a function that runs an `eimi` command in this process and returns its exit status and standard error.
    def run(*arguments: object) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["eimi", *map(str, arguments)])
        with pytest.raises(SystemExit) as exit_:
            cli.main()
        return int(exit_.value.code or 0), capsys.readouterr().err

    monkeypatch.setattr(cli, "unwind_on_termination", lambda: None)
    return run


FRAME_S = 0.005
BEGAN_S = 100_000.0
"""Time (s) on the clock of the bench when the bench is made. Times from the beginning of a run are much smaller."""


class DrawnCamera:
    # A replacement for a camera: its frames show a beam that swings after each change of the current.
    # event: function that is called with the number of each frame before the frame is taken.

    def __init__(self, coil: CoilSupply, clock: SimulatedClock, draw: Callable[..., np.ndarray]) -> None:
        self.coil, self.clock, self.draw = coil, clock, draw
        self.number = 0
        self.event: Callable[[int], None] = lambda number: None
        self.swing_s, self.sway_px = 0.1, 0.0
        self.repeats = False
        self._changed_s, self._current_A = clock.now(), 0.0

    def identify(self) -> Identity:
        return Identity("drawn", "a drawn beam", "memory")

    def flush(self) -> None:
        pass

    def grab(self, timeout_s: float) -> Frame:
        self.clock.sleep(FRAME_S)
        self.event(self.number)
        set_A = self.coil.state.set_current_A
        if set_A != self._current_A:
            self._changed_s, self._current_A = self.clock.now(), set_A
        age = (self.clock.now() - self._changed_s) / self.swing_s
        shift = 10 * set_A + (5 * np.exp(-age) * np.cos(9 * age) if set_A else 0.0)
        shift += self.sway_px * np.sin(self.number) * (set_A > 0)
        self.number += 1
        if not self.repeats:
            self._image = self.draw(self.number, shift)
        return Frame(self._image, self.number, self.clock.now())

    def close(self) -> None:
        pass


@dataclass
class Setup:
    coil: CoilSupply
    line: FaultyInstrument
    camera: DrawnCamera
    bench: Bench
    protocol: Protocol
    specimen: SpecimenFile
    rig: Rig
    path: Path

    def run(
        self, *, remark: Callable[[str], None] = tell, on_event: OnEvent = ignore_event, **options: Any
    ) -> list[str]:
        # Run the protocol on this bench; return the printed lines, one for each state.
        messages: list[str] = []
        terminal = on_terminal(messages.append, remark)

        def heard(event: Event) -> None:
            on_event(event)
            terminal(event)

        acquire(self.protocol, self.specimen, self.rig, self.bench, self.path, heard, **options)
        return messages

    def is_off(self) -> bool:
        return not self.coil.state.output and self.coil.state.set_current_A == 0.0

    def stored(self) -> list[float | None]:
        with open_dataset(self.path) as dataset:
            assert all(dataset.images(state.index).shape == (2, 96, 128) for state in dataset.states)
            return [state.current_A for state in dataset.states]


@pytest.fixture
def setup(files: Path, frame: Callable[..., np.ndarray]) -> Setup:
    clock = SimulatedClock(BEGAN_S)
    coil = CoilSupply(clock, current_noise_A=0.0005)
    line = FaultyInstrument(KoradDialect(coil))
    supply = KoradSupply(InProcessTransport(line, clock), Limits(1.0, 10.0), clock)
    camera = DrawnCamera(coil, clock, frame)
    (files / "rig.toml").write_text(
        load_rig("bench_example").text.replace("bench_example_calibration.toml", "calibration.toml")
    )
    return Setup(
        coil,
        line,
        camera,
        Bench(supply, camera, clock, {"model": "drawn"}),
        load_protocol(files / "protocol.toml"),
        load_specimen(files / "specimen.toml"),
        load_rig(files / "rig.toml"),
        files / "run.h5",
    )


@pytest.fixture
def dataset(files: Path) -> Path:
    # A dataset with two states of a drawn beam; the second one has the warning NOT_SETTLED (the beam still moved).
    header = Header(load_specimen(files / "specimen.toml"), load_calibration(files / "calibration.toml"))
    rng = np.random.default_rng(0)
    image = np.full((96, 128), 210.0)
    image[:8] = 4.0
    image[:88, 56:72] = 16.0  # 10 mm by 2 mm from a clamp at the 8th row, edges at 55.5 and 71.5
    image = cv2.GaussianBlur(image, (0, 0), 1.0)
    with DatasetWriter(files / "run.h5", header, Frame(image.astype(np.uint8), 0, 0.0)) as writer:
        for k in range(2):
            frames = [
                Frame(np.rint(image + rng.normal(0, 1.5, image.shape)).clip(0, 255).astype(np.uint8), n, 0.0)
                for n in range(3)
            ]
            flags = (Flag("NOT_SETTLED", 2.0, 1.2, "Wait."),) if k else ()
            writer.append_state(frames, current_A=k / 10, field_mT=0.47 * k, flags=flags)
    return files / "run.h5"


@pytest.fixture
def bench(files: Path, frame: Callable[..., np.ndarray]) -> Path:
    # A folder with a protocol, a specimen, and enough images of a beam at rest for a whole run.
    recording = files / "recording"
    recording.mkdir()
    for number in range(PICTURES):
        cv2.imwrite(str(recording / f"f_{number}.png"), frame(number))
    for number in range(PICTURES, NAMES):
        os.link(recording / f"f_{number % PICTURES}.png", recording / f"f_{number}.png")
    return files


@pytest.fixture
def called(monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[Any]]:
    # Return a function that replaces a function of the program, given by its path, with one that returns or calls
    # `answer`. All calls are recorded in one list: name, arguments and keyword arguments.
    calls: list[Any] = []

    def replace(path: str, answer: Any = None) -> list[Any]:
        def act(*arguments: Any, **keywords: Any) -> Any:
            calls.append((path.rpartition(".")[2], arguments, keywords))
            return answer(*arguments, **keywords) if callable(answer) else answer

        monkeypatch.setattr(path, act)
        return calls

    return replace


def give_many_states(bench: Path) -> None:
    """Give the protocol 50 states, so that a run still goes on if a busy computer delays the signal of a test."""
    protocol = bench / "protocol.toml"
    protocol.write_text(protocol.read_text().replace("stop_A = 0.3\nstep_A = 0.1", "stop_A = 0.98\nstep_A = 0.02", 1))

"""An emulated supply, a virtual beam or stored pictures can replace the instruments of a run."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

from eimi_drivers.clock import SimulatedClock, WallClock
from eimi_drivers.emulators.coil_line import RemoteCoil, serve_coil
from eimi_drivers.emulators.serve import emulate, serve_pty, serve_tcp
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.interfaces import InstrumentDisconnected, Limits
from eimi_drivers.supplies.supply_names import supply_driver
from eimi_drivers.supplies.transcript import ReplayedTransport
from eimi_lab.config.rig import load_rig
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.process.errors import InputError
from tests.patience import PATIENCE_S

FOUR_STATES = [0.0, 0.1, 0.2, 0.3]

MAGNET = """
[magnet]
length_mm = 2.0
width_mm = 2.0
depth_mm = 2.0
remanence_T = 1.3
density_kg_m3 = 7500.0
"""

VIRTUAL = """
[virtual]
seed = 1
coil_time_constant_s = 0.05
current_noise_A = 0.0
frame_size_px = [128, 96]
mesh = [8, 1, 1]
materials = "virtual_materials.toml"
"""


@dataclass
class RunEnd:
    status: int
    lines: list[str]


def rig(folder: Path, supply: str, camera: str, more: str = "") -> Path:
    path = folder / "rig.toml"
    path.write_text(f"""
name = "desk"
calibration = "calibration.toml"
supply = {{ {supply}, limits = {{ current_A = 1.0, voltage_V = 10.0 }} }}
camera = {{ {camera} }}
{more}""")
    return path


def acquire(folder: Path, *more: str) -> RunEnd:
    command = [sys.executable, "-m", "eimi_lab", "acquire", "protocol.toml", "--specimen", "specimen.toml"]
    command += ["--rig", "rig.toml", "-o", "run.h5", *more]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    return RunEnd(done.returncode, done.stderr.splitlines())


@contextmanager
def emulated() -> Iterator[tuple[CoilSupply, str]]:
    coil = CoilSupply(WallClock())
    with serve_tcp(emulate("scpi", coil)) as address:
        yield coil, f'driver = "scpi", address = "{address}"'
    assert not coil.state.output
    assert coil.state.set_current_A == 0.0


@pytest.fixture
def pictures(files: Path, frame: Callable[..., np.ndarray]) -> Path:
    # A folder with four pictures in `shots/`; a beam moves by 10 px from each picture to the next.
    (files / "shots").mkdir()
    for number in range(4):
        cv2.imwrite(str(files / "shots" / f"f_{number}.png"), frame(number, 10.0 * number))
    return files


def shown(path: Path, folder: Path) -> list[int]:
    # Return, for each state of a dataset, the number n of the picture `f_n.png` that it stores.
    stored = [cv2.imread(str(folder / f"f_{number}.png"), cv2.IMREAD_GRAYSCALE) for number in range(4)]
    numbers = []
    with open_dataset(path) as dataset:
        for state in dataset.states:
            same = [number for number, image in enumerate(stored) if (dataset.images(state.index) == image).all()]
            assert len(same) == 1
            assert state.flags == ()
            numbers += same
    return numbers


def test_a_virtual_beam_hangs_in_the_coil_of_an_emulated_supply(files: Path) -> None:
    (files / "specimen.toml").write_text((files / "specimen.toml").read_text() + MAGNET)
    materials = load_rig("virtual").virtual
    assert materials is not None
    (files / "virtual_materials.toml").write_text(materials.materials.text)
    coil = CoilSupply(WallClock())
    with serve_pty(emulate("korad", coil)) as port, serve_coil(coil) as line:
        camera = f'driver = "virtual", source = "{line}"'
        rig(files, f'driver = "korad", address = "{port}"', camera, VIRTUAL)
        ended = acquire(files)
        assert ended.status == 0, ended.lines
        assert not coil.state.output
    means = []
    with open_dataset(files / "run.h5") as dataset:
        assert [state.current_A for state in dataset.states] == FOUR_STATES
        truth = dataset.truth()
        means += [dataset.images(state.index).mean(axis=0) for state in dataset.states]
    assert truth is not None
    assert truth["mesh"] == [8, 1, 1]
    rig(files, 'driver = "virtual", address = "virtual"', 'driver = "virtual", source = "virtual"', VIRTUAL)
    assert acquire(files, "--force").status == 0
    with open_dataset(files / "run.h5") as dataset:
        simulated = [dataset.images(state.index).mean(axis=0) for state in dataset.states]
    for mean, other in zip(means, simulated, strict=True):
        assert (
            np.abs(mean - other).mean() < 3.0
        )  # only noise differs: the beam has the shape of the true current of the coil
    assert np.abs(means[3] - means[0]).max() > 60.0  # this shape is not the shape at rest


def test_the_emulated_coil_sends_its_true_current_and_reports_its_end() -> None:
    coil = CoilSupply(WallClock())
    with serve_coil(coil) as line:
        far = RemoteCoil(line)
        assert far.coil_current_A() == 0.0
        coil.set_voltage(10.0)
        coil.set_current(0.5)
        coil.switch(True)
        WallClock().sleep(1.0)
        assert far.coil_current_A() == pytest.approx(0.5, abs=1e-6)
    far.close()
    with pytest.raises(InstrumentDisconnected, match="no emulated coil answers"):
        RemoteCoil(line)


@pytest.mark.parametrize(
    ("supply", "camera", "more", "expected"),
    [
        (
            "virtual",
            'driver = "opencv", source = 0',
            "",
            "camera.driver = 'opencv' does not suit supply.driver = 'virtual'",
        ),
        (
            "korad",
            'driver = "virtual", source = "virtual"',
            VIRTUAL,
            "camera.source = 'virtual' should be the address that `eimi emulate`",
        ),
        (
            "korad",
            'driver = "opencv", source = 0',
            VIRTUAL,
            "the table [virtual] is required with camera.driver",
        ),
        (
            "korad",
            'driver = "opencv", source = 0, playback = { loop = true }',
            "",
            "[camera] playback is only for",
        ),
    ],
)
def test_instruments_that_do_not_fit_together_are_refused(
    files: Path, supply: str, camera: str, more: str, expected: str
) -> None:
    materials = load_rig("virtual").virtual
    assert materials is not None
    (files / "virtual_materials.toml").write_text(materials.materials.text)
    path = rig(files, f'driver = "{supply}", address = "here"', camera, more)
    with pytest.raises(InputError) as caught:
        load_rig(path)
    assert str(caught.value).startswith(f"{path}: {expected}")


def test_each_state_has_one_picture_on_request(pictures: Path) -> None:
    with emulated() as (_, supply):
        rig(pictures, supply, 'driver = "opencv", source = "shots", playback = { picture_a_state = true }')
        ended = acquire(pictures)
    assert ended.status == 0, ended.lines
    assert ended.lines[0] == "eimi: camera.source = 'shots' has 4 pictures; the run uses 4 pictures, one for each state"
    assert shown(pictures / "run.h5", pictures / "shots") == [0, 1, 2, 3]


def test_a_looped_recording_starts_again_after_its_last_picture(pictures: Path) -> None:
    (pictures / "shots" / "f_3.png").rename(pictures / "f_3.png")
    with emulated() as (_, supply):
        camera = 'driver = "opencv", source = "shots", playback = { picture_a_state = true, loop = true }'
        rig(pictures, supply, camera)
        ended = acquire(pictures)
    assert ended.lines[0].endswith(
        "has 3 pictures; the run uses 4 pictures, one for each state; the recording starts again after its last picture"
    )
    (pictures / "f_3.png").rename(pictures / "shots" / "f_3.png")
    assert shown(pictures / "run.h5", pictures / "shots") == [0, 1, 2, 0]


@pytest.mark.parametrize(
    ("playback", "expected"),
    [
        (
            "",
            "the run uses at least 28 pictures, and more while it waits for the beam to settle; set picture_a_state",
        ),
        (
            ", playback = { picture_a_state = true }",
            "has 3 pictures; the run uses 4 pictures, one for each state; set loop = true",
        ),
    ],
)
def test_too_few_pictures_are_refused_before_the_run(pictures: Path, playback: str, expected: str) -> None:
    (pictures / "shots" / "f_3.png").unlink()
    rig(pictures, 'driver = "scpi", address = "nowhere"', f'driver = "opencv", source = "shots"{playback}')
    ended = acquire(pictures)
    assert ended.status == 2
    assert len(ended.lines) == 1
    assert expected in ended.lines[0]


def test_pictures_that_change_their_size_end_the_run(files: Path, frame: Callable[..., np.ndarray]) -> None:
    (files / "shots").mkdir()
    for number in range(60):
        cv2.imwrite(str(files / "shots" / f"f_{number}.png"), frame(number)[:, : 128 if number < 20 else 64])
    with emulated() as (_, supply):
        rig(files, supply, 'driver = "opencv", source = "shots"')
        ended = acquire(files)
    assert ended.status == 1
    assert "is 64 x 96 uint8, the earlier frames are 128 x 96 uint8; size, bit depth and colours" in ended.lines[-1]


def test_the_transcript_of_a_run_replaces_the_supply_in_another_run(pictures: Path) -> None:
    with emulated() as (_, supply):
        rig(pictures, supply, 'driver = "opencv", source = "shots", playback = { picture_a_state = true }')
        ended = acquire(pictures, "--transcript", "wire.txt")
        assert ended.status == 0, ended.lines
        assert (
            acquire(pictures, "--force", "--transcript", "wire.txt").status == 2
        )  # a transcript never overwrites an older one
    with open_dataset(pictures / "run.h5") as dataset:
        kept = dataset.instruments()[0]
    again = supply_driver("scpi")(ReplayedTransport(pictures / "wire.txt"), Limits(1.0, 10.0), SimulatedClock())
    identity = again.identify()  # the messages must have the order of the run
    assert kept == f"{identity.driver}: {identity.text} at {identity.address}"
    assert abs(again.measure().current_A) < 0.02
    assert not again.output_on()
    again.check()
    again.set_current(0.0)
    again.set_voltage(10.0)

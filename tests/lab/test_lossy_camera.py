"""A run stores only good frames of a GigE camera that loses packets, disappears, or is replaced."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from eimi_drivers.clock import WallClock
from eimi_drivers.emulators import CoilSupply, emulate, serve_tcp
from eimi_drivers.emulators.gige_camera import LOOPBACK
from eimi_drivers.emulators.gige_process import CameraProcess
from eimi_drivers.interfaces import InstrumentDisconnected, InstrumentTimeout, SetPointNotTaken
from eimi_lab.acquisition.event_words import in_words
from eimi_lab.acquisition.events import Event, FramesLost, StateStored, ignore_event
from eimi_lab.acquisition.open_bench import open_bench
from eimi_lab.acquisition.run import acquire
from eimi_lab.config.rig import load_rig
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.process.errors import InputError
from tests.shared.emulated_gige import (
    FIRST_NUMBER,
    NoisyPictures,
    gige_camera,
    needs_aravis,
    noisy_picture,
    only_gige_camera,
)

pytestmark = needs_aravis


@pytest.fixture(scope="module", autouse=True)
def alone() -> Iterator[None]:
    # Hold the lock of the GigE camera until the end of this module.
    with only_gige_camera():
        yield


@pytest.fixture
def coil() -> CoilSupply:
    return CoilSupply(WallClock(), time_constant_s=0.01)


@pytest.fixture
def measure(setup: Any, files: Path, coil: CoilSupply) -> Iterator[Callable[..., None]]:
    # Return a function that runs the protocol of `setup` with the emulated GigE camera and an emulated supply.
    with serve_tcp(emulate("scpi", coil)) as address:

        def run(on_event: Callable[[Event], None] = ignore_event, camera: str = "", **options: Any) -> None:
            (files / "rig.toml").write_text(f"""
name = "bench"
calibration = "calibration.toml"
supply = {{ driver = "scpi", address = "{address}", limits = {{ current_A = 1.0, voltage_V = 10.0 }} }}
[camera]
driver = "aravis"
source = "{LOOPBACK}"
{camera}
""")
            rig = load_rig(files / "rig.toml")
            with open_bench(rig, setup.specimen, setup.protocol.limits) as bench:
                acquire(setup.protocol, setup.specimen, rig, bench, setup.path, on_event, **options)

        yield run


def served(**camera: Any) -> Any:
    return gige_camera(NoisyPictures, **camera)


def every_stored_frame_is_a_picture_of_the_camera(path: Path) -> int:
    # Assert that every stored frame is as the camera exposed it; return the number of frames.
    count = 0
    with h5py.File(path) as file:
        for group in ("data", "transients"):
            if group in file["entry"]:
                for frame, number in zip(file[f"entry/{group}/frames"], file[f"entry/{group}/number"], strict=True):
                    np.testing.assert_array_equal(frame, noisy_picture(number - FIRST_NUMBER + 1))
                    count += 1
    return count


@pytest.mark.parametrize("share", [0.0, 0.001, 0.02])
def test_a_run_with_lost_packets_stores_only_complete_frames_and_counts_the_lost_frames(
    setup: Any, measure: Callable[..., None], coil: CoilSupply, share: float
) -> None:
    events: list[Event] = []
    with served() as camera:
        camera.lose_packets(share)
        measure(events.append)
    assert every_stored_frame_is_a_picture_of_the_camera(setup.path) >= 8
    lost = [event for event in events if isinstance(event, FramesLost)]
    assert all(sum(event.reasons.values()) == event.frames for event in lost)
    by_state = {event.state: event.frames for event in lost if event.state is not None}
    with open_dataset(setup.path) as dataset:
        flags = [{flag.name: flag.value for flag in state.flags} for state in dataset.states]
    assert {state: found["DROPPED"] for state, found in enumerate(flags) if "DROPPED" in found} == by_state
    assert bool(lost) == (share == 0.02) or share == 0.001
    assert all("none of them is stored" in in_words(event) for event in lost)
    assert not coil.state.output


def test_a_run_without_complete_frames_ends_with_the_coil_off(
    setup: Any, measure: Callable[..., None], coil: CoilSupply
) -> None:
    with served() as camera:

        def lose(event: Event) -> None:
            if isinstance(event, StateStored) and event.state == 1:
                camera.lose_packets(0.7)

        with pytest.raises(InstrumentTimeout, match=r"no complete frame within 5 s; incomplete frames: \d+ with "):
            measure(lose)
    assert (coil.state.output, coil.state.set_current_A) == (False, 0.0)
    assert every_stored_frame_is_a_picture_of_the_camera(setup.path) >= 4


@pytest.mark.parametrize("serial_number", ["EIMI01", "EIMI02"], ids=["the camera comes back", "another camera comes"])
def test_a_run_ends_when_its_camera_disappears_and_resumes_with_the_same_camera_only(
    setup: Any, measure: Callable[..., None], coil: CoilSupply, serial_number: str
) -> None:
    def vanish(camera: CameraProcess) -> Callable[[Event], None]:
        def heard(event: Event) -> None:
            if isinstance(event, StateStored) and event.state == 1:
                camera.kill()

        return heard

    with (
        served(serial_number="EIMI01") as camera,
        pytest.raises(InstrumentDisconnected, match=r"camera 127\.0\.0\.1: "),
    ):
        measure(vanish(camera))
    assert (coil.state.output, coil.state.set_current_A) == (False, 0.0)
    with open_dataset(setup.path) as dataset:
        assert len(dataset.states) == 2
    with served(serial_number=serial_number):
        if serial_number != "EIMI01":
            with pytest.raises(
                InputError, match=r"cannot be resumed: the run began with other instruments: .*EIMI01.* then, .*EIMI02"
            ):
                measure(resume=True)
        else:
            measure(resume=True)
    with open_dataset(setup.path) as dataset:
        assert len(dataset.states) == (4 if serial_number == "EIMI01" else 2)
    assert not coil.state.output


def test_a_region_that_the_camera_rounds_ends_the_run_before_anything_is_switched_on(
    setup: Any, measure: Callable[..., None], coil: CoilSupply
) -> None:
    with (
        served(rows_step=16),
        pytest.raises(SetPointNotTaken, match=r"region was set to \(0, 0, 128, 90\) but reads back \(0, 0, 128, 80\)"),
    ):
        measure(camera="region = [0, 0, 128, 90]")
    assert not coil.state.output
    assert not setup.path.exists()

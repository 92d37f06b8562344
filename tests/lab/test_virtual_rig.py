"""The virtual rig gives equal results for equal seeds, and its beam carries the loads in the input files."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from eimi_drivers.cameras import timed
from eimi_drivers.clock import WallClock
from eimi_lab.acquisition import open_bench
from eimi_lab.config.rig import Rig, load_rig
from eimi_lab.config.specimen import SpecimenFile, load_specimen
from eimi_lab.config.toml import parse
from eimi_lab.page import camera_alone
from eimi_lab.process.errors import InputError
from eimi_lab.virtual.virtual_rig import open_virtual_rig


@pytest.fixture(scope="module")
def specimen() -> SpecimenFile:
    return load_specimen("type1")


def rig(seed: int = 1, **of_calibration: Any) -> Rig:
    # Return the program's own virtual rig with a coarse mesh, small frames, and changed values of the calibration.
    shipped = load_rig("virtual")
    assert shipped.virtual is not None
    virtual = shipped.virtual.model_copy(
        update={"seed": seed, "mesh": (8, 1, 1), "frame_size_px": (160, 128), "current_noise_A": 0.001}
    )
    scale = {"pixels_per_mm": 3.0, "clamp_midpoint_px": (80.0, 16.0)}
    calibration = shipped.calibration.model_copy(update=scale | of_calibration)
    return shipped.model_copy(update={"virtual": virtual, "calibration": calibration})


def frame_and_readings(of: Rig, specimen: SpecimenFile, current_A: float = 0.0) -> tuple[NDArray[Any], list[float]]:
    # Return a frame at a current (A), and six currents (A) that the supply measures.
    supply, camera, clock, _ = open_virtual_rig(of, specimen)
    supply.set_voltage(of.supply.limits.voltage_V)
    supply.set_current(current_A)
    supply.set_output(True)
    clock.sleep(2.0)
    return camera.grab(1.0).image, [supply.measure().current_A for _ in range(6)]


def test_a_lens_inside_the_beam_is_refused(specimen: SpecimenFile) -> None:
    with pytest.raises(InputError, match=r"calibration: stand_off_mm = 2 .* more than half of depth_mm = 5"):
        open_virtual_rig(rig(stand_off_mm=2.0, telecentric=False), specimen)


def test_equal_seeds_give_equal_frames_and_readings_and_other_seeds_others(specimen: SpecimenFile) -> None:
    (image, read), (again, read_again), (other, read_other) = (
        frame_and_readings(rig(seed), specimen) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(image, again)
    assert read == read_again
    assert (image != other).mean() > 0.1
    assert read != read_other


def test_the_virtual_camera_takes_frames_at_its_frame_rate(specimen: SpecimenFile) -> None:
    shipped = rig()
    at_50_Hz = shipped.model_copy(update={"camera": shipped.camera.model_copy(update={"frame_rate_Hz": 50.0})})
    _, camera, _, _ = open_virtual_rig(at_50_Hz, specimen)
    assert camera.settings.frame_rate_Hz == 50.0
    times_s = [camera.grab(1.0).timestamp_s for _ in range(4)]
    assert np.diff(times_s) == pytest.approx([0.02, 0.02, 0.02])


def middle_px(image: NDArray[Any]) -> float:
    # Return the column (px) of the middle of the opaque magnet, in rows near the tip.
    dark = image[80:92] < 0.25 * np.percentile(image, 90)
    return float(np.nonzero(dark)[1].mean())


def test_a_small_step_of_the_current_moves_the_beam(specimen: SpecimenFile) -> None:
    supply, camera, clock, _ = open_virtual_rig(rig(), specimen)
    supply.set_voltage(30.0)
    supply.set_output(True)
    middles = []
    for current_A in (0.0, 0.05, 0.1):
        supply.set_current(current_A)
        clock.sleep(2.0)
        middles.append(middle_px(camera.grab(1.0).image))
    assert min(np.diff(middles)) > 0.3


def test_without_gravity_the_beam_does_not_bend(specimen: SpecimenFile) -> None:
    soft = parse(SpecimenFile, specimen.text.replace('"Dragon Skin 10"', '"Ecoflex 00-50"'), "soft")
    bent = middle_px(frame_and_readings(rig(gravity_angle_deg=70.0), soft)[0])
    straight = middle_px(frame_and_readings(rig(gravity_angle_deg=70.0, gravity=False), soft)[0])
    assert straight == pytest.approx(80.0, abs=0.5)
    assert abs(bent - straight) > 1.0


@pytest.mark.parametrize(("rig", "clock"), [("emulated_bench", time.process_time), ("bench_example", time.monotonic)])
def test_other_programs_on_the_computer_cannot_let_a_virtual_camera_miss_its_deadline(
    specimen: SpecimenFile, monkeypatch: pytest.MonkeyPatch, rig: str, clock: Callable[[], float]
) -> None:
    # The time limit counts the processor time of the run, and not the elapsed time.
    given: list[Callable[[], float]] = []

    class Opened(Exception):
        pass

    def open_timed(name: str, open_it: object, seconds: Callable[[], float], meanwhile: object = None) -> None:
        given.append(seconds)
        raise Opened

    loaded = load_rig(rig)
    coil = SimpleNamespace(clock=WallClock(), interruption=SimpleNamespace(while_waiting=None))
    monkeypatch.setattr(timed, "TimedCamera", open_timed)
    monkeypatch.setattr(camera_alone, "TimedCamera", open_timed)
    monkeypatch.setattr(open_bench, "open_coil", lambda *arguments, **options: nullcontext(coil))
    ways: list[AbstractContextManager[Any]] = [
        open_bench.open_bench(loaded, specimen, loaded.supply.limits),
        camera_alone._opened(loaded, specimen),
    ]
    for way in ways:
        with pytest.raises(Opened), way:
            pass
    assert given == [clock, clock]

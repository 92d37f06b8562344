"""Ring-downs (free vibrations) are imported from rendered videos of a horizontal silicone strip that was flicked."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import curve_fit

from eimi_fitting.time.measured import Motion
from eimi_lab.config.toml import to_toml
from eimi_lab.dataset.reading import open_dataset
from tests.shared.filmed_beam import LEVEL, STRIP, Flick

Run = Callable[..., tuple[int, str]]
Array = NDArray[np.float64]


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    # A folder with the specimen file and the calibration file of the rendered silicone strip.
    (tmp_path / "strip.toml").write_text(to_toml(STRIP))
    (tmp_path / "level.toml").write_text(to_toml(LEVEL))
    return tmp_path


def imported(run: Run, bench: Path, film: Flick, *options: object) -> tuple[int, str]:
    video = film.write(bench / "flick.avi")
    files = ("--specimen", bench / "strip.toml", "--calibration", bench / "level.toml")
    return run("import", video, "--ring-down", *files, "-o", bench / "flick.h5", *options)


def ring_down(bench: Path) -> Motion:
    with open_dataset(bench / "flick.h5") as dataset:
        (motion,) = dataset.ring_downs()
    return motion


def damped(time: Array, place: Array, frequency_Hz: float) -> Array:
    # Fit a damped oscillation; return mean, amplitude, decay (1/s), frequency (Hz) and phase (rad).
    def model(t: Array, mean: float, size: float, decay: float, frequency: float, phase: float) -> Array:
        return np.asarray(mean + size * np.exp(-decay * t) * np.cos(2 * np.pi * frequency * t + phase))

    start = [place.mean(), np.ptp(place) / 2, 1.0, frequency_Hz, 0.0]
    return np.asarray(curve_fit(model, time, place, start)[0])


def test_the_frequency_and_the_decay_of_a_flick_are_those_of_the_strip(run: Run, bench: Path) -> None:
    film = Flick(seconds=0.8)
    code, message = imported(run, bench, film, "--released", "0")
    assert code == 0, message
    motion = ring_down(bench)
    assert motion.points_mm.shape[0] == len(film.times_s)
    assert motion.seen.all()
    np.testing.assert_allclose(motion.time_s[:, -1], film.times_s, atol=1e-4)
    _, _, decay, frequency, _ = damped(motion.time_s[:, -1], motion.points_mm[:, -1, 1], 6.0)
    assert frequency == pytest.approx(film.frequency_Hz, rel=2e-3)
    assert decay == pytest.approx(film.decay_per_s, rel=0.02)
    truth = np.stack([film.centre_mm(motion.rest_mm[:, 0], time) for time in film.times_s])
    error = motion.points_mm - truth
    assert np.sqrt((error**2).mean()) < 0.01  # a tenth of a pixel
    assert np.sqrt((error[..., 1].std(axis=0) ** 2).mean()) == pytest.approx(
        np.sqrt((motion.sigma_mm**2).mean()), rel=0.7
    )


def test_a_phones_shutter_and_exposure_do_not_change_the_phase_along_the_strip(run: Run, bench: Path) -> None:
    film = Flick(seconds=0.4, rate_Hz=240.0, exposure_s=3e-3, row_time_s=2.5e-5, tilt=0.05)
    shutter = ("--released", "0", "--exposure", "0.003", "--row-time", "2.5e-5")
    assert imported(run, bench, film, *shutter)[0] == 0
    motion = ring_down(bench)
    assert motion.exposure_s == 0.003
    assert np.ptp(motion.time_s[0]) > 1e-4  # the rows of pixels that show the sagged strip have different times
    fits = [damped(motion.time_s[:, p], motion.points_mm[:, p, 1], 6.0) for p in range(8, motion.rest_mm.shape[0])]
    phases = np.array([fit[4] for fit in fits])
    assert np.ptp(phases) < 0.02
    assert np.median([fit[3] for fit in fits]) == pytest.approx(film.frequency_Hz, rel=3e-3)


def test_the_frame_rate_of_slow_motion_comes_from_the_user(run: Run, bench: Path) -> None:
    film = Flick(seconds=0.3, rate_Hz=120.0)
    assert imported(run, bench, film, "--released", "0", "--rate", "240")[0] == 0
    np.testing.assert_allclose(ring_down(bench).time_s[:, 0], np.arange(36) / 240.0, atol=1e-9)


def test_a_video_gives_states_and_a_motion_to_one_dataset(run: Run, bench: Path) -> None:
    (bench / "states.csv").write_text("frame,field_mT\n35,0\n")
    code, message = imported(run, bench, Flick(seconds=0.3), "--states", bench / "states.csv", "--released", "0")
    assert code == 0, message
    with open_dataset(bench / "flick.h5") as dataset:
        assert len(dataset.states) == 1
        assert dataset.kind == "frames"
        assert len(dataset.ring_downs()) == 1


def test_the_format_of_a_tracking_program_is_refused_for_a_video(run: Run, bench: Path) -> None:
    code, message = imported(run, bench, Flick(seconds=0.1), "--format", "deeplabcut")
    assert code == 2
    assert "--format: is for the file of a tracking program, not for a video" in message


def test_a_video_without_a_beam_is_refused(run: Run, bench: Path) -> None:
    (bench / "level.toml").write_text(to_toml(LEVEL.model_copy(update={"clamp_midpoint_px": (500.0, 20.0)})))
    code, message = imported(run, bench, Flick(seconds=0.1))
    assert code == 2
    assert "no beam was found in the first 12 frames" in message

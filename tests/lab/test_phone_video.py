"""Videos of a phone are imported, although their frame times are irregular and the camera moves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import eimi_lab as eimi
from eimi_lab.config.specimen import Beam, SpecimenFile
from eimi_lab.config.toml import to_toml
from eimi_lab.dataset.moving.clicked_line import clicked_calibration, with_measured_axis
from eimi_lab.dataset.moving.video_times import capture_rate_Hz, recorded_times
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.dataset.videos import frame_times, looked_through
from eimi_lab.process.errors import InputError
from eimi_lab.vision.tracking.steady_view import SteadyView
from tests.shared.filmed_beam import LEVEL, STRIP, Flick
from tests.shared.mp4_boxes import state_capture_rate, state_times
from tests.shared.phone_films import SIGMAS, clicked_line, drawn_film, typed_sizes

Run = Callable[..., tuple[int, str]]


def video(path: Path, times_s: np.ndarray, rate_Hz: float = 240.0) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), rate_Hz, (64, 48))
    for number in range(len(times_s)):
        writer.write(np.full((48, 64, 3), number, np.uint8))
    writer.release()
    state_times(path, list(times_s))
    return path


def test_a_variable_frame_rate_keeps_its_intervals(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    true_s = np.arange(40) / 240.0
    true_s = true_s[(np.arange(40) % 7) != 3]
    path = video(tmp_path / "flick.mp4", true_s)
    np.testing.assert_allclose(recorded_times(path, frame_times(path), None), true_s, atol=1e-4)
    assert "240 frames per second according to the times in the file" in capsys.readouterr().err
    # A rate on the command line scales the intervals: the interval of a lost frame stays longer.
    np.testing.assert_allclose(recorded_times(path, frame_times(path), 120.0), 2 * true_s, atol=2e-4)


def test_the_frame_rate_of_slow_motion_comes_from_the_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = video(tmp_path / "slow.mp4", np.arange(30) / 30.0)
    assert capture_rate_Hz(path) is None
    recorded_times(path, frame_times(path), None)
    assert "if this is slow motion, give the rate of the recording with --rate" in capsys.readouterr().err
    state_capture_rate(path, 240.0)
    assert capture_rate_Hz(path) == 240.0
    np.testing.assert_allclose(recorded_times(path, frame_times(path), None), np.arange(30) / 240.0, atol=1e-5)
    assert "is played at 30 and was recorded at 240 frames per second" in capsys.readouterr().err
    # The rate of the user replaces the rate in the file.
    np.testing.assert_allclose(recorded_times(path, frame_times(path), 120.0), np.arange(30) / 120.0, atol=1e-5)


def test_a_file_that_is_no_mp4_has_no_rate_of_slow_motion(tmp_path: Path) -> None:
    keyless = b"\0\0\0\x20moov\0com.android.capture.fps"
    for content in (b"", b"RIFF", b"\0" * 40, b"\0\0\0\x10moov" + b"\xff" * 8, keyless):
        (tmp_path / "x.mp4").write_bytes(content)
        assert capture_rate_Hz(tmp_path / "x.mp4") is None


def test_a_video_whose_times_do_not_increase_needs_a_rate(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="with --rate"):
        recorded_times(tmp_path / "x.avi", np.zeros(20), None)
    np.testing.assert_allclose(recorded_times(tmp_path / "x.avi", np.zeros(20), 100.0), np.arange(20) / 100.0)


def test_only_few_frames_of_a_long_video_are_stored(tmp_path: Path) -> None:
    times, kept = looked_through(video(tmp_path / "long.mp4", np.arange(200) / 240.0), 2)
    assert len(times) == 200
    assert len(kept) <= 16
    assert max(kept) >= 180


def test_the_motion_of_the_camera_is_removed_from_the_frames() -> None:
    rng = np.random.default_rng(3)
    wall = cv2.GaussianBlur(rng.uniform(0, 255, (360, 560)).astype(np.float32), (0, 0), 2.0)
    wall = np.clip((wall - wall.mean()) * 6 + 128, 0, 255).astype(np.uint8)
    view = SteadyView(wall, np.array([[200.0, 150.0], [400.0, 150.0], [400.0, 220.0], [200.0, 220.0]]))
    inner = (slice(60, 300), slice(60, 500))
    assert view.steadied(wall) is wall
    for shift in ((0.6, -0.4), (7.3, 4.1), (-12.2, 9.7)):
        moved = cv2.warpAffine(
            wall, np.array([[1.0, 0.004, shift[0]], [-0.004, 1.0, shift[1]]]), (560, 360), flags=cv2.INTER_CUBIC
        )
        rest = view.steadied(moved)[inner].astype(float) - wall[inner]
        assert np.abs(rest).mean() < 0.35 * np.abs(moved[inner].astype(float) - wall[inner]).mean()
    assert 12.0 < view.moved_px < 25.0


def test_clicks_give_a_calibration_whose_axis_is_corrected_by_the_beam_at_rest() -> None:
    film = Flick(sag_mm=3.0)
    along = np.linspace(2.0, 39.0, 24)
    rest_px = film.to_px(film.centre_mm(along, 1e6))
    clicked = clicked_calibration([(61.0, 152.5), (260.0, 163.0), (458.0, 180.0)], STRIP, None, "flick.mp4")
    corrected = with_measured_axis(clicked, rest_px, along, has_tip_load=True)
    assert corrected.axis_angle_deg == pytest.approx(0.0, abs=0.3)
    assert corrected.clamp_midpoint_px[1] == pytest.approx(LEVEL.clamp_midpoint_px[1], abs=0.5)
    assert f"{corrected.axis_angle_deg:.3f}"[:5] in corrected.text
    with pytest.raises(InputError, match="the points should follow the beam from the clamp to the tip"):
        clicked_calibration([(61.0, 152.5), (65.0, 153.0)], STRIP, None, "flick.mp4")


def test_a_video_without_a_calibration_asks_for_points_on_the_beam(run: Run, tmp_path: Path) -> None:
    (tmp_path / "strip.toml").write_text(to_toml(STRIP))
    film = Flick(seconds=1.2, frequency_Hz=8.0, decay_per_s=3.0)
    source = film.write(tmp_path / "flick.avi")
    arguments = ("import", source, "--ring-down", "--specimen", tmp_path / "strip.toml", "-o", tmp_path / "flick.h5")
    code, message = run(*arguments)
    assert code == 2
    assert "flick_where.png shows the beam at rest with rulers in px" in message
    assert (tmp_path / "flick_where.png").is_file()
    code, message = run(*arguments, "--along", "61,151 260,158 458,171", "--released", "0")
    assert code == 0, message
    with open_dataset(tmp_path / "flick.h5") as dataset:
        (motion,) = dataset.ring_downs()
        assert dataset.calibration is not None
        assert dataset.calibration.axis_angle_deg == pytest.approx(0.0, abs=0.5)
    assert motion.seen.mean() > 0.95
    code, message = run(*arguments, "--along", "61,20 260,20 458,20", "--force")
    assert (code, "read the pixels of three points on its centre line" in message) == (2, True), message


@pytest.mark.slow
def test_a_video_of_a_phone_gives_the_true_modulus_of_a_strip(tmp_path: Path) -> None:
    film = replace(drawn_film(0, 0.5), seconds=1.8, shake_px=2.0)
    rng = np.random.default_rng(5)
    beam = Beam(name="strip", material="silicone", **typed_sizes(film, rng))
    strip = SpecimenFile(specimen=beam, uncertainty=SIGMAS)
    film.write(tmp_path / "flick.mp4")
    eimi.import_motion(tmp_path / "flick.mp4", strip, tmp_path / "flick.h5", along=clicked_line(film, rng)).close()
    law = eimi.fit(tmp_path / "flick.h5", "neo-hookean", time="prony").time
    assert law is not None
    assert law.frequency_Hz == pytest.approx(film.strip.frequency_Hz, rel=1e-3)
    assert law.dynamic_shear_modulus.value == pytest.approx(film.strip.dynamic_Pa, rel=0.05)

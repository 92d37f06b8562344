"""A recording is divided at each brief push of the beam; release times and other results agree with formulas."""

from __future__ import annotations

import math
import struct
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from eimi_fitting.beam.strip import Strip
from eimi_fitting.time.measured import Motion
from eimi_lab.config.csv_tables import Column, Row
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset import state_loads
from eimi_lab.dataset.logged_sensor import LoggedSensor, SensorLog
from eimi_lab.dataset.measured_field import field_line, measured_line
from eimi_lab.dataset.measured_heating import MeasuredHeating, coil_heating, measured_heating
from eimi_lab.dataset.moving import (
    film,
    filmed_motion,
    flicks,
    free_motion,
    motion_csv,
    recorded_motion,
    tracked_motion,
    video_times,
)
from eimi_lab.dataset.moving.beam_modes import cantilever_modes, modal_amplitudes_mm, tip_angles_deg
from eimi_lab.dataset.moving.clicked_line import clicked_calibration, clicked_from_changes, with_measured_axis
from eimi_lab.dataset.moving.film import Film
from eimi_lab.dataset.moving.free_motion import FEWEST_FRAMES
from eimi_lab.dataset.moving.motion_facts import MotionFacts
from eimi_lab.dataset.moving.recording_checks import LOST, SLOW, flagged_lines, recordings_in_words
from eimi_lab.dataset.steps import SetPoint
from eimi_lab.dataset.tracked import points_csv
from eimi_lab.dataset.tracked.axes import Placing
from eimi_lab.dataset.tracked.tracks import Tracks
from eimi_lab.fits import tensile_files
from eimi_lab.process.errors import InputError
from eimi_lab.vision.beam_frame import BeamFrame

Array = NDArray[np.float64]
NAN = math.nan
SPECIMEN = load_specimen(Path(__file__).parents[2] / "protocols" / "specimens" / "type1.toml")
"""A beam of 30 x 3 x 5 mm with a density of 1070 kg/m3."""


def motion(points: Any, rest: Any, **more: Any) -> Motion:
    # Return a motion of points in frames that are 0.1 s apart.
    places, at_rest = np.array(points, float), np.array(rest, float)
    time_s = np.repeat(0.1 * np.arange(len(places))[:, None], len(at_rest), axis=1)
    return Motion("ring_down", places, at_rest, time_s, np.full(time_s.shape, 0.01), **more)


# Modes and angles


def test_the_modes_are_those_of_a_uniform_cantilever() -> None:
    # Blevins 1979, table 8-1: the second mode is 0 at 0.783 L, the third at 0.504 L and 0.868 L; all are 0 at 0.
    modes = cantilever_modes(np.array([0.0, 1e-4, 0.7834, 0.5036, 0.8677, 1.0]))
    np.testing.assert_allclose(modes[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(modes[1], 0.0, atol=1e-5)  # no deflection and no slope at the clamp
    assert modes[2, 1] == pytest.approx(0.0, abs=1e-3)
    assert modes[3, 2] == pytest.approx(0.0, abs=1e-3)
    assert modes[4, 2] == pytest.approx(0.0, abs=1e-3)
    np.testing.assert_allclose(modes[5], 1.0)


def test_the_amplitudes_of_the_modes_are_found_again() -> None:
    along = np.array([10.0, 20.0, 25.0, 30.0])
    amplitudes = np.array([[1.0, 0.2, -0.1], [-1.0, 0.1, 0.1], [0.0, -0.3, 0.0]])
    places = np.stack([np.tile(along, (3, 1)), amplitudes @ cantilever_modes(along / 30.0).T + 5.0], axis=-1)
    rest = np.column_stack([along, np.zeros(4)])
    np.testing.assert_allclose(modal_amplitudes_mm(motion(places, rest), 30.0), amplitudes, atol=1e-6)
    places[1, 1:] = NAN
    found = modal_amplitudes_mm(motion(places, rest), 30.0)
    assert np.isnan(found[1]).all()
    assert np.isfinite(found[[0, 2]]).all()
    pair = motion(places[[0, 2]][:, [0, 3]], rest[[0, 3]])
    assert modal_amplitudes_mm(pair, 30.0).shape == (2, 2)
    np.testing.assert_allclose(
        modal_amplitudes_mm(pair, 30.0) @ cantilever_modes(along[[0, 3]] / 30.0)[:, :2].T,
        places[[0, 2]][:, [0, 3], 1] - places[[0, 2]][:, [0, 3], 1].mean(axis=0),
        atol=1e-6,
    )
    assert np.isfinite(modal_amplitudes_mm(motion(places[[0, 2]][:, 1:], rest[1:]), 30.0)).all()


def test_the_mean_position_of_a_point_is_that_of_the_frames_in_which_it_is_seen() -> None:
    rest = np.array([[5.0, 0.0], [10.0, 0.0], [20.0, 0.0], [30.0, 0.0]])
    places = np.tile(rest, (3, 1, 1))
    places[..., 1] = 5.0
    places[1, 0] = NAN
    np.testing.assert_allclose(modal_amplitudes_mm(motion(places, rest), 30.0), np.zeros((3, 3)), atol=1e-9)


def test_the_angle_of_the_tip_is_that_of_the_last_two_points() -> None:
    rest = [[30.0, 1.0], [10.0, 0.0], [20.0, 0.0]]  # the last two are at 20 and 30 mm
    frames = [[[30, 1], [0, 0], [20, 0]], [[20, 11], [0, 0], [20, 1]], [[NAN, 0], [0, 0], [20, 0]]]
    at_rest = math.degrees(math.atan2(1, 10))
    found = tip_angles_deg(motion(frames, rest))
    np.testing.assert_allclose(found, [0.0, 90.0 - at_rest, NAN], atol=1e-9)
    assert np.isnan(tip_angles_deg(motion([[[30, 1], [30, 0]]], [[30.0, 1.0], [30.0, 0.0]]))).all()
    assert np.isnan(tip_angles_deg(motion([[[30, 1]]], [[30.0, 1.0]]))).all()


# Flicks


def ringing(flick_s: float, time_s: Array) -> Array:
    # Return the deflection of a beam that is flicked by 10 mm, swings at 5 Hz, and halves its amplitude in 0.5 s.
    after = np.maximum(time_s - flick_s, 0.0)
    return (time_s >= flick_s) * 10.0 * 0.5 ** (after / 0.5) * np.cos(2 * np.pi * 5.0 * after)


def flicked(*flick_s: float, last_s: float) -> tuple[Array, Array]:
    # Return the times of frames, 100 in a second, and the places of two points of a beam after several flicks.
    time_s = np.arange(0.0, last_s, 0.01)
    moved = np.zeros(len(time_s))
    for begins in flick_s:
        moved[time_s >= begins] = ringing(begins, time_s)[time_s >= begins]
    places = np.zeros((len(time_s), 2, 2))
    places[:, 0, 1], places[:, 1, 1] = 0.3 * moved, moved
    return time_s, places


def test_each_flick_begins_a_part_near_its_time() -> None:
    time_s, places = flicked(1.0, 5.0, 9.0, last_s=13.0)
    parts = flicks.parts_of(time_s, places)
    assert [first for first, _ in parts] == [0, parts[0][1], parts[1][1]]
    assert parts[-1][1] == len(time_s)
    for (first, _), begins in zip(parts[1:], (5.0, 9.0), strict=True):
        assert begins - 0.35 <= time_s[first] <= begins
    gaps = places.copy()
    gaps[30:40] = NAN
    gaps[:, 0] = NAN
    assert flicks.parts_of(time_s, gaps) == parts
    gaps[: len(gaps) // 2 + 1] = NAN
    assert flicks.parts_of(time_s, gaps) == [(0, len(time_s))]


@pytest.mark.parametrize(("periods", "parts"), [(5.0, 1), (8.0, 2)])
def test_a_part_needs_six_periods(periods: float, parts: int) -> None:
    # The period is 0.2 s; the last flick is followed by some periods. One part is left, if the last is too short.
    time_s, places = flicked(1.0, 5.0, last_s=5.0 + 0.2 * periods)
    found = flicks.parts_of(time_s, places)
    assert len(found) == parts
    assert found[0][0] == 0
    assert (found[-1][1] == len(time_s)) == (parts == 2)


@pytest.mark.parametrize(("share", "parts"), [(0.14, 1), (0.16, 2)])
def test_a_push_below_15_percent_of_the_greatest_is_no_flick(share: float, parts: int) -> None:
    # The pushes last 0.3 s, so that they have no frequencies that count as noise.
    time_s = np.arange(0.0, 9.0, 0.01)
    places = np.zeros((len(time_s), 1, 2))
    for begins, size in ((1.0, 1.0), (5.0, share)):
        after = np.maximum(time_s - begins, 0.0)
        pushed = 0.5 - 0.5 * np.cos(np.pi * np.minimum(after / 0.3, 1.0))
        places[:, 0, 1] += size * pushed * 0.5 ** (after / 0.5) * np.sin(2 * np.pi * 5 * after)
    assert len(flicks.parts_of(time_s, places)) == parts


def test_a_short_recording_or_one_without_vibration_is_one_part() -> None:
    time_s, places = flicked(0.0, 1.1, last_s=2.2)
    assert flicks.parts_of(time_s, places) == [(0, len(time_s))]
    assert flicks.parts_of(time_s, np.zeros_like(places)) == [(0, len(time_s))]


@pytest.mark.parametrize("frames", [10, 20, 33])
def test_the_period_of_the_strongest_vibration_is_counted_in_frames(frames: int) -> None:
    time = np.arange(1000)
    drift = 100.0 * np.sin(np.pi * time / 1000)
    assert flicks._period(np.sin(2 * np.pi * time / frames) + drift, 50.0) == frames
    assert flicks._period(np.sin(2 * np.pi * time / frames) + np.sin(2 * np.pi * time / 2.5), 50.0) == frames
    assert flicks._period(np.zeros(1000), 50.0) == 1000


@pytest.mark.parametrize(("frames", "divides"), [(2, False), (3, True), (39, True), (40, False)])
def test_a_vibration_is_divided_if_its_period_has_three_frames_and_twelve_fit(
    monkeypatch: pytest.MonkeyPatch, frames: int, divides: bool
) -> None:
    # 480 frames: twelve periods of 40 frames.
    asked: list[Any] = []

    def measured(moved: Array, period: int) -> float:
        asked.append(period)
        raise ZeroDivisionError

    monkeypatch.setattr(flicks, "_period", lambda moved, rate_Hz: frames)
    monkeypatch.setattr(flicks, "_white_noise", measured)
    time_s, places = flicked(1.0, last_s=4.8)
    assert len(time_s) == 480
    with pytest.raises(ZeroDivisionError) if divides else nullcontext():
        assert flicks.parts_of(time_s, places) == [(0, 480)]
    assert asked == [frames] * divides


def test_white_noise_is_measured_beside_a_vibration() -> None:
    noise = np.random.default_rng(1).normal(0.0, 0.25, 4000)
    vibration = 10.0 * np.sin(2 * np.pi * np.arange(4000) / 40)
    assert flicks._white_noise(noise + 3.0, 40) == pytest.approx(0.25, rel=0.05)
    assert flicks._white_noise(noise + vibration, 40) == pytest.approx(0.25, rel=0.05)


@pytest.mark.parametrize(
    ("rise", "fall", "abrupt"), [(3, 100, True), (100, 100, False), (70, 100, True), (14, 1, True)]
)
def test_a_flick_rises_faster_than_it_falls(rise: int, fall: int, abrupt: bool) -> None:
    # The amplitude is below a third of its maximum before `rise` frames, and again after `fall`; a period is 10.
    size = np.concatenate([np.ones(40), np.full(rise - 1, 4.0), [9.0], np.full(fall - 1, 4.0), np.ones(200)])
    assert flicks._is_abrupt(size, 40 + rise - 1, 10) is abrupt


# Where a motion begins


def moving_points(frames: int = 40, released: int = 10, step_s: float = 0.1) -> dict[str, Array]:
    # Return two points of a beam that is held at y = 5 mm until the frame `released`, and then swings.
    after = np.maximum(np.arange(frames) - released, 0)
    moved = 5.0 * 0.9**after * np.cos(2 * np.pi * after / 6)
    places = np.zeros((frames, 2, 2))
    places[:, 1, 1], places[:, 0, 1] = moved, 0.1 * moved
    time_s = np.repeat(step_s * np.arange(frames)[:, None], 2, axis=1)
    return {
        "points_mm": places,
        "rest_mm": np.zeros((2, 2)),
        "time_s": time_s,
        "sigma_mm": np.full((frames, 2), 0.01),
    }


def ring_down(facts: dict[str, Any] | None = None, **changes: Any) -> Motion:
    given = moving_points() | changes
    return free_motion.free_motion(**given, facts=MotionFacts(**{"kind": "ring_down"} | (facts or {})), origin="f")


def test_a_motion_begins_in_the_last_frame_near_its_greatest_deflection(capsys: pytest.CaptureFixture[str]) -> None:
    found = ring_down({"hanging_N": 0.5, "exposure_s": 0.01})
    assert len(found.time_s) == 30
    np.testing.assert_allclose(found.time_s[:, 0], 0.1 * np.arange(30), atol=1e-12)
    assert found.points_mm[0, 1, 1] == 5.0
    assert found.step_uncertainty_s == pytest.approx(0.1)
    assert (found.hanging_N, found.tip_force_N, found.exposure_s, found.lost_frames) == (0.5, 0.0, 0.01, 0)
    assert (
        "the release is assumed at 1 s, in the last frame with at least 97% of the largest" in capsys.readouterr().err
    )


def test_a_stated_release_is_known_within_a_frame(capsys: pytest.CaptureFixture[str]) -> None:
    # A time between two frames has the standard uncertainty of a frame's interval divided by the root of 12.
    found = ring_down({"released_s": 1.14})
    assert len(found.time_s) == 28
    assert found.time_s[0, 0] == pytest.approx(0.06)
    assert found.step_uncertainty_s == pytest.approx(0.1 / math.sqrt(12.0))
    assert capsys.readouterr().err == ""
    assert len(ring_down({"released_s": 1.2}).time_s) == 28
    assert len(ring_down({"released_s": -0.1}).time_s) == 40
    for released_s in (-0.11, 4.0):
        with pytest.raises(InputError, match=r"--released .*: should be a time within f, from 0 to 3\.9 s"):
            ring_down({"released_s": released_s})
    with pytest.raises(InputError, match=r"--released 4\.875: should be a time within f, from 0 to 4\.875 s"):
        ring_down({"released_s": 4.875}, **moving_points(step_s=0.125))  # the last frame
    assert len(ring_down({"released_s": 3.2}).time_s) == 8
    with pytest.raises(InputError, match=r"only 7 frames follow the release at 3\.3 s; a motion needs at least 8"):
        ring_down({"released_s": 3.3})


def test_lost_frames_are_counted_by_the_gaps_after_the_release() -> None:
    given = moving_points()
    time_s = given["time_s"].copy()
    time_s[5:] += 0.3
    time_s[20:] += 0.2  # two frames are missing
    time_s[30:] += 0.04  # no frame is missing
    assert ring_down(time_s=time_s).lost_frames == 2
    assert ring_down({"kind": "creep", "removed_N": 0.1}, time_s=time_s).lost_frames == 0
    assert ring_down({"kind": "creep", "removed_N": 0.1}, time_s=time_s).tip_force_N == 0.1
    time_s[35:] += 0.06  # the interval is 1.6 times as long as usual
    assert ring_down(time_s=time_s).lost_frames == 3


def test_a_recording_that_cannot_be_used_is_refused() -> None:
    for frames, words in ((7, "has 7 frames; a motion needs at least 8 frames"), (8, "only")):
        given = moving_points(frames, released=4)
        with pytest.raises(InputError, match=words):
            ring_down(**given)
    assert len(ring_down({"released_s": 0.0}, **moving_points(8)).time_s) == 8
    given = moving_points()
    given["time_s"][12:] -= 0.1
    with pytest.raises(
        InputError, match=r"frame 12 \(counted from 0\) has the time 1.1 s, which should be later than 1"
    ):
        ring_down(**given)
    given = moving_points()
    given["points_mm"][..., 0] = NAN
    with pytest.raises(InputError, match="no frame has a point of the beam"):
        ring_down(**given)


def test_the_deflection_is_measured_from_the_last_quarter() -> None:
    # A beam that begins at its position at rest and ends bent is released where it is farthest from its end.
    places = np.zeros((40, 1, 2))
    places[:, 0, 1] = np.where(np.arange(40) < 12, 0.0, 3.0)
    assert free_motion._release(places) == 11
    places[30:, 0, 1] = np.where(np.arange(10) % 2, 3.5, 2.5)  # the mean of the last quarter is 3
    places[3:6] = NAN
    assert free_motion._release(places) == 11
    places[12] = [0.0, 3.0 - 0.971 * 3.0]
    assert free_motion._release(places) == 12
    places[12] = [0.0, 3.0 - 0.969 * 3.0]
    assert free_motion._release(places) == 11


def several(facts: MotionFacts, *flick_s: float, last_s: float) -> tuple[Motion, ...]:
    frame_s, places = flicked(*flick_s, last_s=last_s)
    time_s = np.repeat(frame_s[:, None], 2, axis=1)
    return free_motion.free_motions(places, np.zeros((2, 2)), time_s, np.full(time_s.shape, 0.01), facts, "f")


def test_several_flicks_are_several_motions(capsys: pytest.CaptureFixture[str]) -> None:
    first, second = several(MotionFacts(kind="ring_down"), 1.0, 5.0, last_s=9.0)
    assert (first.label, second.label) == ("f: flick 1", "f: flick 2")
    assert (first.time_s[0, 0], second.time_s[0, 0]) == (0.0, 0.0)
    assert second.time_s[-1, 0] == pytest.approx(3.99, abs=0.02)
    notes = capsys.readouterr().err
    assert "f: 2 ring-downs of at least 6 periods were found" in notes
    (only,) = several(MotionFacts(kind="ring_down", released_s=1.0), 1.0, 5.0, last_s=9.0)
    assert only.label == "f"
    assert 3.5 < only.time_s[-1, 0] < 4.0
    assert "the motion ends at 4." in capsys.readouterr().err
    (last,) = several(MotionFacts(kind="ring_down", released_s=5.0), 1.0, 5.0, last_s=9.0)
    assert last.time_s[-1, 0] == pytest.approx(3.99)
    assert capsys.readouterr().err == ""
    (whole,) = several(MotionFacts(kind="creep", hanging_N=0.1, released_s=0.0), 1.0, 5.0, last_s=9.0)
    assert len(whole.time_s) == 900
    assert capsys.readouterr().err == ""
    (creep,) = several(MotionFacts(kind="creep"), 1.0, 5.0, last_s=9.0)
    assert "a fit uses creep only after a known change of the load" in capsys.readouterr().err
    (short,) = several(MotionFacts(kind="ring_down"), 1.0, 5.0, last_s=6.0)
    assert (short.label, creep.label) == ("f", "f")
    assert "only the ring-down from 0 to 4." in capsys.readouterr().err


# Tables


HEAD = "{},point,x0_mm,y0_mm,x_mm,y_mm,sigma_mm\n"


def table(tmp_path: Path, rows: list[str], clock: str = "frame", rate_Hz: float | None = 50.0) -> Motion:
    path = tmp_path / "flick.csv"
    path.write_text(HEAD.format(clock) + "\n".join(rows))
    facts = MotionFacts(kind="ring_down", rate_Hz=rate_Hz, released_s=0.0)
    (only,) = motion_csv.read_motion_csv(path, SPECIMEN, facts)
    return only


@pytest.mark.parametrize(
    ("head", "row", "problem"),
    [
        (
            "point,x0_mm",
            "a,10",
            "row 1: the columns time_s and frame are missing; add time_s, or add frame and give --r",
        ),
        ("time_s,point,x0_mm", "0.1,a,10", "row 1: --rate needs the column frame; a table with the column time_s"),
        ("frame,point,x0_mm", "1,a,30.6", r"row 2: x0_mm = .* on the beam, from 0 to length_mm = 30"),
    ],
)
def test_a_table_without_times_or_with_a_point_beside_the_beam_is_refused(
    tmp_path: Path, head: str, row: str, problem: str
) -> None:
    path = tmp_path / "flick.csv"
    path.write_text(f"{head},y0_mm,x_mm,y_mm,sigma_mm\n{row},0,10,0,0.01\n")
    facts = MotionFacts(kind="ring_down", rate_Hz=50.0, released_s=0.0)
    with pytest.raises(InputError, match=problem):
        motion_csv.read_motion_csv(path, SPECIMEN, facts)


ROW = {"point": "a", "x0_mm": "10", "y0_mm": "0", "z_mm": "0", "sigma_mm": "0.01", "x_mm": "10", "y_mm": "0"}


@pytest.mark.parametrize(
    ("good", "bad", "problem"),
    [
        ({"x0_mm": "30"}, {"x0_mm": "30.001"}, "on the beam, from 0 to length_mm = 30"),
        ({"x0_mm": "0"}, {"x0_mm": "-0.001"}, "on the beam, from 0 to length_mm = 30"),
        ({"y0_mm": "-1.5"}, {"y0_mm": "-1.501"}, "on the beam, .*width_mm = 3"),
        ({"z_mm": "2.5"}, {"z_mm": "2.501"}, "in the beam, .*depth_mm = 5"),
        ({"sigma_mm": "0.001"}, {"sigma_mm": "0"}, "greater than 0"),
        ({"point": "n" * 64}, {"point": "n" * 65}, "a name of at most 64 bytes"),
        ({"point": "é" * 32}, {"point": "é" * 33}, "a name of at most 64 bytes"),
    ],
)
def test_a_tracked_point_lies_on_the_beam(good: dict[str, str], bad: dict[str, str], problem: str) -> None:
    tracked = points_csv._tracked([Row(Path("points.csv"), 2, ROW | good)], SPECIMEN)
    assert tracked.names == ((ROW | good)["point"],)
    with pytest.raises(InputError, match=problem):
        points_csv._tracked([Row(Path("points.csv"), 2, ROW | bad)], SPECIMEN)


def test_the_frames_of_a_table_become_times(tmp_path: Path) -> None:
    rows = [
        f"{k},{name},{x},0,{x + k},{2 * k},{sigma}"
        for k in range(8)
        for name, x, sigma in (("a", 10, 0.1), ("b", 20, 0.2))
    ]
    found = table(tmp_path, rows[:5] + rows[6:])  # point b was not seen in frame 2
    np.testing.assert_allclose(found.time_s, np.repeat(np.arange(8)[:, None] / 50.0, 2, axis=1))
    np.testing.assert_allclose(found.points_mm[3], [[13, 6], [23, 6]])
    np.testing.assert_allclose(found.points_mm[2], [[12, 4], [NAN, NAN]])
    np.testing.assert_allclose(found.sigma_mm[2], [0.1, NAN])
    np.testing.assert_allclose(found.rest_mm, [[10, 0], [20, 0]])
    seconds = [row.replace(",", "0,", 1) for row in rows]  # times 0, 10, 20, ... s
    assert table(tmp_path, seconds, "time_s", None).time_s[-1, 0] == 70.0
    both = [row.replace(",", f",{0.1 * int(row.split(',')[0]) + 0.01 * (',b,' in row)},", 1) for row in rows]
    found = table(tmp_path, both, "frame,time_s", None)
    np.testing.assert_allclose(found.time_s[3], [0.3, 0.31])


@pytest.mark.parametrize(
    ("clock", "rate_Hz", "row", "words"),
    [
        ("time_s", 50.0, "", "row 1: --rate needs the column frame"),
        ("frame", None, "", "row 1: the column time_s is missing; give --rate"),
        ("", 50.0, "", "row 1: the columns time_s and frame are missing|is not a known column"),
        ("frame", 50.0, "3,a,10,0,1,1,0.1", "row 10: point a appears twice in one frame"),
        ("frame", 50.0, "9,a,11,0,1,1,0.1", "row 10: x0_mm = '11' should be the same in every frame; a was at 10, 0"),
        ("frame", 50.0, "9,a,10,0.5,1,1,0.1", "row 10: x0_mm = '10' should be the same in every frame; a was at 10, 0"),
        ("frame", 50.0, "9,b,31,0,1,1,0.1", "row 10: x0_mm = '31' should be on the beam"),
    ],
)  # fmt: skip
def test_a_wrong_row_of_a_motion_is_named(
    tmp_path: Path, clock: str, rate_Hz: float | None, row: str, words: str
) -> None:
    rows = [f"{k},a,10,0,10,{k},0.1" for k in range(8)]
    with pytest.raises(InputError, match=words):
        table(tmp_path, [*rows, *([row] if row else [])], clock, rate_Hz)


def tracked(monkeypatch: pytest.MonkeyPatch, facts: MotionFacts, tool: str = "dltdv", **more: Any) -> Motion:
    # Return the motion of three markers that swing by 1 mm, at (10, 0), (31, 1.7) and (32, 0) mm at rest.
    rest = np.array([[10.0, 0.0], [31.0, 1.7], [32.0, 0.0]])
    swing = np.cos(2 * np.pi * np.arange(20) / 5)
    places = np.tile(rest, (20, 1, 1))
    places[..., 1] += swing[:, None]
    tracks = Tracks(names=("a", "b", "c"), frames=np.arange(100, 120), places=places, rest=rest, unit="mm", **more)
    monkeypatch.setattr(tracked_motion, "reader_of", lambda name: lambda path: tracks)
    placing = Placing(clamp=(0.0, 0.0), axis_deg=0.0, sigma=0.02)
    (only,) = tracked_motion.read_tracked_motion(Path("t.csv"), tool, SPECIMEN, placing, facts)
    return only


def test_markers_beside_the_beam_move_with_their_nearest_point(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    # 5 % of 30 mm are 1.5 mm: the marker at 31 mm counts, and the marker at 32 mm does not.
    found = tracked(monkeypatch, MotionFacts(kind="ring_down", rate_Hz=50.0, released_s=0.0))
    np.testing.assert_allclose(found.rest_mm, [[10, 0], [30, 1.5]])
    np.testing.assert_allclose(found.points_mm[0], [[10, 1], [30, 2.5]])
    np.testing.assert_allclose(found.time_s[:, 1], np.arange(20) / 50.0, atol=1e-12)
    assert "weightless" not in capsys.readouterr().err
    facts = MotionFacts(kind="ring_down", released_s=7.0)
    found = tracked(monkeypatch, facts, "c3d", times_s=7.0 + 0.25 * np.arange(20))
    np.testing.assert_allclose(found.time_s[:, 0], 0.25 * np.arange(20))
    assert found.sigma_mm[0, 0] == 0.02
    # The moving mass is 33/140 * 1070e-9 kg/mm3 * 450 mm3 = 0.1135 g.
    assert "by about 8.8e+02 %" in capsys.readouterr().err
    hanging = MotionFacts(kind="ring_down", released_s=7.0, hanging_N=0.1)
    tracked(monkeypatch, hanging, "c3d", times_s=7.0 + 0.25 * np.arange(20))
    assert "weightless" not in capsys.readouterr().err
    with pytest.raises(InputError, match="has no times; give --rate, the frames per second"):
        tracked(monkeypatch, facts)


# Checks


def test_lost_frames_are_told() -> None:
    assert (LOST.limit, SLOW.limit, SLOW.below) == (0.0, 0.95, True)
    places = np.zeros((3, 1, 2))
    good = motion(places, [[1.0, 0.0]], label="run.h5: ring-down 1")
    bad = motion(places, [[1.0, 0.0]], label="run.h5: ring-down 2", lost_frames=2)
    assert flagged_lines([good, bad]) == [
        "run.h5: ring-down 2: 2 of 5 frames were lost (RING_DOWN_LOST); the times of the other frames are correct"
    ]
    assert recordings_in_words([good, bad]) == "2 recordings with 6 frames; 2 lost (RING_DOWN_LOST)"
    assert recordings_in_words([good]) == "1 recording with 3 frames"


# Recordings of a run


class Film3:
    # A film of three frames at 9.9, 10.0 and 10.1 s; the current was changed at 10 s.

    middle_px = np.zeros((3, 2, 2))


def followed(monkeypatch: pytest.MonkeyPatch, corrected: bool, seen: list[Any]) -> list[Motion]:
    def follow(images: Any, calibration: Any, specimen: Any, label: str, projection: Any) -> Film3:
        seen.append((list(images), calibration, specimen, label, projection))
        if label == "unseen":
            raise InputError(f"{label}: no beam")
        return Film3()

    def points(film: Any, calibration: Any, specimen: Any, time_s: Any, row_time_s: float) -> Any:
        times = time_s[:, None] + np.array([0.0, 0.05])
        seen.append((calibration, specimen, row_time_s))
        return SimpleNamespace(
            points_mm=np.arange(12.0).reshape(3, 2, 2), rest_mm=np.ones((2, 2)), time_s=times, sigma_mm=0.1 * times
        )

    monkeypatch.setattr(recorded_motion, "follow_film", follow)
    monkeypatch.setattr(recorded_motion, "points_of_film", points)
    dataset: Any = SimpleNamespace(
        calibration="calibration",
        specimen="specimen",
        correction=lambda: SimpleNamespace(apply=lambda image: image + 1) if corrected else None,
        camera_setting={"row_time_s": None, "exposure_s": 0.004}.get,
    )
    frames: Any = SimpleNamespace(images=lambda: iter([1, 2, 3]), time_s=np.array([9.9, 10.0, 10.1, 10.2]))
    points_of_time = [
        SetPoint(time_s, current_A, 0.002) for time_s, current_A in ((4.0, 0.5), (10.0, 0.0), (12.0, 1.0))
    ]
    found: list[Motion] = []
    for label in ("run: state 1", "unseen"):
        found += recorded_motion._followed(
            dataset, frames, "ring_down", points_of_time[1], points_of_time, 0.5, "projection", label
        )
    return found


@pytest.mark.parametrize("corrected", [False, True])
def test_a_recorded_motion_begins_after_the_change_of_the_current(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], corrected: bool
) -> None:
    seen: list[Any] = []
    (found,) = followed(monkeypatch, corrected, seen)
    images = [2, 3, 4] if corrected else [1, 2, 3]
    assert seen == [
        (images, "calibration", "specimen", "run: state 1", "projection"),
        ("calibration", "specimen", 0.0),
        (images, "calibration", "specimen", "unseen", "projection"),
    ]
    assert "note: unseen: no beam" in capsys.readouterr().err
    assert found.time_s == pytest.approx(np.array([[0.1, 0.15]]))  # the frame at the change is no frame after it
    assert found.points_mm.tolist() == [[[8.0, 9.0], [10.0, 11.0]]]
    assert found.sigma_mm == pytest.approx(np.array([[0.01, 0.015]]))
    assert (found.kind, found.label, found.exposure_s) == ("ring_down", "run: state 1", 0.004)
    assert (found.from_A, found.to_A, found.step_uncertainty_s) == (0.5, 0.0, 0.002)
    assert found.history == ((-6.0, 0.5),)


# Clicked points


def calibration_of(points: list[tuple[float, float]], axis_deg: float | None = None) -> Any:
    return clicked_calibration(points, SPECIMEN, axis_deg, "v.mp4")


def test_clicked_points_give_scale_clamp_and_direction() -> None:
    # A line of 300 px for 30 mm is 10 px/mm; the scale is uncertain by 3 %, a click by 3 px, the axis by 1 degree.
    found = calibration_of([(100.0, 200.0), (400.0, 200.0)])
    assert found.pixels_per_mm == pytest.approx(10.0)
    assert (found.clamp_midpoint_px, found.axis_angle_deg, found.gravity_angle_deg) == ((100.0, 200.0), 0.0, 90.0)
    assert found.uncertainty["pixels_per_mm"] == pytest.approx(0.3)
    assert found.uncertainty["clamp_midpoint_px"] == 3.0
    assert (found.uncertainty["axis_angle_deg"], found.uncertainty["gravity_angle_deg"]) == (1.0, 2.0)
    assert found.picture.along_px == ((100.0, 200.0), (400.0, 200.0))
    bent = calibration_of([(0.0, 0.0), (30.0, 40.0), (30.0, 140.0)])
    assert bent.pixels_per_mm == pytest.approx(5.0)
    assert calibration_of([(0.0, 0.0), (0.0, 300.0)], 77.0).axis_angle_deg == 77.0
    changes = {"picture": {"along_px": [(0.0, 0.0), (300.0, 0.0)]}, "pixels_per_mm": 12.0, "axis_angle_deg": 3.0}
    changed = clicked_from_changes(changes, SPECIMEN, "v.mp4")
    assert (changed.pixels_per_mm, changed.axis_angle_deg) == (12.0, 3.0)
    with pytest.raises(InputError, match=r"^v\.mp4: --along has 1 points; give two to six"):
        clicked_from_changes({"picture": {"along_px": [(0.0, 0.0)]}}, SPECIMEN, "v.mp4")


@pytest.mark.parametrize(
    "columns",
    [
        *(motion_csv.TIME_COLUMNS, motion_csv.POINT_COLUMNS, points_csv.COLUMNS, points_csv.OPTIONAL_COLUMNS),
        *(state_loads.FRAME_COLUMNS, state_loads.UNTIL_COLUMNS, state_loads.STATE_COLUMNS, state_loads.LOAD_COLUMNS),
        tensile_files.COLUMNS,
    ],
)
def test_a_column_has_a_meaning_in_a_sentence_and_an_example_of_a_cell(columns: dict[str, Column]) -> None:
    for name, column in columns.items():
        assert column.meaning.endswith(".")
        assert " " in column.meaning
        assert column.example
        assert not column.default.endswith(".")
        assert " " not in column.example
        assert name == "point" or column.example == "shot_07.png" or float(column.example) >= 0.0


@pytest.mark.parametrize(
    ("tip", "axis_deg"),
    [
        ((100.0, 0.0), 0.0),
        ((100.0, 36.0), 0.0),  # 19.8 degrees
        ((100.0, 37.0), 20.304),
        ((-36.0, 100.0), 90.0),
        ((-37.0, 100.0), 110.304),
        ((-100.0, -36.0), -180.0),
        ((0.0, -100.0), -90.0),
        ((100.0, 100.0), 45.0),
    ],
)
def test_two_clicks_near_the_horizontal_or_vertical_are_level(tip: tuple[float, float], axis_deg: float) -> None:
    assert calibration_of([(0.0, 0.0), tip]).axis_angle_deg == pytest.approx(axis_deg, abs=0.001)


def sagging(share: Array, axis_deg: float, sag_px: float, tip_px: float = 0.0) -> Array:
    # Return points of a beam 300 px long that leaves (50, 60) px at an angle and bends.
    # sag_px, tip_px : deflection of the tip by a uniform load and by a force at the tip
    # Timoshenko 1955.
    across = sag_px * (share**4 - 4 * share**3 + 6 * share**2) / 3 + tip_px * (3 * share**2 - share**3) / 2
    axis = math.radians(axis_deg)
    ahead, normal = np.array([math.cos(axis), math.sin(axis)]), np.array([-math.sin(axis), math.cos(axis)])
    return np.array([50.0, 60.0]) + 300.0 * share[:, None] * ahead + across[:, None] * normal


@pytest.mark.parametrize("axis_deg", [10.0, 90.0, -130.0])
def test_three_clicks_show_the_direction_at_the_clamp_of_a_sagging_beam(axis_deg: float) -> None:
    points = sagging(np.array([0.0, 0.3, 0.6, 1.0]), axis_deg, 20.0)
    found = calibration_of([tuple(point) for point in points.tolist()]).axis_angle_deg
    assert found == pytest.approx(axis_deg, abs=0.3)


def test_clicks_that_do_not_follow_a_beam_are_refused() -> None:
    for points, words in (
        ([(0.0, 0.0)], "--along has 1 points; give two to six points"),
        ([(40.0 * k, 0.0) for k in range(7)], "--along has 7 points"),
        ([(0.0, 0.0), (39.0, 0.0)], "the line through the points is 39 px long and its ends are 39 px apart"),
        ([(0.0, 0.0), (75.0, 0.0), (50.0, 0.0)], "is 100 px long and its ends are 50 px apart"),
        ([(0.0, 0.0), (NAN, 0.0)], "nan px long"),
    ):
        with pytest.raises(InputError, match=words):
            calibration_of(points)
    assert calibration_of([(0.0, 0.0), (40.0, 0.0)]).pixels_per_mm == pytest.approx(4 / 3)
    assert calibration_of([(0.0, 0.0), (76.0, 0.0), (52.0, 0.0)]).pixels_per_mm == pytest.approx(10 / 3)
    assert len(calibration_of([(40.0 * k, 0.0) for k in range(6)]).picture.along_px) == 6


def test_the_bow_of_an_unloaded_beam_does_not_turn_its_axis(tmp_path: Path) -> None:
    bow = [[x, round(x**2 / 300.0, 4)] for x in np.linspace(0, 30, 7).tolist()]
    file = tmp_path / "bowed.toml"
    file.write_text(SPECIMEN.text.replace("length_mm = 30.0", f"rest_shape = {bow}\nlength_mm = 30.0", 1))
    bowed, along = load_specimen(file), np.linspace(1.0, 30.0, 20)
    clicked = calibration_of([(50.0, 60.0), (350.0, 60.0)])
    centre = np.column_stack([along, np.zeros(20)])
    bow_px = filmed_motion._bow_px(clicked, bowed, along)
    at_rest = BeamFrame(clicked).to_px(Strip(bowed.mechanics()).at_rest(centre))
    assert np.abs(bow_px[-1]).max() > 20.0
    np.testing.assert_allclose(at_rest - bow_px, BeamFrame(clicked).to_px(centre), atol=1e-9)
    assert with_measured_axis(clicked, at_rest - bow_px, along, False).axis_angle_deg == pytest.approx(0.0, abs=1e-6)
    assert not filmed_motion._bow_px(clicked, SPECIMEN, along).any()


@pytest.mark.parametrize(("tip_px", "has_tip_load"), [(0.0, False), (0.0, True), (25.0, True)])
def test_the_beam_at_rest_corrects_axis_and_clamp(tip_px: float, has_tip_load: bool) -> None:
    # The clicks were 2 degrees and 4 px off; the sagging beam shows both.
    along = np.linspace(1.0, 30.0, 20)
    rest = sagging(along / 30.0, 30.0, 12.0, tip_px)
    rest[3] = NAN
    normal = np.array([-math.sin(math.radians(30.0)), math.cos(math.radians(30.0))])
    clamp = np.array([50.0, 60.0]) + 4.0 * normal
    clicked = calibration_of([tuple(clamp), tuple(clamp + 300.0)], 32.0)
    found = with_measured_axis(clicked, rest, along, has_tip_load)
    assert found.axis_angle_deg == pytest.approx(30.0, abs=0.05)
    assert found.clamp_midpoint_px == pytest.approx((50.0, 60.0), abs=0.3)
    few = np.full_like(rest, NAN)
    few[:5] = rest[5:10]
    assert with_measured_axis(clicked, few, along, has_tip_load) is clicked
    few[5] = rest[10]
    assert with_measured_axis(clicked, few, along, has_tip_load) is not clicked


# Films


def test_the_noise_of_points_is_their_scatter_about_a_smooth_curve() -> None:
    # A curve of degree 5 in each frame and a constant offset of each point are no noise.
    along = np.linspace(1.0, 30.0, 25)
    noise = np.random.default_rng(2).normal(0.0, 0.05, (300, 25))
    curves = np.array([np.polyval([k % 3, 1.0, -2.0, k % 5, 0.5, 1.0], along / 30.0) for k in range(300)])
    places = np.stack([np.tile(along, (300, 1)), curves + noise + 0.3 * np.sin(20.0 * along)], axis=-1)
    empty = np.zeros((0, 25, 2))
    measured = Film(along, empty, empty, empty).sigma_mm(places)
    assert measured.mean() == pytest.approx(0.05, rel=0.03)
    assert np.all(np.abs(measured[3:-3] - 0.05) < 0.012)
    places[::2, 3] = NAN
    assert Film(along, empty, empty, empty).sigma_mm(places).mean() == pytest.approx(0.05, rel=0.04)
    places[:, 3] = NAN
    np.testing.assert_allclose(Film(along, empty, empty, empty).sigma_mm(places), 1e-4)
    quiet = np.stack([np.tile(along, (9, 1)), np.zeros((9, 25))], axis=-1)
    np.testing.assert_allclose(Film(along, empty, empty, empty).sigma_mm(quiet), 1e-4)


def test_each_point_has_the_time_of_its_row() -> None:
    # At 8 px/mm from (16, 8) px along +x, pixel (24, 16) is at (1, -1) mm or (1, 1) mm; row = 2 x + 3 y + 5.
    made = calibration_of([(16.0, 8.0), (256.0, 8.0)], 0.0)
    along = np.linspace(1.0, 29.0, 8)
    middle = np.stack([np.stack([16.0 + 8.0 * along, np.full(8, 16.0)], axis=-1)] * 2)
    middle[1, 2] = NAN
    shot = Film(along, middle, middle, middle)
    found = filmed_motion.points_of_film(shot, made, SPECIMEN, np.array([10.0, 20.0]), 0.001, (2.0, 3.0, 5.0))
    rows = 2.0 * middle[0, :, 0] + 3.0 * 16.0 + 5.0
    np.testing.assert_allclose(found.time_s[0], 10.0 + 0.001 * rows)
    seen = np.concatenate([rows, np.delete(rows, 2)])
    np.testing.assert_allclose(found.time_s[1, 2], 20.0 + 0.001 * seen.mean())
    np.testing.assert_allclose(np.abs(found.points_mm[0]), np.stack([along, np.ones(8)], axis=-1), atol=1e-9)
    np.testing.assert_allclose(found.rest_mm, np.stack([along, np.zeros(8)], axis=-1))
    assert found.sigma_mm.shape == (2, 8)
    plain = filmed_motion.points_of_film(shot, made, SPECIMEN, np.array([10.0, 20.0]))
    np.testing.assert_allclose(plain.time_s[1], 20.0)


class Following:
    # A tracker that finds the beam in some frames; each frame is a number.

    along_mm = np.array([1.0, 2.0])

    def __init__(self, seen: set[int]) -> None:
        self.seen = seen

    def follow(self, image: Array) -> Any:
        number = int(image[0, 0])
        if number not in self.seen:
            return None
        place = np.full((2, 2), float(number))
        return type("Beam", (), {"is_seen": True, "middle_px": place, "left_px": place - 1, "right_px": place + 1})


def frames(count: int) -> list[Array]:
    return [np.full((2, 2), float(number)) for number in range(count)]


def test_a_lost_beam_is_searched_in_each_fifth_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    searched: list[int] = []

    def search(image: Array, *_: Any) -> Following | None:
        searched.append(int(image[0, 0]))
        return Following(set(range(100))) if image[0, 0] == 15 else None

    monkeypatch.setattr(film, "tracker_from", search)
    seen = Following({0, 1, 3})
    found = film.follow_film(frames(18), calibration_of([(0.0, 0.0), (90.0, 0.0)]), SPECIMEN, "v", None, seen)
    assert searched == [2, 4, 9, 14] or searched == [2, 4, 9, 14, 15]
    assert np.isfinite(found.middle_px[:, 0, 0]).nonzero()[0].tolist() == [0, 1, 3]
    np.testing.assert_allclose(found.left_px[3], 2.0)
    np.testing.assert_allclose(found.right_px[3], 4.0)
    np.testing.assert_allclose(found.along_mm, [1.0, 2.0])


def test_a_film_without_a_beam_is_given_up_after_200_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    searched: list[int] = []
    monkeypatch.setattr(film, "tracker_from", lambda image, *_: searched.append(int(image[0, 0])))
    taken = iter(frames(300))
    with pytest.raises(film.NoBeam, match=r"^v: no beam was found in the first 200 frames; check clamp_midpoint_px"):
        film.follow_film(taken, calibration_of([(0.0, 0.0), (90.0, 0.0)]), SPECIMEN, "v")
    assert next(taken)[0, 0] == 200
    assert searched == list(range(0, 200, 5))

    def late(image: Array, *_: Any) -> Following | None:
        return Following(set(range(300))) if image[0, 0] == 195 else None

    monkeypatch.setattr(film, "tracker_from", late)
    found = film.follow_film(frames(210), calibration_of([(0.0, 0.0), (90.0, 0.0)]), SPECIMEN, "v")
    assert np.isfinite(found.middle_px[:, 0, 0]).nonzero()[0].tolist() == list(range(195, 210))


@pytest.mark.parametrize(("count", "still"), [(1, 0), (2, 0), (5, 24)])
def test_the_second_last_kept_frame_shows_the_beam_at_rest(count: int, still: int) -> None:
    kept = {8 * number: np.full((1, 1), 8 * number) for number in reversed(range(count))}
    assert filmed_motion._still_frame(kept)[0, 0] == still


@pytest.mark.parametrize("terminal", [True, False])
def test_the_progress_of_a_film_is_told_on_a_terminal(monkeypatch: pytest.MonkeyPatch, terminal: bool) -> None:
    said: list[str] = []
    monkeypatch.setattr(filmed_motion.sys, "stderr", SimpleNamespace(isatty=lambda: terminal))
    images = filmed_motion._reported(frames(2), said.append, 2)  # type: ignore[arg-type]
    assert [image[0, 0] for image in images] == [0, 1]
    assert said == (["frame 1 of 2 frames", "frame 2 of 2 frames"] if terminal else [])


def test_notes_about_a_film(capsys: pytest.CaptureFixture[str]) -> None:
    def view(moved_px: float, is_possible: bool = True) -> Any:
        return type("View", (), {"moved_px": moved_px, "is_possible": is_possible})

    def shot(seen: int) -> Film:
        middle = np.ones((10, 1, 2))
        middle[seen:] = NAN
        return Film(np.ones(1), middle, middle, middle)

    tell = filmed_motion._tell_view
    most = filmed_motion.MOVED_PX
    for given, seen, words in (
        (view(most), 7, ""),
        (None, 10, ""),
        (view(most + 0.11), 10, f"the camera moved by up to {most + 0.11:.1f} px"),
        (view(0.0, False), 10, "the background has too little detail"),
        (view(9.0, False), 10, "the camera moved by up to 9.0 px"),
        (None, 6, "the beam was seen in 60% of the frames"),
    ):
        tell(Path("v.mp4"), given, shot(seen))
        notes = capsys.readouterr().err
        assert words in notes
        assert notes.count("note: v.mp4:") == bool(words)


class Bench:
    # Stand-ins for the parts that read a video of numbered frames; `called` lists what each part was given.

    def __init__(self, monkeypatch: pytest.MonkeyPatch, frames: int, coloured: bool, tracked: bool) -> None:
        shape = (2, 2, 3) if coloured else (2, 2)
        self.called: dict[str, Any] = {}
        self.images = [np.full(shape, number, np.uint8) for number in range(frames)]
        self.stored_s, self.frame_s = 0.5 * np.arange(frames), 0.1 * np.arange(frames)
        self.middle_px = np.random.default_rng(3).normal(50.0, 1.0, (frames + 2, 12, 2))
        self.outline = SimpleNamespace(outline_px="outline") if tracked else None
        self.view = SimpleNamespace(moved_px=9.0, is_possible=True, steadied=lambda image: image + 100)
        kept = {0: self.images[0], 1: self.images[1], 2: self.images[2]}
        self.parts = {
            "looked_through": (self.stored_s, kept),
            "recorded_times": self.frame_s,
            "is_coloured": coloured,
            "choose_projection": "projection",
            "tracker_from": self.outline,
            "SteadyView": self.view,
            "timed_frames": [(image, 0.0) for image in self.images],
            "with_measured_axis": "corrected",
            "row_direction": (1.0, 2.0, 3.0),
            "points_of_film": SimpleNamespace(points_mm="points", rest_mm="rest", time_s="times", sigma_mm="sigmas"),
            "free_motions": ("first", "second"),
        }
        for name, result in self.parts.items():
            monkeypatch.setattr(filmed_motion, name, self.noted(name, result))
        monkeypatch.setattr(filmed_motion, "follow_film", self.follow)
        monkeypatch.setattr(filmed_motion, "camera_grey", lambda image: image + 10)

    def noted(self, name: str, result: Any) -> Any:
        return lambda *given: self.called.update({name: given}) or result

    def follow(self, images: Any, *given: Any) -> Film:
        self.called["follow_film"] = ([int(image.flat[0]) for image in images], *given)
        left = self.middle_px - 1.0
        return Film(np.arange(12.0), self.middle_px, left, left + 2.0)


CLICKED = calibration_of([(0.0, 0.0), (90.0, 0.0)])


@pytest.mark.parametrize("coloured", [False, True])
@pytest.mark.parametrize("tracked", [False, True])
def test_each_step_of_a_video_gets_the_results_of_the_steps_before(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], coloured: bool, tracked: bool
) -> None:
    bench = Bench(monkeypatch, 8, coloured, tracked)
    facts = MotionFacts(kind="ring_down", rate_Hz=50.0, row_time_s=0.25)
    path = Path("v.mp4")
    found = filmed_motion.read_video_motions(path, CLICKED, SPECIMEN, facts)
    assert (found.motions, found.calibration) == (("first", "second"), CLICKED)
    called = bench.called
    assert called["looked_through"] == (path, 8)
    assert called["recorded_times"] == (path, bench.stored_s, 50.0)
    grey = 0 if coloured else 10
    projection = "projection" if coloured else None
    if coloured:
        (reference,), *more = called["choose_projection"]
        assert (int(reference.flat[0]), more) == (1, [CLICKED, 3.0, 30.0])
    image, *more = called["tracker_from"]
    assert (int(image.flat[0]), more) == (1 + grey, [CLICKED, SPECIMEN, projection])
    steadied = 100 if tracked else 0
    images, *more = called["follow_film"]
    assert images == [number + grey + steadied for number in range(8)]
    assert more == [CLICKED, SPECIMEN, "v.mp4", projection, bench.outline]
    if tracked:
        assert (called["SteadyView"][0].flat[0], called["SteadyView"][1]) == (1 + grey, "outline")
    assert ("SteadyView" in called) == tracked
    film_given, *more = called["points_of_film"]
    assert (more[:2], more[3:]) == ([CLICKED, SPECIMEN], [0.25, (1.0, 2.0, 3.0)])
    np.testing.assert_array_equal(more[2], bench.frame_s)
    np.testing.assert_array_equal(film_given.along_mm, np.arange(12.0))
    np.testing.assert_array_equal(film_given.middle_px, bench.middle_px[:8])
    np.testing.assert_array_equal(film_given.left_px, bench.middle_px[:8] - 1.0)
    np.testing.assert_array_equal(film_given.right_px, bench.middle_px[:8] + 1.0)
    assert called["free_motions"] == ("points", "rest", "times", "sigmas", facts, "v.mp4")
    assert "with_measured_axis" not in called
    note = "eimi: note: v.mp4: the camera moved by up to 9.0 px; this movement was removed from the frames\n"
    assert capsys.readouterr().err == (note if tracked else "")


@pytest.mark.parametrize(("hanging_N", "hangs"), [(0.0, False), (0.01, True)])
def test_clicked_points_are_corrected_by_the_last_quarter_of_a_video(
    monkeypatch: pytest.MonkeyPatch, hanging_N: float, hangs: bool
) -> None:
    # Of the first 8 positions, the last 8 // 4 + 1 = 3 count; a point that was seen once has that place.
    bench = Bench(monkeypatch, 8, True, True)
    bench.middle_px[5:7, 4] = NAN
    bench.middle_px[5:8, 6] = NAN
    facts = MotionFacts(kind="ring_down", hanging_N=hanging_N)
    found = filmed_motion.read_video_motions(Path("v.mp4"), CLICKED, SPECIMEN, facts, is_clicked=True)
    assert found.calibration == "corrected"
    calibration, rest_px, along_mm, has_tip_load = bench.called["with_measured_axis"]
    assert (calibration, has_tip_load) == (CLICKED, hangs)
    np.testing.assert_array_equal(along_mm, np.arange(12.0))
    expected = np.median(bench.middle_px[5:8], axis=0)
    expected[4] = bench.middle_px[7, 4]
    np.testing.assert_allclose(rest_px, expected)
    assert np.isnan(rest_px).sum() == 2
    assert bench.called["points_of_film"][1] == "corrected"


def test_a_video_that_ends_early_has_the_times_of_its_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(monkeypatch, 9, True, True)
    bench.middle_px = bench.middle_px[:7]
    filmed_motion.read_video_motions(Path("v.mp4"), CLICKED, SPECIMEN, MotionFacts(kind="creep"))
    film_given, _, _, frame_s, *_ = bench.called["points_of_film"]
    assert len(film_given.middle_px) == len(film_given.left_px) == len(film_given.right_px) == 7
    np.testing.assert_array_equal(frame_s, bench.frame_s[:7])


def test_a_video_has_at_least_8_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    assert FEWEST_FRAMES == 8
    Bench(monkeypatch, 7, True, True)
    with pytest.raises(InputError, match=r"^v\.mp4: has 7 frames; a motion needs at least 8 frames$"):
        filmed_motion.read_video_motions(Path("v.mp4"), CLICKED, SPECIMEN, MotionFacts(kind="creep"))


def test_the_frame_at_rest_is_the_second_last_that_was_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(monkeypatch, 8, True, True)
    assert filmed_motion.frame_at_rest(Path("v.mp4")) is bench.images[1]
    assert bench.called["looked_through"] == (Path("v.mp4"), 8)


def test_the_colours_of_a_film_are_chosen_once_in_its_first_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    chosen: list[Any] = []
    searched: list[Any] = []

    def choose(images: Any, *given: Any) -> str:
        chosen.append((len(images), images[0][0, 0, 0], *given))
        return "projection"

    def search(image: Array, *given: Any) -> Any:
        searched.append(given)
        return Following({1, 2}) if image.flat[0] else None

    monkeypatch.setattr(film, "choose_projection", choose)
    monkeypatch.setattr(film, "tracker_from", search)
    coloured = [np.full((2, 2, 3), float(number)) for number in range(8)]
    monkeypatch.setattr(Following, "follow", lambda self, image: None)
    film.follow_film(coloured, CLICKED, SPECIMEN, "v")
    assert chosen == [(1, 0.0, CLICKED, 3.0, 30.0)]
    assert searched == [(CLICKED, SPECIMEN, "projection")] * 2
    chosen.clear()
    searched.clear()
    film.follow_film([image[..., 0] for image in coloured], CLICKED, SPECIMEN, "v")
    film.follow_film(coloured, CLICKED, SPECIMEN, "v", "given")  # type: ignore[arg-type]
    assert chosen == []
    assert searched == [(CLICKED, SPECIMEN, None)] * 2 + [(CLICKED, SPECIMEN, "given")] * 2


@pytest.mark.parametrize("in_region", [False, True])
def test_the_beam_of_a_film_is_searched_in_the_region_of_the_calibration(
    monkeypatch: pytest.MonkeyPatch, in_region: bool
) -> None:
    region = SimpleNamespace(
        cut=lambda image: "cut", calibration="of the region", in_picture=lambda edges: ["moved", edges]
    )
    asked: list[Any] = []
    monkeypatch.setattr(film, "region_of", lambda *given: asked.append(given) or (region if in_region else None))
    monkeypatch.setattr(film, "find_edges", lambda *given, projection: (*given, projection))
    image = np.zeros((3, 4))
    found = film._edges(image, CLICKED, SPECIMEN, "projection")  # type: ignore[arg-type]
    assert asked == [(CLICKED, (3, 4))]
    if in_region:
        assert found == ["moved", ("cut", "of the region", SPECIMEN, "projection")]
    else:
        assert found == (image, CLICKED, SPECIMEN, "projection")


@pytest.mark.parametrize(("farthest_mm", "follows"), [(14.9, False), (15.0, True)])
def test_half_the_beam_must_be_seen_to_follow_it(
    monkeypatch: pytest.MonkeyPatch, farthest_mm: float, follows: bool
) -> None:
    # The beam is 30 mm long; its farthest point is at (0.6, 0.8) of the distance.
    found = SimpleNamespace(middle_mm=np.array([[0.0, 0.0], [0.6 * farthest_mm, 0.8 * farthest_mm], [1.0, 0.0]]))
    monkeypatch.setattr(film, "_edges", lambda *given: found)
    monkeypatch.setattr(film, "BeamTracker", lambda *given: given)
    image = np.zeros((3, 4))
    tracker: Any = film.tracker_from(image, CLICKED, SPECIMEN, None)
    assert (tracker is not None) == follows
    if follows:
        picture, edges, frame, length_mm, projection = tracker
        assert (picture is image, edges, length_mm, projection) == (True, found, 30.0, None)
        assert isinstance(frame, film.BeamFrame)

    def refuse(*given: Any) -> None:
        raise ValueError("another body")

    monkeypatch.setattr(film, "BeamTracker", refuse)
    assert film.tracker_from(image, CLICKED, SPECIMEN, None) is None
    found.middle_mm = np.zeros((0, 2))
    assert film.tracker_from(image, CLICKED, SPECIMEN, None) is None


# Times of a video


def box(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I", 8 + len(content)) + name + content


KEY = b"com.android.capture.fps"


def metadata(kind: int, value: bytes, before: tuple[bytes, ...] = (), number: int | None = None) -> bytes:
    # Return the metadata (box moov) of a video with a value for the frame rate, after other keys.
    names = [*before, KEY]
    keys = b"".join(box(b"mdta", name) for name in names)
    data = box(b"data", struct.pack(">II", kind, 0) + value)
    items = box(struct.pack(">I", number or len(names)), data)
    return box(b"moov", box(b"meta", box(b"keys", struct.pack(">II", 0, len(names)) + keys) + box(b"ilst", items)))


@pytest.mark.parametrize(
    ("content", "rate"),
    [
        (metadata(23, struct.pack(">f", 240.0)), 240.0),
        (metadata(24, struct.pack(">d", 239.5)), 239.5),
        (metadata(22, struct.pack(">f", 240.0)), None),
        (metadata(23, struct.pack(">f", 1.0)), 1.0),
        (metadata(23, struct.pack(">f", 0.99)), None),
        (metadata(23, struct.pack(">f", 1e5)), 1e5),
        (metadata(23, struct.pack(">f", 1.01e5)), None),
        (metadata(23, struct.pack(">f", math.nan)), None),
        (metadata(23, struct.pack(">f", 120.0), (b"com.android.version", b"x")), 120.0),
        (metadata(23, struct.pack(">f", 120.0), (b"com.android.version",), number=7), None),
        (metadata(23, b"\x43"), None),
        (box(b"free", b"x" * 40) + metadata(23, struct.pack(">f", 60.0)), 60.0),
        (struct.pack(">I4sQ", 1, b"mdat", 40) + b"x" * 24 + metadata(23, struct.pack(">f", 60.0)), 60.0),
        (box(b"free", b"x" * 40) + box(b"moov", b"nothing"), None),
        (struct.pack(">I4s", 7, b"free") + metadata(23, struct.pack(">f", 60.0)), None),
        (b"short", None),
        (b"", None),
    ],
)
def test_the_rate_of_a_recording_is_read_from_its_box(tmp_path: Path, content: bytes, rate: float | None) -> None:
    path = tmp_path / "v.mp4"
    path.write_bytes(content)
    assert video_times.capture_rate_Hz(path) == rate


def times(stored_s: list[float], rate_Hz: float | None = None, captured_Hz: float | None = None) -> list[float]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(video_times, "capture_rate_Hz", lambda path: captured_Hz)
        return list(video_times.recorded_times(Path("v.mp4"), np.array(stored_s), rate_Hz))


def test_slow_motion_is_converted_into_the_times_of_its_recording(capsys: pytest.CaptureFixture[str]) -> None:
    # Played at 25 frames per second and recorded at 100, a lost frame stays an interval of twice the length.
    played = [1.0, 1.04, 1.12, 1.16, 1.20]
    recorded = [0.0, 0.01, 0.03, 0.04, 0.05]
    assert times(played, rate_Hz=100.0, captured_Hz=7.0) == pytest.approx(recorded)
    assert capsys.readouterr().err == ""
    assert times(played, captured_Hz=100.0) == pytest.approx(recorded)
    assert "is played at 25 and was recorded at 100 frames per second" in capsys.readouterr().err
    assert times(played) == pytest.approx([0.0, 0.04, 0.12, 0.16, 0.20])
    assert "has 25 frames per second according to the times in the file; if this is slow" in capsys.readouterr().err
    assert times(played, captured_Hz=25.49) == pytest.approx([0.0, 0.04, 0.12, 0.16, 0.20])
    assert times(played, captured_Hz=25.51) != pytest.approx([0.0, 0.04, 0.12, 0.16, 0.20], rel=1e-3)
    assert times(played, captured_Hz=24.49) != pytest.approx([0.0, 0.04, 0.12, 0.16, 0.20], rel=1e-3)
    capsys.readouterr()
    times([k / 60.0 for k in range(5)])
    assert "slow motion" in capsys.readouterr().err
    times([k / 62.0 for k in range(5)])
    assert "slow motion" not in capsys.readouterr().err


def test_times_that_do_not_increase_need_a_rate() -> None:
    for stored in ([0.0, 0.1, 0.1, 0.2], [0.0, 0.1, 0.05, 0.2, 0.3], [0.0], [0.0, 0.0]):
        assert times(stored, rate_Hz=50.0) == pytest.approx([k / 50.0 for k in range(len(stored))])
        with pytest.raises(InputError, match=r"^v\.mp4: the times of the frames in the file do not increase"):
            times(stored)


# Heat and field


def readings(value: Any, time_s: Any, state: Any, **sensor: Any) -> SensorLog:
    known = {"name": "pt", "model": "m", "measures": "coil_temperature", "unit": "degC"}
    times, values = np.array(time_s, float), np.array(value, float)
    return SensorLog(LoggedSensor(**known | sensor), np.array(state), times, values, np.full(len(values), NAN))


def warming(tau_s: float, rise_K: float = 12.0) -> tuple[Array, Array]:
    # Return the times and temperatures of a coil at its continuous current, from 20 degrees Celsius.
    time_s = np.linspace(0.0, 600.0, 40)
    return time_s, 20.0 + rise_K * (1.0 - np.exp(-time_s / tau_s))


@pytest.mark.parametrize(
    ("true_s", "faster", "told"), [(300.0, None, False), (100.0, "faster", True), (900.0, "slower", True)]
)
def test_a_coil_that_warms_with_another_time_constant_is_told(true_s: float, faster: str | None, told: bool) -> None:
    time_s, degC = warming(true_s)
    found = measured_heating(readings(degC, time_s, np.zeros(40, int)), [2.0], 2.0, 300.0)
    assert found is not None
    assert found.best_time_constant_s == pytest.approx(true_s, rel=0.03)
    assert (found.lowest_degC, found.highest_degC) == (20.0, degC.max())
    assert found.contradicts is told
    if told:
        assert f"the coil warms {faster} than the rig file says" in found.in_words
    else:
        assert found.continuous_rise_K == pytest.approx(12.0)
        assert found.rms_K == pytest.approx(0.0, abs=1e-9)
        assert found.in_words.endswith("at continuous_current_A = 2")


def test_half_the_current_gives_a_quarter_of_the_heat() -> None:
    # State 0 has the current 1 A of 2 A. After it, state 1 has 2 A; readings in any order and without a value.
    time_s = np.array([0.0, 50.0, 100.0, 150.0, 200.0, 250.0, 300.0])
    state = np.array([0, 0, 0, 0, 1, 1, 1])
    heat = np.zeros(7)
    for k in range(1, 7):
        aim = 0.25 if state[k] == 0 else 1.0
        heat[k] = aim + (heat[k - 1] - aim) * math.exp(-50.0 / 120.0)
    degC = 25.0 + 8.0 * heat
    order = np.array([3, 1, 6, 0, 2, 5, 4])
    log = readings([*degC[order], NAN, 99.0], [*time_s[order], 70.0, NAN], [*state[order], 0, 1])
    found = measured_heating(log, [1.0, 2.0], 2.0, 120.0)
    assert found is not None
    assert found.continuous_rise_K == pytest.approx(8.0)
    assert found.rms_K == pytest.approx(0.0, abs=1e-9)


def test_few_or_equal_readings_are_not_compared() -> None:
    time_s, degC = warming(300.0)
    zero = np.zeros(40, int)
    assert measured_heating(readings(degC[:5], time_s[:5], zero[:5]), [2.0], 2.0, 300.0) is None
    assert measured_heating(readings(degC[:6], time_s[:6], zero[:6]), [2.0], 2.0, 300.0) is not None
    little = 20.0 + 0.999 * (degC - 20.0) / np.ptp(degC)
    assert measured_heating(readings(little, time_s, zero), [2.0], 2.0, 300.0) is None
    enough = 20.0 + 1.001 * (degC - 20.0) / np.ptp(degC)
    assert measured_heating(readings(enough, time_s, zero), [2.0], 2.0, 300.0) is not None
    unheated = measured_heating(readings(degC, time_s, zero), [0.0], 2.0, 300.0)
    assert unheated is not None
    assert (unheated.continuous_rise_K, unheated.contradicts) == (0.0, False)
    assert unheated.rms_K == pytest.approx(degC.std())


def test_the_heat_of_a_run_needs_a_rating_and_a_thermometer_at_the_coil() -> None:
    # A state without a known current has no heat.
    time_s, degC = warming(300.0)
    skin = readings(degC, time_s, np.zeros(40, int), measures="specimen_temperature")
    coil = readings(degC, time_s, np.zeros(40, int))
    rating = "[coil]\ncontinuous_current_A = 2.0\nthermal_time_constant_s = 300.0\n"

    def run(text: str | None, logs: list[SensorLog], current_A: float | None = 2.0) -> Any:
        states = [SimpleNamespace(current_A=current_A)]
        return SimpleNamespace(text=lambda name: text if name == "rig" else None, sensors=lambda: logs, states=states)

    found = coil_heating(run(rating, [skin, coil]))
    assert found is not None
    assert (found.sensor, found.continuous_rise_K) == ("pt", pytest.approx(12.0))
    assert (found.time_constant_s, found.continuous_current_A) == (300.0, 2.0)
    unknown = coil_heating(run(rating, [coil], None))
    assert unknown is not None
    assert unknown.continuous_rise_K == 0.0
    for given in (run(None, [coil]), run("name = 'x'\n", [coil]), run(rating, [skin])):
        assert coil_heating(given) is None


@pytest.mark.parametrize(
    ("best_s", "best_K", "told"), [(129.0, 0.1, False), (131.0, 0.1, True), (69.0, 0.1, True), (131.0, 0.71, False)]
)
def test_a_contradiction_is_30_percent_in_time_and_30_percent_in_the_fit(
    best_s: float, best_K: float, told: bool
) -> None:
    assert MeasuredHeating("pt", 20, 30, 5, 1.0, 100.0, best_s, best_K, 2.0).contradicts is told


def test_the_line_of_the_field_has_three_uncertainties() -> None:
    # At -1, 0 and 1 A, the variance of the slope is that of a reading over 2, and that of the offset over 3.
    sensor = LoggedSensor("probe", "F41", "field", "mT", at_magnet=2.0, uncertainty=0.05, uncertainty_share=0.01)
    line = field_line(sensor, [-1.0, 0.0, 1.0, NAN, 1.0], [-1.4, 0.1, 1.6, 7.0, NAN])
    assert line is not None
    assert (line.mT_per_A, line.offset_mT) == (pytest.approx(3.0), pytest.approx(0.2))
    assert line.mT_per_A_sigma == pytest.approx(math.hypot(0.1 / math.sqrt(2), 0.03))
    assert line.offset_mT_sigma == pytest.approx(math.hypot(0.1 / math.sqrt(3), 0.1))
    assert line.scatter_mT == pytest.approx(0.0, abs=1e-12)
    assert (line.currents, line.shared_is_stated, line.probe) == (3, True, "probe (F41)")
    assert line.in_words == "3 ± 0.077 mT/A, and 0.2 ± 0.12 mT without a current"
    rough = field_line(LoggedSensor("probe", "F41", "field", "mT"), [-1.0, 0.0, 1.0], [-1.0, 0.3, 1.0], 0.02)
    assert rough is not None
    assert rough.scatter_mT == pytest.approx(math.sqrt(0.06))  # the residuals are -0.1, 0.2 and -0.1
    assert rough.mT_per_A_sigma == pytest.approx(math.sqrt(0.03))
    assert rough.offset_mT_sigma == pytest.approx(math.hypot(math.sqrt(0.02), 0.02))
    assert not rough.shared_is_stated
    two = field_line(LoggedSensor("probe", "F41", "field", "mT"), [0.0, 1.0], [0.0, 1.0], [0.3, 0.4])
    assert two is not None
    assert two.scatter_mT == 0.0
    assert two.offset_mT_sigma == pytest.approx(math.hypot(math.sqrt(0.125), math.sqrt(0.125)))
    assert field_line(sensor, [1.0, 1.0], [1.0, 2.0]) is None


def test_the_first_gaussmeter_gives_the_line() -> None:
    other = readings([5.0, 6.0], [0, 1], [0, 1], measures="other")
    field = readings([1.0, 3.0, 5.0], [0, 1, 2], [0, 1, 1], measures="field")
    assert measured_line([other], [0.0, 1.0]) is None
    line = measured_line([other, field], [0.0, 1.0])
    assert line is not None
    assert (line.mT_per_A, line.offset_mT) == (pytest.approx(3.0), pytest.approx(1.0))

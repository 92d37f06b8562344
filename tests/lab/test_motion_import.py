"""Ring-downs (free vibrations of a beam) and creep are imported on the command line as tracked points."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import numpy as np
import pytest

from eimi_fitting.time.measured import Motion
from eimi_lab.config.calibration import load_calibration
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset.moving.beam_modes import cantilever_modes
from eimi_lab.dataset.moving.motion_import import write_motion_dataset
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.face import moving
from eimi_lab.fits.recorded_motions import load_motions
from eimi_lab.process.errors import InputError

Run = Callable[..., tuple[int, str]]

RATE_HZ, FREQUENCY_HZ, DECAY_PER_S = 100.0, 5.0, 1.5
HELD = 20
REST_MM = np.array([[5.0, 0.5], [10.0, 0.0]])


def swing(frames: int = 120) -> np.ndarray:
    # Return two points in each frame, (frames, 2, 2) in mm, which are held and then vibrate.
    time = np.maximum(np.arange(frames) - HELD, 0) / RATE_HZ
    swinging = 1.5 * np.exp(-DECAY_PER_S * time) * np.cos(2 * np.pi * FREQUENCY_HZ * time)
    places = np.repeat(REST_MM[None], frames, axis=0)
    places[..., 1] += (swinging[:, None] - 2.0) * cantilever_modes(REST_MM[:, 0] / 10.0)[:, 0]
    return places


def write_table(path: Path, places: np.ndarray, clock: str = "time_s", rest_mm: np.ndarray = REST_MM) -> Path:
    rows = [f"{clock},point,x0_mm,y0_mm,x_mm,y_mm,sigma_mm"]
    for k, frame in enumerate(places):
        at = k if clock == "frame" else f"{k / RATE_HZ:.4f}"
        for name, rest, place in zip("ab", rest_mm, frame, strict=True):
            if np.isfinite(place).all():
                rows.append(f"{at},{name},{rest[0]},{rest[1]},{place[0]:.6f},{place[1]:.6f},0.01")
    path.write_text("\n".join(rows))
    return path


def imported(run: Run, files: Path, source: Path, *options: object) -> tuple[int, str]:
    gravity = () if "--calibration" in options else ("--gravity-angle", "-90")
    return run("import", source, "--specimen", files / "specimen.toml", "-o", files / "out.h5", *gravity, *options)


def ring_down(files: Path) -> Motion:
    with open_dataset(files / "out.h5") as dataset:
        assert not dataset.creeps()
        (motion,) = dataset.ring_downs()
    return motion


def test_an_imported_ring_down_begins_at_the_release_of_the_beam(run: Run, files: Path) -> None:
    code, message = imported(run, files, write_table(files / "flick.csv", swing()), "--ring-down", "--hanging", "0.5")
    assert code == 0, message
    motion = ring_down(files)
    assert "the release is assumed at 0.2" in message
    assert len(motion.time_s) == 100
    np.testing.assert_allclose(motion.time_s[:, 0], np.arange(len(motion.time_s)) / RATE_HZ, atol=1e-9)
    np.testing.assert_allclose(motion.points_mm, swing()[-len(motion.time_s) :], atol=1e-5)
    np.testing.assert_allclose(motion.rest_mm, REST_MM)
    assert (motion.hanging_N, motion.tip_force_N, motion.from_A, motion.lost_frames) == (0.5, 0.0, 0.0, 0)
    assert motion.step_uncertainty_s == pytest.approx(1 / RATE_HZ)
    with open_dataset(files / "out.h5") as dataset:
        assert dataset.states == ()
        assert dataset.gravity_angle_deg == -90.0


def test_the_points_of_a_video_are_no_frames(run: Run, files: Path) -> None:
    assert imported(run, files, write_table(files / "flick.csv", swing()), "--ring-down", "--released", "0.2")[0] == 0
    motion = ring_down(files)
    specimen, calibration = load_specimen(files / "specimen.toml"), load_calibration(files / "calibration.toml")
    write_motion_dataset(files / "video.h5", [motion], specimen, calibration)
    status, message = run("segment", files / "video.h5")
    assert (status, message) == (
        2, f"eimi: {files / 'video.h5'}: holds tracked points, so there are no edges to find\n"
    )  # fmt: skip
    status, message = run("segment", files / "video.h5", "--axis", "89")
    assert status == 2
    assert "so its specimen and calibration cannot be replaced; import the points again" in message


def test_a_release_and_a_rate_on_the_command_line_replace_the_times_of_the_table(run: Run, files: Path) -> None:
    table = write_table(files / "flick.csv", swing(), clock="frame")
    code, message = imported(run, files, table, "--creep", "--rate", "50", "--released", "0.5", "--removed", "0.2")
    assert code == 0, message
    assert "is assumed at" not in message
    with open_dataset(files / "out.h5") as dataset:
        assert not dataset.ring_downs()
        (motion,) = dataset.creeps()
    assert motion.kind == "creep"
    assert motion.tip_force_N == 0.2
    assert motion.time_s[0, 0] == pytest.approx(0.0)
    assert motion.duration_s == pytest.approx((119 - 25) / 50)


def test_missing_points_and_frames_are_kept_as_missing(run: Run, files: Path) -> None:
    places = swing()
    places[60, 0] = np.nan  # this point is not visible
    places[80:83] = np.nan  # these frames have no row
    assert imported(run, files, write_table(files / "flick.csv", places), "--ring-down", "--released", "0.3")[0] == 0
    motion = ring_down(files)
    assert motion.lost_frames == 3
    assert np.isnan(motion.points_mm[30, 0]).all()
    assert np.isfinite(motion.points_mm[30, 1]).all()
    assert int((~motion.seen).sum()) == 1


def test_the_stored_amplitudes_are_those_of_the_modes(run: Run, files: Path) -> None:
    import h5py

    imported(run, files, write_table(files / "flick.csv", swing()), "--ring-down", "--released", "0.2")
    with h5py.File(files / "out.h5") as file:
        amplitudes = file["entry/ring_down_points/0/modal_amplitudes"][()]
    time = np.arange(len(amplitudes)) / RATE_HZ
    truth = 1.5 * np.exp(-DECAY_PER_S * time) * np.cos(2 * np.pi * FREQUENCY_HZ * time)
    np.testing.assert_allclose(amplitudes[:, 0], truth - truth.mean(), atol=1e-4)
    np.testing.assert_allclose(amplitudes[:, 1], 0.0, atol=1e-4)


def write_c3d(path: Path, places: np.ndarray, other: tuple[float, float]) -> Path:
    # Write two markers at `places`, and a third at rest at `other` (x, z in mm), into a C3D file.
    ezc3d = pytest.importorskip("ezc3d")
    capture = ezc3d.c3d()
    capture["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    capture["parameters"]["POINT"]["RATE"]["value"] = [RATE_HZ]
    capture["parameters"]["POINT"]["LABELS"]["value"] = ["tip a", "tip b", "base"]
    points = np.ones((4, 3, len(places)))
    points[0, :2], points[2, :2] = places[..., 0].T + 200.0, places[..., 1].T + 500.0
    points[[0, 2], 2] = np.array(other)[:, None]
    capture["data"]["points"] = points
    capture.write(str(path))
    return path


PLACING = ("--format", "c3d", "--plane", "xz", "--clamp", "200,500", "--axis", "0", "--rest", "1", "--sigma", "0.02")


def test_a_marker_that_stands_a_little_off_the_beam_moves_with_its_nearest_point(run: Run, files: Path) -> None:
    places = swing()
    places[:, 1, 0] += 0.4  # 4 % of the length beyond the tip
    capture = write_c3d(files / "capture.c3d", places, (190.0, 480.0))
    code, message = imported(run, files, capture, "--ring-down", *PLACING)
    assert code == 0, message
    motion = ring_down(files)
    np.testing.assert_allclose(motion.rest_mm[1, 0], 10.0)
    np.testing.assert_allclose(np.diff(motion.points_mm[:, 1], axis=0), np.diff(places[-100:, 1], axis=0), atol=1e-3)


def test_a_marker_of_a_beam_that_is_cast_with_a_bow_keeps_its_place_at_rest(run: Run, files: Path) -> None:
    along = np.linspace(0.0, 10.0, 11)
    rows = ", ".join(f"[{x:.4f}, {0.012 * x**2:.5f}]" for x in along)
    text = (files / "specimen.toml").read_text()
    (files / "specimen.toml").write_text(text.replace("[specimen]", f"[specimen]\nrest_shape = [{rows}]", 1))
    rest = np.array([[5.0, 0.3], [9.8, 1.15]])
    places = swing() + (rest - REST_MM)
    table = write_table(files / "bow.csv", places, rest_mm=rest)
    code, message = imported(run, files, table, "--ring-down")
    assert code == 0, message
    np.testing.assert_allclose(ring_down(files).rest_mm, rest, atol=1e-3)


def test_markers_of_a_c3d_file_become_a_ring_down_and_a_state(run: Run, files: Path) -> None:
    places = swing()
    capture = write_c3d(files / "capture.c3d", places, (190.0, 480.0))
    (files / "states.csv").write_text("time_s,field_mT\n1.18,0\n")
    code, message = imported(run, files, capture, "--ring-down", *PLACING, "--states", files / "states.csv")
    assert code == 0, message
    assert "1 of 3 points were left out" in message
    assert "each gram at the tip raises the dynamic modulus" in message
    motion = ring_down(files)
    np.testing.assert_allclose(np.diff(motion.time_s[:, 0]), 1 / RATE_HZ, rtol=1e-4)
    # In frame 1 the beam is held straight.
    np.testing.assert_allclose(
        motion.points_mm[:, 1, 1] - motion.points_mm[0, 1, 1],
        swing()[-len(motion.time_s) :, 1, 1] - swing()[-len(motion.time_s), 1, 1],
        atol=1e-3,
    )
    with open_dataset(files / "out.h5") as dataset:
        assert len(dataset.states) == 1
        assert len(dataset.points()[0].names) == 2


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--ring-down", "--creep"), "--ring-down and --creep: give only one of them"),
        (("--released", "0.2"), "--released: is only for a motion; also give --ring-down or --creep"),
        (("--ring-down", "--released", "9"), "--released 9: should be a time within"),
        (("--ring-down", "--rate", "-3"), "--rate -3: should be greater than 0"),
        (("--ring-down", "--gravity-angle", "nan"), "--gravity-angle nan: should be an angle in degrees, such as 90"),
        (("--ring-down", "--rate", "100"), "--rate needs the column frame"),
        (("--ring-down", "--released", "1.17"), "only 3 frames follow the release"),
        (
            ("--ring-down", "--every", "7"),
            "--every, --average, --dark and --flat: are only for states (load steps at rest)",
        ),
        (("--ring-down", "--row-time", "1e-5"), "--row-time and --exposure: are only for a video"),
        ((), "--states is missing; give states.csv or, for a motion, --ring-down or --creep"),
    ],
)
def test_a_mistake_in_an_imported_motion_is_refused_in_one_line(
    run: Run, files: Path, options: tuple[str, ...], message: str
) -> None:
    code, printed = imported(run, files, write_table(files / "flick.csv", swing()), *options)
    assert code == 2
    assert message in printed
    assert not (files / "out.h5").exists()


def test_a_recovered_dataset_contains_its_motion(run: Run, files: Path) -> None:
    imported(run, files, write_table(files / "flick.csv", swing()), "--ring-down")
    before = ring_down(files)
    code, message = run("recover", files / "out.h5", "-o", files / "whole.h5")
    assert code == 0, message
    with open_dataset(files / "whole.h5") as dataset:
        (after,) = dataset.ring_downs()
    np.testing.assert_array_equal(after.points_mm, before.points_mm)


def test_lost_frames_are_counted_and_flagged_in_the_file(run: Run, files: Path) -> None:
    places = swing()
    table = write_table(files / "flick.csv", places)
    lines = table.read_text().splitlines()
    table.write_text("\n".join(line for line in lines if not line.startswith(("0.5000,", "0.5100,"))))
    code, message = imported(run, files, table, "--ring-down")
    assert code == 0, message
    assert ring_down(files).lost_frames == 2
    with h5py.File(files / "out.h5") as stored:
        motion = stored["entry/ring_down_points/0"]
        assert (motion.attrs["lost_frames"], motion["flags"].asstr()[()]) == (2, "RING_DOWN_LOST")


def test_each_of_several_flicks_is_a_ring_down(run: Run, files: Path) -> None:
    first = swing(240)
    second = 0.6 * (first - REST_MM) + REST_MM
    second[..., 1] -= 0.4 * 2.0 * cantilever_modes(REST_MM[:, 0] / 10.0)[:, 0]
    code, message = imported(
        run, files, write_table(files / "flick.csv", np.concatenate([first, second])), "--ring-down"
    )
    assert code == 0, message
    assert "2 ring-downs of at least 6 periods were found" in message
    with open_dataset(files / "out.h5") as dataset:
        motions = dataset.ring_downs()
    assert [motion.label.rpartition(": ")[2] for motion in motions] == ["flick 1", "flick 2"]
    for motion, size in zip(motions, (1.5, 0.9), strict=True):
        assert motion.points_mm[0, 1, 1] - motion.points_mm[-1, 1, 1] == pytest.approx(size, rel=0.15)


def test_every_option_of_a_motion_reaches_the_function_that_uses_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read: dict[str, Any] = {}
    written: list[Any] = []

    def read_motions(source: Path, specimen: Any, facts: Any, **named: Any) -> Any:
        read.update(named, source=source, facts=facts)
        return SimpleNamespace(motions="motions", calibration="its calibration")

    monkeypatch.setattr(moving, "read_motions", read_motions)
    write = "eimi_lab.dataset.moving.motion_import.write_motion_dataset"
    monkeypatch.setattr(write, lambda *given: written.extend(given))
    monkeypatch.setattr(moving, "open_dataset", lambda path: path)
    times: dict[str, Any] = {"rate": 240.0, "released": 0.3, "exposure": 1e-3, "row_time": 2e-5}
    facts: dict[str, Any] = {"kind": "creep", "hanging": 0.1, "removed": 0.2} | times
    tracks: dict[str, Any] = {"unit": "px", "pixels_per_mm": 8.0, "clamp": (4.0, 5.0), "sigma": 0.4, "rest": 7}
    picture: dict[str, Any] = {"region": (0, 1, 2, 3), "polarity": "bright", "channel": "red"}
    path = moving.import_motion(
        "film.mp4",
        "type1",
        tmp_path / "motion.h5",
        axis=80.0,
        format="kinovea",
        plane="xz",
        calibration="camera.toml",
        along=[(1.0, 2.0), (3.0, 4.0)],
        gravity_angle=85.0,
        **facts,
        **tracks,
        **picture,
    )
    units = {"hanging": "_N", "removed": "_N", "rate": "_Hz", "released": "_s", "exposure": "_s", "row_time": "_s"}
    assert vars(read["facts"]) == {name + units.get(name, ""): value for name, value in facts.items()}
    placing = vars(read["placing"]("loaded"))
    assert placing == tracks | {"axis_deg": 80.0, "plane": "xz", "calibration": "loaded"}
    assert (read["source"], read["calibration"], read["tool"]) == (Path("film.mp4"), "camera.toml", "kinovea")
    assert (read["has_gravity_direction"], read["output"]) == (True, path)
    assert (written[0], written[1], *written[3:]) == (path, "motions", "its calibration", 85.0, True, False)
    for no_gravity in (False, True):
        moving.import_motion("film.mp4", "type1", tmp_path / "other.h5", no_gravity=no_gravity)
        assert read["has_gravity_direction"] is no_gravity
        assert (written[-3], written[-2]) == (None, not no_gravity)
    with pytest.raises(InputError, match="rate = 0 should be a finite number greater than 0"):
        moving.import_motion("film.mp4", "type1", tmp_path / "other.h5", rate=0.0)


def creeping(frames: int = 120) -> np.ndarray:
    # Return two points in each frame, (frames, 2, 2) in mm, which sink after `HELD` frames.
    time = (np.arange(frames) - HELD) / RATE_HZ
    sunk = np.where(time >= 0, 1.0 + 0.2 * np.log1p(np.maximum(time, 0) / 0.01), 0.0)
    places = np.repeat(REST_MM[None], frames, axis=0)
    places[..., 1] -= sunk[:, None] * cantilever_modes(REST_MM[:, 0] / 10.0)[:, 0]
    return places


@pytest.mark.parametrize(
    ("options", "before_N", "is_told"),
    [((), None, True), (("--hanging", "0.3"), 0.0, False), (("--hanging", "0.1", "--removed", "0.2"), 0.3, False)],
)
def test_creep_begins_with_the_weight_that_is_hung_on_the_beam_or_taken_from_it(
    run: Run, files: Path, options: tuple[str, ...], before_N: float | None, is_told: bool
) -> None:
    code, message = imported(run, files, write_table(files / "creep.csv", creeping()), "--creep", *options)
    assert code == 0, message
    assert ("only after a known change of the load" in message) == is_told
    assert "the release is assumed at 0.19 s" in message
    (recorded,) = load_motions(files / "out.h5").motions
    assert recorded.is_stepped == (before_N is not None)
    if before_N is not None:
        ((_, before),) = recorded.before
        np.testing.assert_allclose(np.linalg.norm(before.tip_force_N), before_N, atol=1e-12)

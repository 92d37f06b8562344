"""`eimi import` reads videos and averages frames; damaged or misleading images give an error or warnings."""

from __future__ import annotations

import json
import resource
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eimi_fitting.inference.evidence.measurements import EdgeObservation
from eimi_lab.config.calibration import load_calibration
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.dataset.stored_edges import write_edges
from eimi_lab.fits.evidence import load_evidence
from eimi_lab.process.errors import InputError
from eimi_lab.virtual.optics import expose
from eimi_lab.vision.flags import judge
from eimi_lab.vision.image_files import read_image
from eimi_lab.vision.image_sizes import claimed_size
from tests.patience import PATIENCE_S
from tests.shared.rendered_edges import NOMINAL, bend, make_bent_scene

Run = Callable[..., tuple[int, str]]
Draw = Callable[..., np.ndarray]


def imported(run: Run, files: Path, source: str = "frames", *more: str) -> tuple[int, str]:
    tables = [f"--{name}={files / name}.{'csv' if name == 'states' else 'toml'}" for name in ("states", "specimen")]
    calibration = f"--calibration={files / 'calibration.toml'}"
    return run("import", files / source, *tables, calibration, "-o", files / "out.h5", *more)


def fill(files: Path, images: dict[str, np.ndarray], currents: list[float]) -> None:
    (files / "frames").mkdir(exist_ok=True)
    for name, image in images.items():
        assert cv2.imwrite(str(files / "frames" / name), image)
    rows = [f"{name},{current}" for name, current in zip(images, currents, strict=True)]
    (files / "states.csv").write_text("\n".join(["frame,current_A", *rows]) + "\n")


def test_frames_of_a_video_are_imported_by_number(run: Run, files: Path, frame: Draw) -> None:
    writer = cv2.VideoWriter(str(files / "run.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (128, 96))
    for number in range(6):
        writer.write(cv2.cvtColor(frame(number, shift_px=2.0 * number), cv2.COLOR_GRAY2BGR))
    writer.release()
    (files / "states.csv").write_text("frame,current_A\n4,0.2\n1,0\n2,0\n")
    assert imported(run, files, "run.avi") == (0, "")
    with open_dataset(files / "out.h5") as dataset:
        assert [len(dataset.images(state.index)) for state in dataset.states] == [2, 1]
        dark = [float(np.flatnonzero(dataset.images(k)[-1][48] < 100).mean()) for k in (0, 1)]
    assert dark == pytest.approx([63.5 + 4.0, 63.5 + 8.0], abs=1.0)
    for rows, expected in (
        ("1,0\n9,1", "run.avi: has no frame 9 (counted from 0), because the video ends after "),
        ("1,0\n1,1", "listed once; row 2"),
        ("a,0\n1,1", "whole number"),
    ):
        (files / "states.csv").write_text(f"frame,current_A\n{rows}\n")
        status, message = imported(run, files, "run.avi", "--force")
        assert (status, message.count("\n"), expected in message) == (2, 1, True)
    (files / "states.csv").write_text("frame,current_A\n1,0\n2,1\n")
    (files / "run.avi").write_bytes(b"no video")
    status, message = imported(run, files, "run.avi", "--force")
    assert (status, "run.avi: is not a video" in message) == (2, True)


def test_frames_of_a_video_are_imported_by_time(run: Run, files: Path, frame: Draw) -> None:
    writer = cv2.VideoWriter(str(files / "run.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (128, 96))
    for number in range(6):
        writer.write(cv2.cvtColor(frame(number, shift_px=2.0 * number), cv2.COLOR_GRAY2BGR))
    writer.release()
    (files / "states.csv").write_text("time_s,current_A\n0.42,0.2\n0,0\n")
    assert imported(run, files, "run.avi") == (0, "")
    with open_dataset(files / "out.h5") as dataset:
        dark = [float(np.flatnonzero(dataset.images(k)[-1][48] < 100).mean()) for k in (0, 1)]
        assert dataset.last_time_s() == pytest.approx(0.4)
    assert dark == pytest.approx([63.5, 63.5 + 8.0], abs=1.0)
    for table, expected in (
        ("time_s,current_A\n0,0\n0.7,1\n", "row 3: time_s = '0.7' should be within run.avi, which ends at 0.600 s"),
        ("time_s,current_A\n0,0\n0.02,1\n", "row 3: time_s = '0.02' should be listed once; row 2 lists the same frame"),
        ("time_s,frame,current_A\n0,0,0\n", "needs one of the columns frame and time_s"),
    ):
        (files / "states.csv").write_text(table)
        status, message = imported(run, files, "run.avi", "--force")
        assert (status, expected in message) == (2, True)


def test_every_nth_frame_of_a_video_has_the_load_that_acts_on_it(run: Run, files: Path, frame: Draw) -> None:
    # A table gives the time or the frame number at which each load begins.
    writer = cv2.VideoWriter(str(files / "run.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (128, 96))
    for number in range(12):
        writer.write(cv2.cvtColor(frame(number), cv2.COLOR_GRAY2BGR))
    writer.release()
    (files / "states.csv").write_text("time_s,until_s,current_A\n0.1,,0\n0.55,0.95,0.2\n")
    assert imported(run, files, "run.avi", "--every", "2") == (0, "")
    with open_dataset(files / "out.h5") as dataset:
        assert [state.current_A for state in dataset.states] == [0.0, 0.2]
        assert [len(dataset.images(k)) for k in (0, 1)] == [2, 2]  # frames 2 and 4; 6 and 8
        assert dataset.last_time_s() == pytest.approx(0.8)
    (files / "states.csv").write_text("frame,current_A\n0,0\n6,0.2\n")
    assert imported(run, files, "run.avi", "--every", "3", "--force") == (0, "")
    with open_dataset(files / "out.h5") as dataset:
        assert [len(dataset.images(k)) for k in (0, 1)] == [2, 2]  # frames 0 and 3; 6 and 9
    for table, every, expected in (
        ("time_s,current_A\n0.5,0\n0.2,1\n", "2", "row 3: time_s = '0.2' should be later than in the previous row"),
        ("time_s,current_A\n0,0\n0.11,1\n0.15,2\n", "2", "row 3: time_s = '0.11' should be the beginning of a load"),
        ("time_s,current_A\n0,0\n", "0", "--every"),
    ):
        (files / "states.csv").write_text(table)
        status, message = imported(run, files, "run.avi", "--every", every, "--force")
        assert (status, expected in message) == (2, True)
    fill(files, {"f_0.png": frame(0)}, [0])
    status, message = imported(run, files, "frames", "--every", "2", "--force")
    assert (status, "--every 2: is for a video" in message) == (2, True)


def test_colour_is_kept(run: Run, files: Path, frame: Draw) -> None:
    # Colours are stored also if only the second image is in colour, or if the dark frame is grey.
    red = np.dstack([frame(1) // 3, frame(1) // 2, frame(2)])
    fill(files, {"f_0.png": frame(0), "f_1.png": red}, [0, 1])
    cv2.imwrite(str(files / "dark.png"), np.full((96, 128), 4, np.uint8))
    assert imported(run, files, "frames", "--dark", str(files / "dark.png")) == (0, "")
    with open_dataset(files / "out.h5") as dataset:
        assert np.array_equal(dataset.images(0)[0], np.dstack([frame(0)] * 3))
        assert np.array_equal(dataset.images(1)[0], red)
        correction = dataset.correction()
        assert correction is not None
        np.testing.assert_allclose(correction.apply(red)[..., 0], np.maximum(red[..., 0] - 4.0, 0))
    flat = np.dstack([np.full((96, 128), value, np.uint8) for value in (100, 150, 240)])
    flat[:, :64] //= 2
    cv2.imwrite(str(files / "flat.png"), flat)
    assert run("segment", files / "out.h5", "--flat", files / "flat.png")[0] == 0
    with open_dataset(files / "out.h5") as dataset:
        correction = dataset.correction()
        assert correction is not None
        even = correction.apply(flat)
        assert [float(np.ptp(even[..., k])) < 1e-3 for k in range(3)] == [True] * 3
        assert even[0, 0].argmax() == 2  # the correction keeps the colour of the lamp


def test_a_fit_uses_doubtful_states_with_larger_uncertainties_and_leaves_out_unusable_states(
    run: Run, files: Path, frame: Draw
) -> None:
    specimen, calibration = load_specimen(files / "specimen.toml"), load_calibration(files / "calibration.toml")
    images = {}
    for k in range(4):
        scene = make_bent_scene(NOMINAL, calibration, specimen, bend(specimen, 10.0 + 10.0 * k), (128, 96))
        images[f"f_{k}.png"] = expose(scene, np.random.default_rng(k))
    fill(files, images, [0, 1, 2, 3])
    assert imported(run, files) == (0, "")
    out = files / "out.h5"
    assert run("segment", out)[0] == 0
    with open_dataset(out) as dataset:
        edges = [replace(edge_set, flags=()) for edge_set in dataset.edges() or ()]
    clipped, unfocused, age = (
        judge({name: value})
        for name, value in (("saturated_share", 1.0), ("blur_px", 9.0), ("calibration_age_days", 200.0))
    )
    flags = [(), clipped, unfocused, age]
    write_edges(
        out, [replace(edge_set, flags=flags_of_state) for edge_set, flags_of_state in zip(edges, flags, strict=True)]
    )
    evidence = load_evidence(out)
    assert [state.index for state in evidence.states] == [0, 1, 3]
    assert (
        "left out: DEFOCUS in 1 (state 2); used although they have flags: SATURATED in 1 (state 1), "
        "CALIBRATION_STALE in 1 (state 3); the uncertainty of the points was increased in 1 state (the largest "
        "increase is " in evidence.used.in_words()
    )
    observed = evidence.experiment.observed
    assert isinstance(observed, EdgeObservation)
    for k, state in enumerate((0, 1, 3)):
        added = 0.3 / 8.0 if state == 1 else 0.0
        sigma = edges[state].left.sigma_mm
        np.testing.assert_allclose(observed.sigma_mm[k, 0][: len(sigma)], np.hypot(sigma, added))
    assert len(load_evidence(out, flagged=True).states) == 4


def test_colours_for_grey_frames_are_refused(run: Run, files: Path, frame: Draw) -> None:
    fill(files, {"f_0.png": frame(0), "f_1.png": frame(1)}, [0, 1])
    cv2.imwrite(str(files / "flat.png"), np.dstack([frame(0), frame(1), frame(2) // 2]))
    status, message = imported(run, files, "frames", "--flat", str(files / "flat.png"))
    assert (status, "--flat: is 128 x 96 px of 8 bits in colour; the frames are 128 x 96 px" in message) == (2, True)


def test_frames_of_a_state_are_averaged_on_request(run: Run, files: Path, frame: Draw) -> None:
    fill(files, {f"f_{k}.png": frame(k) for k in range(6)}, [0, 0, 0, 0, 0, 1])
    assert imported(run, files, "frames", "--average") == (0, "")
    with open_dataset(files / "out.h5") as dataset:
        [mean] = dataset.images(0)
    assert mean.dtype == np.uint16
    np.testing.assert_allclose(mean / 257.0, np.mean([frame(k) for k in range(5)], axis=0), atol=0.01)


def test_imported_frames_get_flags(run: Run, files: Path, frame: Draw) -> None:
    images = {f"f_{k}.png": frame(k) for k in (0, 5, 10, 20)}  # the numbers count by 5, and 15 is missing
    images |= {f"f_{30 + k}.png": frame(min(k, 1)) for k in range(3)}  # the last frame occurs twice
    images |= {f"f_{40 + k}.png": frame(40 + k, shift_px=0.5 * k) for k in range(3)}
    images |= {f"f_{50 + k}.png": frame(50 + k) for k in range(3)}
    images["f_60.png"] = frame(52)  # the previous frame, with another load
    fill(files, images, [0, 0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3, 4])
    assert imported(run, files) == (0, "")
    with open_dataset(files / "out.h5") as dataset:
        names = [{flag.name for flag in state.flags} for state in dataset.states]
    assert names == [{"DROPPED"}, {"DUPLICATE"}, {"NOT_SETTLED"}, set(), {"DUPLICATE"}]


def test_progress_is_shown_for_many_frames(run: Run, files: Path, frame: Draw) -> None:
    fill(files, {f"f_{k}.png": frame(k) for k in range(50)}, [k // 25 for k in range(50)])
    status, message = imported(run, files)
    assert status == 0
    assert [line.split(":")[0] for line in message.splitlines()] == ["import 1/2", "import 2/2"]


def test_edges_are_stored_with_the_age_and_the_digest_of_the_calibration(run: Run, files: Path, frame: Draw) -> None:
    with (files / "calibration.toml").open("a") as file:
        file.write("calibrated_on = 2020-01-01\n")
    fill(files, {"f_0.png": frame(0), "f_1.png": frame(1)}, [0, 1])
    assert imported(run, files) == (0, "")
    assert run("segment", files / "out.h5", "--overlay", files / "seen", "--csv", files / "csv")[0] == 0
    assert cv2.imread(str(files / "seen" / "contact_sheet.png")).shape[1] == 640
    with open_dataset(files / "out.h5") as dataset:
        for edges in dataset.edges() or ():
            assert edges.calibration_digest == load_calibration(files / "calibration.toml").digest
            assert edges.calibration_age_days is not None
            assert edges.calibration_age_days > 2000
            assert "CALIBRATION_STALE" in {flag.name for flag in edges.flags}


def test_overlays_that_do_not_fit_on_the_disk_leave_no_files(run: Run, files: Path, frame: Draw) -> None:
    fill(files, {f"f_{k}.png": frame(k) for k in range(9)}, list(range(9)))
    assert imported(run, files) == (0, "")
    assert run("segment", files / "out.h5", "--csv", files / "there")[0] == 0
    before = {file.name: file.read_bytes() for file in (files / "there").iterdir()}
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, ((files / "out.h5").stat().st_size + (1 << 14) + 44600, hard))
    try:  # the overlay of one frame is smaller than the dataset, and the sheet with all overlays is larger
        messages = [run("segment", files / "out.h5", "--overlay", files / name, "--force") for name in ("there", "a/b")]
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert [status for status, _ in messages] == [1, 1]
    for name, (_, message) in zip(("there", "a/b"), messages, strict=True):
        assert f"'{files / name}/" in message
        assert ".unfinished" not in message
    assert {file.name: file.read_bytes() for file in (files / "there").iterdir()} == before
    assert not (files / "a").exists()


def within(room: int, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    # Run an `eimi` command that may write files of at most `room` bytes, in another process.
    return subprocess.run(
        [sys.executable, "-m", "eimi_lab", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (room, room)),
    )


@pytest.mark.parametrize("share", [0.5, 1.01])
def test_a_full_disk_leaves_a_dataset_as_it_was(run: Run, files: Path, frame: Draw, share: float) -> None:
    # The disk becomes full while the dataset is copied or gets edges.
    fill(files, {f"f_{k}.png": frame(k) for k in range(9)}, list(range(9)))
    assert imported(run, files) == (0, "")
    before = (files / "out.h5").read_bytes()
    done = within(int(share * len(before)), "segment", files / "out.h5")
    *_, last = done.stderr.splitlines()
    assert (done.returncode, last) == (1, f"eimi: [Errno 27] File too large: '{files / 'out.h5'}'")
    assert "Traceback" not in done.stderr
    assert (files / "out.h5").read_bytes() == before
    assert not list(files.glob(".*"))


def test_the_error_for_a_dataset_that_does_not_fit_on_the_disk_names_the_dataset(files: Path, frame: Draw) -> None:
    fill(files, {f"f_{k}.png": frame(k) for k in range(9)}, list(range(9)))
    options = [f"--{name}={files / name}.toml" for name in ("specimen", "calibration")]
    options += [f"--states={files / 'states.csv'}", f"--output={files / 'out.h5'}"]
    done = within(60_000, "import", files / "frames", *options)
    assert (done.returncode, done.stderr) == (1, f"eimi: {files / 'out.h5'}: cannot be written: File too large\n")
    assert not list(files.glob("*out.h5*"))


def test_a_damaged_video_is_refused_in_one_line(files: Path, frame: Draw) -> None:
    # In another process, the test can read the messages of the video decoder.
    (files / "run.mp4").write_bytes(b"no video")
    (files / "states.csv").write_text("frame,current_A\n1,0\n2,1\n")
    tables = [f"--{name}={files / name}.toml" for name in ("specimen", "calibration")]
    command = [
        sys.executable,
        "-m",
        "eimi_lab",
        "import",
        files / "run.mp4",
        f"--states={files / 'states.csv'}",
        *tables,
    ]
    ended = subprocess.run([*command, "-o", files / "out.h5"], capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr.count("\n"), "is not a video" in ended.stderr) == (2, 1, True)


def test_dark_frame_and_flat_field(run: Run, files: Path, frame: Draw) -> None:
    fill(files, {"f_0.png": frame(0), "f_1.png": frame(1)}, [0, 1])
    assert imported(run, files) == (0, "")
    cv2.imwrite(str(files / "flat.png"), np.full((96, 128), 200, np.uint8))
    cv2.imwrite(str(files / "black.png"), np.zeros((96, 128), np.uint8))
    cv2.imwrite(str(files / "small.png"), np.full((9, 12), 200, np.uint8))
    out = files / "out.h5"
    assert run("segment", out, "--flat", files / "flat.png", "--dark", files / "black.png")[0] == 0
    assert run("segment", out, "--uncorrected", "--flat", files / "flat.png")[0] == 2
    for arguments, expected in (
        (("--flat", files / "black.png"), "black.png: the flat field is dark in places"),
        (("--flat", files / "small.png"), "--flat: is 12 x 9 px of 8 bits; the frames are 128 x 96 px of 8 bits"),
        (("--flat", files / "flat.png", "--dark", files / "small.png"), "flat.png: the flat field has the shape"),
        (("--dark", files / "none.png"), "none.png: cannot be read"),
        (("--dark", files / "flat.png"), "--dark: the image has a median of 200 grey levels, but the back-light in "),
    ):
        status, message = run("segment", out, *arguments)
        assert (status, expected in message) == (2, True)


def test_dark_frame_and_flat_field_are_stored_with_the_frames(run: Run, files: Path) -> None:
    # The pixels differ in brightness, so that the edges differ without the flat field (an image of the uneven light).
    gain = 1.0 + 0.1 * np.sin(np.arange(128) / 3.0)
    specimen, calibration = load_specimen(files / "specimen.toml"), load_calibration(files / "calibration.toml")
    images = {}
    for k in range(2):
        beam = bend(specimen, 20.0 + 20.0 * k)
        scene = make_bent_scene(NOMINAL, calibration, specimen, beam, (128, 96))
        images[f"f_{k}.png"] = np.rint(0.75 * gain * expose(scene, np.random.default_rng(0))).astype(np.uint8)
    fill(files, images, [0, 1])
    cv2.imwrite(str(files / "flat.png"), np.tile(0.75 * gain * 220, (96, 1)).astype(np.uint8))
    out = files / "out.h5"

    def edges() -> np.ndarray:
        # Return the n edge points that a fit uses, (x, y) in mm, shape (n, 2).
        load_evidence(out, flagged=True)
        with open_dataset(out) as dataset:
            return np.concatenate([side.points_mm for e in dataset.edges() or () for side in (e.left, e.right)])

    assert imported(run, files) == (0, "")
    raw = edges()
    assert run("segment", out, "--flat", files / "flat.png")[0] == 0
    corrected = edges()
    assert corrected.shape != raw.shape or np.abs(corrected - raw).max() > 0.01
    assert run("segment", out)[0] == 0
    np.testing.assert_array_equal(edges(), corrected)
    assert run("segment", out, "--uncorrected")[0] == 0
    np.testing.assert_array_equal(edges(), raw)
    assert imported(run, files, "frames", "--force", "--flat", files / "flat.png") == (0, "")
    np.testing.assert_array_equal(edges(), corrected)
    assert imported(run, files, "frames", "--force", "--average", "--flat", files / "flat.png") == (0, "")
    np.testing.assert_allclose(edges(), corrected, atol=2e-3)
    assert imported(run, files, "frames", "--force", "--dark", files / "none.png")[0] == 2


def png_that_claims(width: int, height: int) -> bytes:
    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(b"\0")) + chunk(b"IEND", b"")


@pytest.mark.parametrize("ending", [".png", ".jpg", ".bmp", ".tif", ".pgm"])
def test_a_size_is_read_before_the_image(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"image{ending}"
    cv2.imwrite(str(path), np.zeros((37, 53), np.uint8))
    assert claimed_size(path.read_bytes()) == (53, 37)


@given(
    st.sampled_from([b"\x89PNG", b"\xff\xd8\xff\xc0", b"BM", b"II*\0", b"MM\0*", b"P5 ", b""]), st.binary(max_size=60)
)
def test_any_header_is_read_or_ignored(start: bytes, rest: bytes) -> None:
    size = claimed_size(start + rest)
    assert size is None or all(isinstance(side, int) for side in size)


def test_an_image_whose_header_claims_two_hundred_megapixels_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "huge.png"
    path.write_bytes(png_that_claims(20_000, 10_000))
    with pytest.raises(InputError, match=r"huge\.png: has a size of 20000 x 10000 px"):
        read_image(path)


def test_a_tiff_of_floating_point_numbers_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "float.tif"
    cv2.imwrite(str(path), np.full((40, 40), np.nan, np.float32))
    with pytest.raises(InputError, match=r"float\.tif: has pixels of type float32; it should have unsigned pixels"):
        read_image(path)


def test_an_image_of_one_pixel_is_refused(run: Run, files: Path) -> None:
    fill(files, {f"f_{k}.png": np.zeros((1, 1), np.uint8) for k in range(2)}, [0, 1])
    status, message = imported(run, files)
    assert (status, message.count("\n")) == (2, 1)
    assert "f_0.png: is 1 x 1 px; clamp_midpoint_px = [64.0, 8.0] is outside this picture" in message


def two_beams(image: np.ndarray) -> np.ndarray:
    return np.minimum(image, np.roll(image, 40, axis=1))


def clutter(image: np.ndarray) -> np.ndarray:
    spoilt = image.copy()
    for x, y in np.random.default_rng(0).integers(0, 96, (30, 2)):
        cv2.circle(spoilt, (int(x), int(y)), 5, 20, -1)
    return spoilt


HOSTILE: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "black": np.zeros_like,
    "white": lambda image: np.full_like(image, 255),
    "noise": lambda image: np.random.default_rng(0).integers(0, 256, image.shape, dtype=np.uint8),
    "no beam": lambda image: np.full_like(image, 200),
    "two beams": two_beams,
    "leaving": lambda image: image,  # the beam drawn for these tests reaches the lower edge of the frame
    "clutter": clutter,
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_picture_gives_flags(run: Run, files: Path, frame: Draw, name: str) -> None:
    fill(files, {f"f_{k}.png": HOSTILE[name](frame(k)) for k in range(2)}, [0, 1])
    assert imported(run, files)[0] == 0
    assert run("segment", files / "out.h5", "--overlay", files / "seen")[0] == 0
    with open_dataset(files / "out.h5") as dataset:
        for edges in dataset.edges() or ():
            assert edges.flags
            if name in ("black", "white", "noise", "no beam"):
                assert len(edges.left.points_mm) == 0
            if name == "leaving":  # the beam is followed to the border and flagged
                assert "TOUCHES_FRAME" in {flag.name for flag in edges.flags}
    status, message = run("fit", files / "out.h5", "--model", "neo-hookean", "-o", files / "fit.json")
    if status == 0:  # a straight part of a beam was found, from which no modulus follows
        (fit,) = json.loads((files / "fit.json").read_text())["fits"]
        low, high = fit["initial_shear_modulus"]["interval_95"]
        assert high > 1000 * low
    else:
        assert (status, message.splitlines()[-1].startswith("eimi: ")) == (2, True)

"""`eimi import` makes a dataset from a correct folder; another folder gives an error of one line and no file."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from eimi_lab.config.csv_tables import read_table
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.process.errors import InputError
from tests.patience import PATIENCE_S

Run = Callable[..., tuple[int, str]]


def import_frames(run: Run, files: Path) -> tuple[int, str]:
    return run(
        "import",
        files / "frames",
        "--states",
        files / "states.csv",
        "--specimen",
        files / "specimen.toml",
        "--calibration",
        files / "calibration.toml",
        "-o",
        files / "out.h5",
    )


def import_points(run: Run, files: Path) -> tuple[int, str]:
    return run(
        "import",
        files / "points.csv",
        "--states",
        files / "states.csv",
        "--specimen",
        files / "specimen.toml",
        "--gravity-angle",
        "-90",
        "-o",
        files / "out.h5",
    )


def test_images_are_imported_in_natural_order(run: Run, pictures: Path, frame: Callable[..., np.ndarray]) -> None:
    states = pictures / "states.csv"
    header, *rows = states.read_text().splitlines()
    states.write_text("\n".join([header, *sorted(rows)]))  # the alphabetical order would be 1, 10, 2, 20
    assert import_frames(run, pictures) == (0, "")
    with open_dataset(pictures / "out.h5") as dataset:
        assert [state.current_A for state in dataset.states] == [0.1, 0.2, 1.0, 2.0]
        assert [state.field_mT for state in dataset.states] == pytest.approx([0.47, 0.94, 4.7, 9.4])
        assert [state.measured_A for state in dataset.states] == [None] * 4
        assert np.array_equal(dataset.images(1)[0], frame(2))


def test_consecutive_images_with_one_load_are_frames_of_one_state(run: Run, pictures: Path) -> None:
    (pictures / "states.csv").write_text(
        "tip_force_N,field_mT,frame\n0,0,1\n0,0,2\n\n0.1,0,10\n0,0,frame_20\n", encoding="utf-8-sig"
    )
    assert import_frames(run, pictures) == (0, "")
    with open_dataset(pictures / "out.h5") as dataset:
        assert [len(dataset.images(state.index)) for state in dataset.states] == [2, 1, 1]
        assert [state.tip_force_N for state in dataset.states] == [0.0, 0.1, 0.0]


def test_images_that_no_row_lists_are_left_out_with_a_note(run: Run, pictures: Path) -> None:
    for k in range(9):
        shutil.copy(pictures / "frames" / "frame_1.png", pictures / "frames" / f"x{k}.png")
    status, message = import_frames(run, pictures)
    assert (status, message.count("\n")) == (0, 1)
    assert "states.csv does not list them: x0.png, x1.png, x2.png, x3.png, x4.png and 4 more" in message
    with open_dataset(pictures / "out.h5") as dataset:
        assert len(dataset.states) == 4


def test_paths_are_relative_to_the_table(run: Run, pictures: Path, frame: Callable[..., np.ndarray]) -> None:
    # Paths may also be relative to the folder of the images, which comes first, and may have backslashes.
    (pictures / "elsewhere").mkdir()
    cv2.imwrite(str(pictures / "elsewhere" / "other.png"), frame(7))
    cv2.imwrite(str(pictures / "frame_1.png"), frame(8))
    (pictures / "states.csv").write_text("frame,current_A\nframe_1.png,0\nelsewhere\\other.png,1\n")
    status, message = import_frames(run, pictures)
    assert (status, "left out" in message) == (0, True)
    with open_dataset(pictures / "out.h5") as dataset:
        assert [state.current_A for state in dataset.states] == [0.0, 1.0]
        assert np.array_equal(dataset.images(0)[0], frame(1))
        assert np.array_equal(dataset.images(1)[0], frame(7))


def test_a_dataset_can_be_made_from_one_picture(run: Run, pictures: Path) -> None:
    (pictures / "states.csv").write_text("frame,current_A\nframe_2.png,0.5\n")
    arguments = ["--states", pictures / "states.csv", "--specimen", pictures / "specimen.toml"]
    arguments += ["--calibration", pictures / "calibration.toml", "-o", pictures / "out.h5"]
    assert run("import", pictures / "frames" / "frame_2.png", *arguments) == (0, "")
    status, message = run("segment", pictures / "out.h5")
    assert (status, message.count("segment 1/1")) == (0, 1)
    with open_dataset(pictures / "out.h5") as dataset:
        assert ([state.current_A for state in dataset.states], len(dataset.edges() or ())) == ([0.5], 1)


def test_a_table_written_by_a_spreadsheet_is_read(run: Run, pictures: Path) -> None:
    # Semicolons, decimal commas and a byte-order mark are accepted; an Excel file is refused.
    (pictures / "states.csv").write_text("frame;current_A\nframe_1.png;0,25\nframe_2.png;1.5\n", encoding="utf-8-sig")
    assert import_frames(run, pictures)[0] == 0
    with open_dataset(pictures / "out.h5") as dataset:
        assert [state.current_A for state in dataset.states] == [0.25, 1.5]
    (pictures / "states.xlsx").write_bytes(b"PK\x03\x04\xff\xfe")
    with pytest.raises(InputError, match=r"states\.xlsx: is a spreadsheet; save its table as CSV"):
        read_table(pictures / "states.xlsx", ["frame"])


def test_a_straight_beam_that_leaves_the_picture_gives_a_warning(run: Run, pictures: Path) -> None:
    rewrite("specimen.toml", "length_mm = 10.0", "length_mm = 30.0")(pictures)
    status, message = import_frames(run, pictures)
    assert (status, message.count("\n")) == (0, 1)
    assert "the straight beam, 240 px long, would leave the picture of 128 x 96 px" in message
    assert (pictures / "out.h5").exists()


def test_a_file_given_for_the_wrong_argument_is_named(run: Run, pictures: Path) -> None:
    def message(source: Path) -> str:
        arguments = ["--states", pictures / "states.csv", "--specimen", pictures / "specimen.toml"]
        arguments += ["--calibration", pictures / "calibration.toml", "-o", pictures / "other.h5"]
        status, printed = run("import", source, *arguments)
        assert (status, printed.count("\n")) == (2, 1)
        return printed

    assert import_frames(run, pictures)[0] == 0
    assert "out.h5: is a dataset already; continue with `eimi segment` or `eimi fit`" in message(pictures / "out.h5")
    assert "states.csv: is also given with --states; the first argument should be the images" in message(
        pictures / "states.csv"
    )
    assert "specimen.toml: is a TOML file" in message(pictures / "specimen.toml")


def rewrite(name: str, old: str, new: str) -> Callable[[Path], None]:
    def spoil(files: Path) -> None:
        text = (files / name).read_text()
        assert old in text
        (files / name).write_text(text.replace(old, new, 1))

    return spoil


def truncate(files: Path) -> None:
    image = files / "frames" / "frame_10.png"
    image.write_bytes(image.read_bytes()[:-500])


def shrink(files: Path) -> None:
    cv2.imwrite(str(files / "frames" / "frame_10.png"), np.zeros((96, 100), np.uint8))


def stack(files: Path) -> None:
    image = cv2.imread(str(files / "frames" / "frame_10.png"), cv2.IMREAD_GRAYSCALE)
    (files / "frames" / "frame_10.png").unlink()
    assert cv2.imwritemulti(str(files / "frames" / "frame_10.tif"), [image, image])
    rewrite("states.csv", "frame_10.png", "frame_10.tif")(files)


def see_through(files: Path) -> None:
    image = cv2.imread(str(files / "frames" / "frame_10.png"), cv2.IMREAD_GRAYSCALE)
    opacity = np.where(image < 128, 255, 0).astype(np.uint8)
    cv2.imwrite(str(files / "frames" / "frame_10.png"), np.dstack([image, image, image, opacity]))


def deepen(files: Path) -> None:
    image = cv2.imread(str(files / "frames" / "frame_10.png"), cv2.IMREAD_GRAYSCALE)
    cv2.imwrite(str(files / "frames" / "frame_10.png"), 257 * image.astype(np.uint16))


def turned(files: Path) -> None:
    image = cv2.imread(str(files / "frames" / "frame_10.png"), cv2.IMREAD_GRAYSCALE)
    cv2.imwrite(str(files / "frames" / "frame_10.png"), cv2.rotate(image, cv2.ROTATE_90_CLOCKWISE))


def pipe(files: Path) -> None:
    (files / "frames" / "frame_10.png").unlink()
    os.mkfifo(files / "frames" / "frame_10.png")


def empty(files: Path) -> None:
    for image in (files / "frames").iterdir():
        image.unlink()


BAD_FRAMES: dict[str, tuple[Callable[[Path], object], str]] = {
    "semicolons in the header alone": (
        rewrite("states.csv", "frame,current_A", "frame;current_A"),
        "states.csv: row 2: has 1 cells, but the header has 2 columns",
    ),
    "header": (
        rewrite("states.csv", "current_A", "curent_A"),
        "states.csv: row 1: 'curent_A' is not a known column; did you mean current_A?",
    ),
    "column missing": (
        rewrite("states.csv", "frame,", "tip_force_N,"),
        "states.csv: row 1: the column frame is missing",
    ),
    "no load": (
        lambda files: (files / "states.csv").write_text("frame,tip_force_N\nframe_1.png,0\n"),
        "neither current_A nor field_mT",
    ),
    "both loads": (
        lambda files: (files / "states.csv").write_text("frame,current_A,field_mT\nframe_1.png,0,0\n"),
        "both current_A and field_mT",
    ),
    "text for a number": (
        rewrite("states.csv", "0.2", "much"),
        "states.csv: row 3: current_A = 'much' should be a number",
    ),
    "decimal comma": (
        rewrite("states.csv", ",0.2", ",0,2"),
        "states.csv: row 3: has 3 cells, but the header has 2 columns; numbers with a decimal comma need semicolons",
    ),
    "case of a name": (
        rewrite("states.csv", "frame_2.png", "elsewhere/Frame_2.PNG"),
        "no image has this name; did you mean frame_2.png?",
    ),
    "Latin text": (
        lambda files: (files / "states.csv").write_bytes("frame,current_A\nfräme_1.png,0\n".encode("latin-1")),
        "states.csv: is not text in UTF-8 (byte 18); save it with the encoding UTF-8",
    ),
    "other depth": (deepen, "frame_10.png: is 128 x 96 px of 16 bits, but frame_1.png is 128 x 96 px of 8 bits"),
    "stack": (stack, "frame_10.tif: is a stack of pictures; save each picture as a separate file"),
    "see-through": (see_through, "frame_10.png: is transparent in places"),
    "turned": (
        turned,
        "frame_10.png: is 96 x 128 px of 8 bits, but frame_1.png is 128 x 96 px of 8 bits; all pictures of a dataset "
        "need the same size and bit depth: rotate this picture by 90 degrees, or remove it",
    ),
    "not finite": (
        rewrite("states.csv", "0.2", "nan"),
        "states.csv: row 3: current_A = 'nan' should be a finite number",
    ),
    "cell missing": (rewrite("states.csv", ",0.2", ""), "states.csv: row 3: has 1 cells"),
    "empty table": (lambda files: (files / "states.csv").write_text(""), "states.csv: is empty"),
    "header only": (
        lambda files: (files / "states.csv").write_text("frame,current_A\n"),
        "states.csv: has a header but no rows",
    ),
    "no table": (lambda files: (files / "states.csv").unlink(), "states.csv: cannot be read"),
    "image missing": (
        lambda files: (files / "frames" / "frame_2.png").unlink(),
        "states.csv: row 3: frame = 'frame_2.png' should be an image in",
    ),
    "image twice": (
        rewrite("states.csv", "frame_2.png", "frame_1.png"),
        "states.csv: row 3: frame = 'frame_1.png' should be listed once; row 2",
    ),
    "images missing": (
        lambda files: [(files / "frames" / f"frame_{k}.png").unlink() for k in (2, 10)],
        "; no image has this name; the same holds for rows 4\n",
    ),
    "image truncated": (truncate, "frame_10.png: is truncated or damaged"),
    "image empty": (lambda files: (files / "frames" / "frame_10.png").write_bytes(b""), "frame_10.png: is empty"),
    "no image": (
        lambda files: (files / "frames" / "frame_10.png").write_text("hello"),
        "frame_10.png: is not an image",
    ),
    "other size": (
        shrink,
        "frame_10.png: is 100 x 96 px of 8 bits, but frame_1.png is 128 x 96 px of 8 bits; all pictures of a dataset "
        "need the same size and bit depth: export all pictures in the same way, or remove this picture",
    ),
    "image a pipe": (pipe, "frame_10.png: is a folder, a device or a pipe, not a file"),
    "empty folder": (empty, "frames: holds no images"),
    "wrong scale": (
        rewrite("specimen.toml", "length_mm = 10.0", "length_mm = 50.0"),
        "frame_1.png: is 128 x 96 px; a beam of length_mm = 50 and width_mm = 2 at pixels_per_mm = 8 is 400 x 16 px",
    ),
    "wrong clamp": (
        rewrite("calibration.toml", "[64.0, 8.0]", "[640.0, 8.0]"),
        "frame_1.png: is 128 x 96 px; clamp_midpoint_px = [640.0, 8.0] is outside this picture; x is",
    ),
    "misspelt key": (
        rewrite("specimen.toml", "length_mm", "lenght_mm"),
        "specimen.toml: specimen.lenght_mm is not a known key; did you mean length_mm?",
    ),
    "calibration": (
        rewrite("calibration.toml", "8.0", "-8.0"),
        "calibration.toml: pixels_per_mm = -8.0 should be greater than 0",
    ),
}


@pytest.mark.parametrize("case", BAD_FRAMES)
def test_bad_frames_are_refused_in_one_line_without_a_file(run: Run, pictures: Path, case: str) -> None:
    spoil, expected = BAD_FRAMES[case]
    spoil(pictures)
    status, message = import_frames(run, pictures)
    assert status == 2
    assert message.count("\n") == 1
    assert expected in message
    assert not list(pictures.glob("*.h5"))
    assert not list(pictures.glob(".out*"))


def test_an_existing_file_is_kept_without_force(run: Run, pictures: Path) -> None:
    (pictures / "out.h5").write_text("precious")
    status, message = import_frames(run, pictures)
    assert (status, "out.h5: exists already" in message) == (2, True)
    assert (pictures / "out.h5").read_text() == "precious"


def test_the_tracked_points_of_the_real_beam_are_imported(run: Run, files: Path, measured: Path) -> None:
    for name in ("points.csv", "states.csv", "specimen.toml"):
        shutil.copy(measured / "real_beam" / name, files)
    assert import_points(run, files) == (0, "")
    with open_dataset(files / "out.h5") as dataset:
        assert (dataset.kind, dataset.calibration) == ("points", None)
        assert (dataset.gravity_angle_deg, dataset.field_angle_deg) == (-90.0, 90.0)
        assert [(state.field_mT, state.tip_force_N) for state in dataset.states] == [(0.0, 0.0), (0.0, 0.51012)]
        tracked = dataset.points()[1]
        assert tracked.names == ("Tip-2", "Tip-3")
        assert tracked.rest_mm.tolist() == [[100.0, 9.0], [100.0, -9.0]]
        assert tracked.points_mm.tolist() == [[101.166, -8.277], [96.367, -25.465]]
        assert tracked.sigma_mm.tolist() == [1.0, 1.0]


@pytest.fixture
def tracked(files: Path) -> Path:
    (files / "states.csv").write_text("state,field_mT\n0,0\n1,2.5\n")
    rows = [
        "state,point,x0_mm,y0_mm,x_mm,y_mm,sigma_mm",
        "1,a,10,1,9,3,0.1",
        "0,a,10,1,10,1,0.1",
        "0,b,5,-1,5,-1,0.1",
        "1,b,5,-1,5,0,0.1",
    ]
    (files / "points.csv").write_text("\n".join(rows) + "\n")
    return files


def test_points_are_assigned_to_their_states(run: Run, tracked: Path) -> None:
    assert import_points(run, tracked) == (0, "")
    with open_dataset(tracked / "out.h5") as dataset:
        assert [(state.field_mT, state.current_A) for state in dataset.states] == [(0.0, None), (2.5, None)]
        assert [points.names for points in dataset.points()] == [("a", "b"), ("a", "b")]
        assert dataset.points()[1].points_mm.tolist() == [[9.0, 3.0], [5.0, 0.0]]


@pytest.mark.parametrize(
    ("spoil", "expected"),
    [
        (rewrite("points.csv", ",x_mm,y_mm", ""), "points.csv: row 1: the columns x_mm, y_mm are missing"),
        (rewrite("points.csv", "1,a", "2,a"), "points.csv: row 2: state = '2' should be one of the states in"),
        (rewrite("points.csv", "1,a", "x,a"), "points.csv: row 2: state = 'x' should be a whole number"),
        (rewrite("points.csv", "1,b", "1,a"), "points.csv: row 5: point a appears twice in state 1"),
        (rewrite("points.csv", "1,a,10,1,9,3,0.1", "1,a,10,1,9,3,0"), "row 2: sigma_mm = '0' should be greater than 0"),
        (rewrite("points.csv", "10,1,9", "11,1,9"), "row 2: x0_mm = '11' should be on the beam, from 0 to length_mm"),
        (rewrite("points.csv", "10,1,9", "10,2,9"), "row 2: y0_mm = '2' should be on the beam, within half"),
        (rewrite("states.csv", "1,2.5", "1,2.5\n2,3"), "points.csv: has no point of state 2"),
        (
            rewrite("states.csv", "1,2.5", "0,2.5"),
            "states.csv: row 3: state = '0' should be a number that no earlier row has",
        ),
        (
            rewrite("states.csv", "field_mT", "current_A"),
            "current_A = '2.5' should be 0; for tracked points give field_mT",
        ),
    ],
)
def test_bad_points_are_refused_in_one_line_without_a_file(
    run: Run, tracked: Path, spoil: Callable[[Path], None], expected: str
) -> None:
    spoil(tracked)
    status, message = import_points(run, tracked)
    assert (status, message.count("\n")) == (2, 1)
    assert expected in message
    assert not list(tracked.glob("*.h5"))


def test_options_of_the_other_kind_of_data_are_refused(run: Run, pictures: Path) -> None:
    common = ("--states", pictures / "states.csv", "--specimen", pictures / "specimen.toml", "-o", pictures / "o.h5")
    status, message = run("import", pictures / "frames", *common)
    assert (status, "images need --calibration" in message) == (2, True)
    shutil.copy(pictures / "states.csv", pictures / "points.csv")
    status, message = run("import", pictures / "points.csv", *common)
    assert (status, "tracked points needs --gravity-angle" in message) == (2, True)
    status, message = run("import", pictures / "nowhere", *common)
    assert (status, "nowhere: no such file or folder" in message) == (2, True)


def test_the_installed_module_imports_pictures(pictures: Path) -> None:
    truncate(pictures)
    arguments = ["import", "frames", "--states", "states.csv", "--specimen", "specimen.toml"]
    arguments += ["--calibration", "calibration.toml", "-o", "out.h5"]
    done = subprocess.run(
        [sys.executable, "-m", "eimi_lab", *arguments],
        cwd=pictures,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert done.returncode == 2
    assert done.stderr == "eimi: frames/frame_10.png: is truncated or damaged; copy it again\n"


def without_coil(files: Path) -> None:
    # Remove the coil constant and the direction of the field from calibration.toml.
    lines = (files / "calibration.toml").read_text().splitlines(keepends=True)
    coil = ("coil_constant_mT_per_A", "field_angle_deg")
    (files / "calibration.toml").write_text("".join(line for line in lines if not line.startswith(coil)))


def test_images_with_weights_need_neither_a_current_nor_a_coil(run: Run, pictures: Path) -> None:
    without_coil(pictures)
    (pictures / "states.csv").write_text("frame,tip_force_N\nframe_1.png,0\nframe_2.png,0.01\n")
    assert import_frames(run, pictures)[0] == 0
    with open_dataset(pictures / "out.h5") as dataset:
        assert [state.tip_force_N for state in dataset.states] == [0.0, 0.01]
        assert [state.field_mT for state in dataset.states] == [0.0, 0.0]


def test_a_current_without_a_coil_constant_is_refused(run: Run, pictures: Path) -> None:
    without_coil(pictures)
    status, message = import_frames(run, pictures)
    assert status == 2
    assert "current_A = '0.1' should be 0, because the calibration has no coil_constant_mT_per_A" in message


def test_a_coil_constant_needs_the_direction_of_the_field(run: Run, pictures: Path) -> None:
    text = (pictures / "calibration.toml").read_text()
    (pictures / "calibration.toml").write_text(text.replace("field_angle_deg", "# field_angle_deg"))
    status, message = import_frames(run, pictures)
    assert (status, "field_angle_deg is missing" in message) == (2, True)

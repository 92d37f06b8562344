"""A new user gets template files and a board to print; an error names a file that is given for the wrong argument."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from eimi_lab.config.calibration import load_calibration
from eimi_lab.config.protocol import load_protocol
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.process.errors import InputError

Run = Callable[..., tuple[int, str]]


def test_files_to_fill_in(run: Run, tmp_path: Path, frame: Callable[..., np.ndarray]) -> None:
    # Template files are refused until their values are filled in; then an import accepts them.
    for name in ("shot_10.png", "shot, 9.png"):
        cv2.imwrite(str(tmp_path / name), frame(9))
    assert run("init", tmp_path) == (0, "")
    assert (tmp_path / "states.csv").read_text() == 'frame,current_A\n"shot, 9.png",\nshot_10.png,\n'
    load_protocol(tmp_path / "protocol.toml")
    with pytest.raises(InputError, match=r"length_mm, .*width_mm, .*depth_mm, .*density_kg_m3 are missing"):
        load_specimen(tmp_path / "specimen.toml")
    with pytest.raises(InputError, match=r"pixels_per_mm, .* are missing"):
        load_calibration(tmp_path / "calibration.toml")
    answers = {
        **{"length_mm": 10.0, "width_mm": 2.0, "depth_mm": 2.0, "density_kg_m3": 1070.0, "section": '"plane-stress"'},
        **{"pixels_per_mm": 8.0, "coil_constant_mT_per_A": 4.7, "gravity_angle_deg": 90.0, "field_angle_deg": 0.0},
    }
    for name in ("specimen.toml", "calibration.toml"):
        text = (tmp_path / name).read_text()
        for key in re.findall(r"^# (\w+) = \?", text, re.MULTILINE):
            text = text.replace(f"# {key} = ?", f"{key} = {answers[key]}")
        (tmp_path / name).write_text(text)
    (tmp_path / "states.csv").write_text('frame,current_A\n"shot, 9.png",0\nshot_10.png,0.1\n')
    arguments = ["--states", tmp_path / "states.csv", "--specimen", tmp_path / "specimen.toml"]
    arguments += ["--calibration", tmp_path / "calibration.toml", "-o", tmp_path / "run.h5"]
    status, message = run("import", tmp_path, *arguments)
    assert (status, "clamp_midpoint_px and axis_angle_deg are missing" in message) == (2, True)
    (tmp_path / "run_where.png").unlink()
    assert run("import", tmp_path, *arguments, "--clamp", "64,8", "--axis", "90") == (0, "")
    with open_dataset(tmp_path / "run.h5") as dataset:
        assert len(dataset.states) == 2
    before = (tmp_path / "specimen.toml").read_text()
    status, message = run("init", tmp_path)
    assert (status, "exists already" in message) == (2, True)
    assert (tmp_path / "specimen.toml").read_text() == before


def test_every_commented_key_of_a_template_file_is_valid(tmp_path: Path, run: Run) -> None:
    assert run("init", tmp_path)[0] == 0
    for name, load in (("specimen.toml", load_specimen), ("calibration.toml", load_calibration)):
        lines = []
        for line in (tmp_path / name).read_text().splitlines():
            optional = re.match(r"# (\[\w+\]|\w+ = [^?]*)(\s+#.*)?$", line)
            if optional and not optional.group(1).startswith(("channel", "length_mm = ?")):
                line = optional.group(1)
            required = re.match(r"# (\w+) = \?", line)
            if required:
                line = f"{required.group(1)} = " + {"section": '"plane-stress"', "field_angle_deg": "0.0"}.get(
                    required.group(1), "40.0"
                )
            lines.append(line)
        (tmp_path / name).write_text("\n".join(lines))
        load(tmp_path / name)  # type: ignore[operator]


def test_a_board_is_printed_without_further_options(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert run("calibrate", "--print-board") == (0, "")
    assert (tmp_path / "board.pdf").read_bytes().startswith(b"%PDF")


def test_a_file_that_is_given_for_the_wrong_argument_is_named(run: Run, pictures: Path) -> None:
    def refusal(specimen: str, calibration: str) -> str:
        arguments = ["--states", pictures / "states.csv", "--specimen", pictures / specimen]
        arguments += ["--calibration", pictures / calibration, "-o", pictures / "out.h5"]
        status, message = run("import", pictures / "frames", *arguments)
        assert (status, message.count("\n")) == (2, 1)
        return message

    wrong = refusal("calibration.toml", "calibration.toml")
    assert "calibration.toml: is a calibration, but a specimen is needed here" in wrong
    wrong = refusal("specimen.toml", "specimen.toml")
    assert "specimen.toml: is a specimen, but a calibration is needed here" in wrong
    wrong = refusal("protocol.toml", "calibration.toml")
    assert "protocol.toml: is a protocol, but a specimen is needed here" in wrong


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("shot.png", b"\x89PNG", "is a picture; `eimi import` makes a dataset from pictures"),
        ("run.mp4", b"mp4", "is a video; `eimi import` makes a dataset from a video"),
        (
            "fits.json",
            b"{}",
            "is a JSON file, not a dataset; `eimi acquire` or `eimi import` makes a dataset; a fits.json belongs "
            "to --fit",
        ),
        ("beam.toml", b"[specimen]", "is a TOML file, not a dataset"),
        ("points.csv", b"state,point", "is a table; `eimi import` makes a dataset from a table"),
    ],
)
def test_the_error_for_a_file_that_is_no_dataset_names_its_kind(
    run: Run, tmp_path: Path, name: str, content: bytes, expected: str
) -> None:
    (tmp_path / name).write_bytes(content)
    status, message = run("fit", tmp_path / name, "--model", "yeoh", "-o", tmp_path / "out.json")
    assert (status, message.count("\n"), expected in message) == (2, 1, True), message

"""The dashboard shows the properties, images and edges of stored datasets, and never changes the datasets."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from importlib.resources import files
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from eimi_lab.config.calibration import load_calibration
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset.importing import import_frames
from eimi_lab.page.stored_runs import edges

PROTOCOLS = Path(str(files("eimi_lab.protocols")))


def test_a_dataset_is_shown_with_its_edges_and_is_not_changed(served: Any) -> None:
    before = hashlib.sha256((served.folder / "run.h5").read_bytes()).digest()
    about = json.loads(served.ask("/api/dataset?file=run.h5").body)
    assert about["specimen"] == "small"
    assert [state["current_A"] for state in about["states"]] == [0.0, 0.2]
    assert about["states"][1]["field_mT"] == pytest.approx(0.94)
    assert (about["states_asked"], about["being_written"], about["segmented"]) == (2, False, False)
    jpeg = served.ask("/api/dataset/picture?file=run.h5&state=1").body
    assert cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_GRAYSCALE).shape == (96, 128)
    edges = json.loads(served.ask("/api/dataset/edges?file=run.h5&state=1").body)
    middles = [np.mean(edges[side], axis=0)[0] for side in ("left", "right")]
    assert sorted(middles) == pytest.approx(
        [64 + 4 - 8, 64 + 4 + 8], abs=0.3
    )  # the drawn beam: 16 px wide, displaced by 4 px
    assert edges["tip_angle_deg"] == pytest.approx(0.0, abs=1.0)
    assert hashlib.sha256((served.folder / "run.h5").read_bytes()).digest() == before


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ("dataset?file=specimen.toml", "is a TOML file"),
        ("dataset?file=none.h5", "no such file"),
        ("dataset/picture?file=run.h5&state=7", "has 2 states"),
        ("dataset/picture?file=run.h5&state=-1", "should be a whole number"),
    ],
)
def test_a_request_for_something_that_does_not_exist_gives_one_line(served: Any, query: str, words: str) -> None:
    answer = served.ask(f"/api/{query}")
    assert answer.status == 400
    assert words in json.loads(answer.body)["error"]


def test_a_report_opens_only_by_its_link_and_runs_no_script(served: Any) -> None:
    (served.folder / "report.html").write_text("<script>alert(1)</script>")
    entries = json.loads(served.ask("/api/folder").body)["entries"]
    link = next(entry["link"] for entry in entries if entry["name"] == "report.html")
    answer = served.ask(
        link, X_Eimi_Token=""
    )  # a browser opens the report in a new tab, where no script adds the header with the token
    assert answer.status == 200
    assert answer.headers["content-security-policy"].startswith("sandbox;")
    for other in ("/report?file=report.html", link.replace("report.html", "run.h5"), link[:-1] + "g"):
        assert served.ask(other).status == 403


def test_fits_that_cannot_be_used_are_reported_in_one_line(served: Any) -> None:
    (served.folder / "odd.fits.json").write_text('{"fits": [' + "9" * 5000 + "]}")
    answer = served.ask("/api/fit?file=odd.h5")
    assert answer.status == 400
    assert "digits" in json.loads(answer.body)["error"]


def test_a_dataset_that_replaces_another_one_is_shown_with_its_own_edges(served: Any, frame: Any) -> None:
    folder = served.folder
    specimen, calibration = load_specimen(folder / "specimen.toml"), load_calibration(folder / "calibration.toml")
    (folder / "swapped").mkdir()
    for index in (1, 2):
        cv2.imwrite(str(folder / "swapped" / f"frame_{index}.png"), frame(index, 9.0))
        os.utime(folder / "swapped" / f"frame_{index}.png", (1e9, 1e9))  # this dataset begins with other bytes
    import_frames(folder / "swapped", folder / "states.csv", specimen, calibration, folder / "second.h5")
    shutil.copy(folder / "run.h5", folder / "same.h5")
    before = json.loads(served.ask("/api/dataset/edges?file=same.h5&state=0").body)
    (folder / "same.h5").write_bytes((folder / "second.h5").read_bytes())  # the number of the file stays the same
    after = json.loads(served.ask("/api/dataset/edges?file=same.h5&state=0").body)
    moved = np.mean(after["left"], axis=0)[0] - np.mean(before["left"], axis=0)[0]
    assert moved == pytest.approx(9.0 - 2.0, abs=0.3)  # the drawn beam


def test_a_repeated_import_is_shown_with_its_own_edges(served: Any, tmp_path: Path) -> None:
    folder, path = served.folder, tmp_path / "repeated.h5"
    specimen, calibration = load_specimen(folder / "specimen.toml"), folder / "calibration.toml"

    def first_edge(states: str, **changes: Any) -> Any:
        # Replace the dataset by a new import of the same pictures, and return the mean position of the left edge of the
        # first state.
        (tmp_path / "states.csv").write_text(f"frame,current_A\n{states}")
        new = tmp_path / "new.h5"
        import_frames(
            folder / "frames", tmp_path / "states.csv", specimen, load_calibration(calibration, changes), new, True
        )
        times = path.stat() if path.exists() else new.stat()
        path.write_bytes(new.read_bytes())
        if changes:
            os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
        return np.mean(edges(path, 0)["left"], axis=0)

    both = "frame_1.png,0\nframe_2.png,0.2\n"
    before = first_edge(both)
    assert first_edge(both, pixels_per_mm=7.0)[0] == pytest.approx(before[0], abs=0.3)
    first_edge(both)
    moved = first_edge("frame_2.png,0.2\n") - before
    assert moved[0] == pytest.approx(2.0, abs=0.3)  # the drawn beam of the second picture


def test_a_template_file_that_is_not_filled_in_is_listed_as_incomplete(served: Any) -> None:
    (served.folder / "my_beam.toml").write_text((PROTOCOLS / "first" / "specimen.toml").read_text())
    choices = json.loads(served.ask("/api/choices").body)
    assert "my_beam.toml" in choices["specimen"]
    assert choices["incomplete"] == ["my_beam.toml"]

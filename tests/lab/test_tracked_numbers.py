"""Points from files of tracking programs, and loads from tables, are those that the files contain."""

from __future__ import annotations

import math
import pickle
import re
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import h5py
import numpy as np
import pytest

from eimi_fitting.beam.rest_shape import RestShape
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.beam.strip import Strip
from eimi_lab.config.calibration import Calibration
from eimi_lab.config.csv_tables import Row, read_table
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset.logged_sensor import LoggedSensor, SensorLog
from eimi_lab.dataset.points import Load
from eimi_lab.dataset.state_loads import check_directions, load_of, numbered_loads
from eimi_lab.dataset.tracked import c3d, points_csv, tracked_states
from eimi_lab.dataset.tracked.axes import Placing, place
from eimi_lab.dataset.tracked.deeplabcut import read_deeplabcut
from eimi_lab.dataset.tracked.dice import read_dice
from eimi_lab.dataset.tracked.dltdv import read_dltdv
from eimi_lab.dataset.tracked.formats import reader_of
from eimi_lab.dataset.tracked.mudic import _Harmless, read_mudic
from eimi_lab.dataset.tracked.ncorr import read_ncorr
from eimi_lab.dataset.tracked.numbers_table import numbers, read_cells
from eimi_lab.dataset.tracked.tracker import read_tracker
from eimi_lab.dataset.tracked.tracks import Tracks
from eimi_lab.dataset.upright import turn
from eimi_lab.process.errors import InputError

NAN = math.nan
Write = Callable[[str], Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def written(text: str) -> Path:
        path = tmp_path / "tracks.txt"
        path.write_text(text, encoding="utf-8")
        return path

    return written


def same(found: Any, expected: Any) -> None:
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


def refused(act: Callable[[], object], words: str) -> None:
    # Assert that a function raises an error with `words`, which begins with the name of a file or of an option.
    with pytest.raises(InputError, match=words) as caught:
        act()
    assert re.match(r"(/[^:]+|t|s|states\.csv|run\.c3d|--[a-z-]+[^:]*): ", str(caught.value))


# Tables of numbers


def test_the_most_frequent_separator_of_five_lines_is_taken(write: Write) -> None:
    assert read_cells(write("\ufeff# a,b,c,d\n\na;1,5;2\n ; \n;3\n")) == [(3, ["a", "1,5", "2"]), (5, ["", "3"])]
    head = "a;b\n" * 5
    assert read_cells(write(head + ",,,,,,,,,,,\n"))[0][1] == ["a", "b"]
    assert read_cells(write("a;b\n" * 4 + ",,,,,,x\n"))[-1][1] == ["", "", "", "", "", "", "x"]
    assert read_cells(write("*** a\nb c\n"), " ", comment="***") == [(2, ["b", "c"])]
    refused(lambda: read_cells(write("\n# nothing\n , \n")), r"tracks\.txt: is empty$")
    refused(lambda: read_cells(write("a,b\nx\x00" + "y" * 200_000)), "is not a text file with a table|is not text|NUL")


def test_empty_cells_are_not_a_number_and_commas_are_points() -> None:
    cells = ["", "nan", "NaN", "NAN", "Inf", "-Inf", "null", "1,5", "-2.5e1"]
    same(numbers(Path("t"), 3, cells), [NAN] * 7 + [1.5, -25.0])
    refused(lambda: numbers(Path("t"), 3, ["1", "1,5,2"]), r"^t: line 3: '1,5,2' should be a number$")


# Each program


def test_deeplabcut_leaves_out_a_position_below_its_cutoff(write: Write) -> None:
    # DeepLabCut's default pcutoff is 0.6: a position with this likelihood counts.
    head = "scorer,s,s,s,s,s,s,s\nindividuals,m1,m1,m1,m1,m1,single,single\n"
    head += "bodyparts,tip,tip,tip,foot,foot,root,root\ncoords,x,y,likelihood,x,likelihood,x,y\n"
    tracks = read_deeplabcut(write(head + "4,1,2,0.6,3,1,5,6\n7,1.5,2.5,0.59,3,1,,6\n9,1,2,,3,1,7,8\n"))
    assert tracks.names == ("m1 tip", "root")
    assert tracks.frames.tolist() == [4, 7, 9]
    same(tracks.places, [[[1, 2], [5, 6]], [[NAN, NAN], [NAN, 6]], [[NAN, NAN], [7, 8]]])
    assert (tracks.unit, tracks.image_axes, tracks.rest, tracks.sigma) == ("px", True, None, None)
    refused(lambda: read_deeplabcut(write(head + "4,1,2,0.6,3,1,5\n")), "line 5 should have .* and 7 further cells")
    refused(lambda: read_deeplabcut(write(head + "x,1,2,0.6,3,1,5,6\n")), "line 5 should have")
    refused(lambda: read_deeplabcut(write(head)), "the first rows should begin with scorer, bodyparts and coords")
    refused(lambda: read_deeplabcut(write(head.replace("coords", "coord"))), "the first rows")


DICE = "SUBSET_ID,COORDINATE_X,COORDINATE_Y,DISPLACEMENT_X,DISPLACEMENT_Y"


def test_dice_adds_displacements_and_leaves_out_failed_subsets(tmp_path: Path) -> None:
    folder = tmp_path / "results"
    folder.mkdir()
    rows = {2: "1,10,20,0.5,-0.25,0.1,\n8,30,40,9,9,-1,\n", 10: "8,30,40,1,2,0,\n"}
    for number, text in rows.items():
        (folder / f"DICe_solution_{number}.txt").write_text(f"*** title\n{DICE},SIGMA,\n{text}")
    tracks = read_dice(folder)
    assert (tracks.names, tracks.frames.tolist()) == (("subset 1", "subset 8"), [2, 10])
    same(tracks.places, [[[10.5, 19.75], [NAN, NAN]], [[NAN, NAN], [31, 42]]])
    same(tracks.rest, [[10, 20], [30, 40]])
    same(tracks.sigma, [[0.1, NAN], [NAN, NAN]])
    assert (tracks.unit, tracks.image_axes) == ("px", True)
    one = tmp_path / "single.txt"
    one.write_text(f"{DICE}\n5,1,2,3,4\n")
    alone = read_dice(one)
    assert (alone.frames.tolist(), alone.sigma) == ([0], None)
    same(alone.places, [[[4, 6]]])
    (folder / "DICe_solution_3.txt").write_text(DICE.replace("SUBSET_ID", "FRAME") + "\n0,1,2,3,4\n")
    refused(lambda: read_dice(folder), "files of one frame")
    one.write_text(f"{DICE}\n5,1,2,3\n")
    refused(lambda: read_dice(one), "line 2 should have 5 numbers")
    one.write_text(f"{DICE}\n5,1,2,3,4\n5,1,2,x,4\n")
    refused(lambda: read_dice(one), r"single\.txt: line 3: 'x' should be a number$")
    one.write_text(f"{DICE}\n")
    refused(lambda: read_dice(one), "its columns should be SUBSET_ID or FRAME")
    one.write_text("SUBSET_ID,COORDINATE_X\n1,2\n")
    refused(lambda: read_dice(one), "its columns should be")
    (tmp_path / "empty").mkdir()
    refused(lambda: read_dice(tmp_path / "empty"), "contains no file of DICe")


def test_dltdv_counts_frames_rows_and_columns_from_1(write: Write) -> None:
    sparse = "DLTdv data file\n{}\n1\t1\t5\n2\t2\t6.5\n2\t4\t7\n\n"
    tracks = read_dltdv(write(sparse.format("2\t4\t3")))
    assert (tracks.names, tracks.frames.tolist(), tracks.unit) == (("pt1", "pt2"), [1, 2], "px")
    same(tracks.places, [[[5, NAN], [NAN, NAN]], [[NAN, 6.5], [NAN, 7]]])
    assert not tracks.image_axes
    for size, words in (
        ("2\t4\t4", "there should be 4 lines with row, column and value"),
        ("1\t4\t3", "line 4 is outside the table of 1 rows and 4 columns"),
        ("2\t2\t3", "line 5 is outside the table of 2 rows and 2 columns"),
        ("2\t5\t3", "has 5 columns; a file of one camera should have two"),
        ("25000001\t4\t3", "there should be 3 lines"),
    ):
        refused(lambda size=size: read_dltdv(write(sparse.format(size))), words)
    for cell in ("0\t1\t5", "1\t0\t5", "1\t1"):
        refused(lambda cell=cell: read_dltdv(write(f"DLTdv\n2\t4\t1\n{cell}\n")), "line 3 is outside|there should be 1")
    assert read_dltdv(write("DLTdv\n1\t2\t1\n1\t2\t3\n")).names == ("pt1",)


def test_dltdv_reads_the_columns_by_their_names(write: Write) -> None:
    tracks = read_dltdv(write("pt2_Z,pt2_X,pt2_Y\n3,1,2\n,4,5\n"))
    assert (tracks.names, tracks.unit) == (("pt2",), None)
    same(tracks.places, [[[1, 2, 3]], [[4, 5, NAN]]])
    for text, words in (
        ("pt1_cam1_X,pt1_cam1_Y\n1\n", "line 2 should have 2 cells"),
        ("pt1_cam1_X,pt1_cam1_Y\n", "its columns should be named"),
        ("pt1_cam1_X,a\n1,2\n", "its columns should be named"),
        ("pt1_cam1_X,pt1_cam2_X\n1,2\n", "has points of 2 cameras"),
        ("pt1_X,pt1_Y\n1,2\n", "the column pt1_Z is missing"),
        ("pt1_cam1_X,pt1_cam1_Z\n1,2\n", "the column pt1_Y is missing"),
    ):
        refused(lambda text=text: read_dltdv(write(text)), words)


def test_tracker_names_its_tracks_and_counts_frames(write: Write) -> None:
    several = "#multi:\t\t\t\t\t\n\tball\t\t\tball\t\nt\tx\ty\tv\tx\ty\n0,1\t1\t2\t9\t3\t4\n0,3\t5\t6\n"
    tracks = read_tracker(write(several))
    assert tracks.names == ("ball 1", "ball 2")
    assert tracks.frames.tolist() == [0, 1]
    same(tracks.times_s, [0.1, 0.3])
    same(tracks.places, [[[1, 2], [3, 4]], [[5, 6], [NAN, NAN]]])
    assert (tracks.unit, tracks.image_axes) == (None, False)
    single = read_tracker(write("mass A\nframe\tx\ty\n3\t1\t2\n5\t3\t4\n"))
    assert (single.names, single.frames.tolist(), single.times_s) == (("mass A",), [3, 5], None)
    unnamed = read_tracker(write("n,x,y,x,y\n0,1,2,3,4\n"))
    assert unnamed.names == ("track 1", "track 2")
    same(unnamed.places, [[[1, 2], [3, 4]]])
    for text, words in (
        ("a\nb\nc\nt,x,y\n0,1,2\n", "a line of columns should begin with t or frame"),
        ("t,x,z\n0,1,2\n", "there should be columns x and y"),
        ("t,y,x\n0,1,2\n", "there should be columns x and y"),
        ("t,x,y\n", "there should be columns x and y"),
    ):
        refused(lambda text=text: read_tracker(write(text)), words)
    for first in ("t", "frame", "n", "step"):
        assert read_tracker(write(f"a,b\nc,d\n{first},x,y\n1,2,3\n")).frames.tolist() == ([0] if first == "t" else [1])


def test_mudic_nodes_are_rows_and_frames_columns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType("muDIC")
    module.DICOutput = type("DICOutput", (), {"__module__": "muDIC"})  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "muDIC", module)
    path = tmp_path / "results.p"

    def save(x: Any, y: Any) -> None:
        saved = module.DICOutput()
        saved.__dict__ |= {"xnodesT": x, "ynodesT": y, "name": "x", "more": [1, 2]}
        path.write_bytes(pickle.dumps(saved))

    save(np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]), np.array([[10, 20, 30], [40, 50, 60]]))
    tracks = read_mudic(path)
    assert (tracks.names, tracks.frames.tolist()) == (("node 0", "node 1"), [0, 1, 2])
    same(tracks.places, [[[1, 10], [4, 40]], [[2, 20], [5, 50]], [[3, 30], [6, 60]]])
    same(tracks.rest, [[1, 10], [4, 40]])
    assert (tracks.unit, tracks.image_axes) == ("px", True)
    for x, y in (
        (np.zeros(3), np.zeros(3)),
        (np.zeros((2, 3)), np.zeros((3, 2))),
        (np.zeros((0, 3)), np.zeros((0, 3))),
    ):
        save(x, y)
        refused(lambda: read_mudic(path), r"xnodesT and ynodesT should be \(nodes, frames\), not")
    save("no array", np.zeros((2, 2)))
    refused(lambda: read_mudic(path), r"it should contain results that muDIC.IO.save wrote \('xnodesT'\)")
    path.write_bytes(b"")
    refused(lambda: read_mudic(path), r"wrote \(Ran out of input\)")


class Maker:
    # An object that makes others when a pickle is read.

    def __call__(self, number: int) -> Any:
        return self


class Made:
    def __reduce__(self) -> Any:
        return Maker(), (1,), {"x": 1}


class Items(list[int]):
    pass


class Keys(dict[int, int]):
    pass


def test_other_objects_in_a_file_of_mudic_do_nothing(tmp_path: Path) -> None:
    saved = Items([1])
    places = {"xnodesT": np.array([[1.0, 2.0]]), "ynodesT": np.array([[3.0, 4.0]])}
    vars(saved).update(places, more=[Made(), Items([1, 2, 3]), Keys({4: 5}), Keys({4: 5, 6: 7})], one=Made())
    path = tmp_path / "results.p"
    path.write_bytes(pickle.dumps(saved))
    tracks = read_mudic(path)
    same(tracks.places, [[[1, 3]], [[2, 4]]])
    with path.open("rb") as file:
        read = _Harmless(file).load()
    assert set(vars(read)) == set(places)
    assert {type(part) for part in (read, read(3))} == {type(read)}
    assert read(3) is read


def ncorr(path: Path, u: list[Any], v: list[Any], spacing: float = 2.0, pixel: float = 0.5) -> Path:
    with h5py.File(path, "w") as file:
        saved = file.create_group("data_dic_save")
        saved["dispinfo/spacing"], saved["dispinfo/pixtounits"] = [[spacing]], [[pixel]]
        store = saved.create_group("displacements")
        for name, fields in (("plot_u_ref_formatted", u), ("plot_v_ref_formatted", v)):
            references = []
            for number, field in enumerate(fields):
                item = file.create_dataset(f"#refs#/{name}{number}", data=np.array(field, dtype=float).T)
                references.append([item.ref])
                if not item.size:
                    item.attrs["MATLAB_empty"] = 1
            store.create_dataset(name, data=np.array(references, dtype=h5py.ref_dtype), dtype=h5py.ref_dtype)
    return path


def test_ncorr_displacements_are_on_a_grid_of_pixels(tmp_path: Path) -> None:
    # A spacing of 2 puts a point on each third pixel; a displacement of 0 in both directions is outside the region.
    path = tmp_path / "dic.mat"
    tracks = read_ncorr(ncorr(path, [[[0, 0], [1, 0]], [[0, 0], [2, 0]]], [[[0, 4], [0, 0]], [[0, 0], [3, 0]]]))
    assert (tracks.names, tracks.frames.tolist()) == (("3,0", "0,3"), [0, 1, 2])
    same(tracks.rest, [[3, 0], [0, 3]])
    same(tracks.places, [[[3, 0], [0, 3]], [[3, 8], [2, 3]], [[NAN, NAN], [4, 9]]])
    assert (tracks.unit, tracks.image_axes) == ("px", True)
    for u, v, pixel, words in (
        ([[[0, 0]]], [[[0, 0]]], 0.5, "contains no displacement other than 0"),
        ([[[1, 0]]], [[[1], [0]]], 0.5, "should be on one grid"),
        ([[[1, 0]]], [[[1, 0]]], 0.0, "and pixtounits above 0"),
        ([[]], [[]], 0.5, "holds no formatted displacements"),
        ([], [], 0.5, "holds no formatted displacements|should hold"),
    ):
        refused(lambda u=u, v=v, pixel=pixel: read_ncorr(ncorr(path, u, v, pixel=pixel)), words)
    path.write_bytes(b"no file of MATLAB")
    refused(lambda: read_ncorr(path), "it should hold data_dic_save with displacements and dispinfo")


def test_an_unknown_program_is_refused() -> None:
    refused(lambda: reader_of("matlab"), "^--format matlab: should be one of dice, ncorr, mudic, dltdv, tracker, deep")
    assert reader_of("dice") is read_dice


# C3D


def motion(monkeypatch: pytest.MonkeyPatch, **changes: Any) -> None:
    # Let ezc3d read 3 markers in 2 frames.
    # The coordinates are 100 * axis + 10 * marker + frame.
    points = np.array([[[100 * a + 10 * m + f for f in (0, 1)] for m in (0, 1, 2)] for a in (1, 2, 3, 4)], dtype=float)
    file: dict[str, Any] = {
        "data": {"points": points, "meta_points": {"residuals": np.array([[[0, 0], [-1, 0], [0, -1]]])}},
        "parameters": {"POINT": {"LABELS": {"value": ["a", "b"]}, "UNITS": {"value": [" M "]}}},
        "header": {"points": {"first_frame": 4, "frame_rate": 50.0}},
    }
    for key, value in changes.items():
        if key in ("points", "meta_points"):
            file["data"][key] = value
        elif key == "UNITS":
            file["parameters"]["POINT"]["UNITS"] = {"value": value}
        else:
            file["header"]["points"][key] = value
    module = ModuleType("ezc3d")

    def c3d_of(path: str) -> Any:
        if path == "huge":
            raise MemoryError
        if path == "damaged":
            raise RuntimeError("no\n  such section " + "x" * 200)
        return file

    module.c3d = c3d_of  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "ezc3d", module)


def test_markers_have_the_frames_of_the_recording(monkeypatch: pytest.MonkeyPatch) -> None:
    # ezc3d counts the first frame from 0, and the recording from 1; a residual below 0 means not seen.
    motion(monkeypatch)
    tracks = c3d.read_in_this_process(Path("run.c3d"))
    assert tracks.names == ("a", "b", "marker 3")
    assert tracks.frames.tolist() == [5, 6]
    same(tracks.times_s, [0.0, 0.02])
    same(tracks.places[0], [[100, 200, 300], [NAN, NAN, NAN], [120, 220, 320]])
    same(tracks.places[1], [[101, 201, 301], [111, 211, 311], [NAN, NAN, NAN]])
    assert tracks.unit == "m"
    motion(monkeypatch, frame_rate=0.0, UNITS=[], meta_points={"residuals": np.full((1, 1, 2), -1.0)})
    tracks = c3d.read_in_this_process(Path("run.c3d"))
    assert (tracks.times_s, tracks.unit) == (None, None)
    assert np.isfinite(tracks.places).all()
    for unit, known in (("MM", "mm"), ("cm", "cm"), ("in", "in"), ("millimeters", "mm"), ("meters", "m"), ("ft", None)):
        motion(monkeypatch, UNITS=[unit])
        assert c3d.read_in_this_process(Path("run.c3d")).unit == known
    for shape in ((4, 0, 2), (4, 3, 0)):
        motion(monkeypatch, points=np.zeros(shape), meta_points={"residuals": np.zeros((1, 0, shape[2]))})
        refused(lambda: c3d.read_in_this_process(Path("run.c3d")), "holds no markers|is not a file")
    motion(monkeypatch)
    with pytest.raises(MemoryError):
        c3d.read_in_this_process(Path("huge"))
    with pytest.raises(InputError) as caught:
        c3d.read_in_this_process(Path("damaged"))
    assert str(caught.value) == "damaged: is not a file of motion capture (C3D): no such section " + "x" * 104


def test_the_reader_of_markers_has_limits(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    # A quarter of the free memory, at most 64 bytes for each byte, 2 GiB for Python; 10 s and 1 s for each MB.
    limits: list[int] = []
    monkeypatch.setattr(c3d, "limit_memory", limits.append)
    monkeypatch.setattr(c3d, "free_memory_bytes", lambda: 4000)
    for size in (15, 16):
        c3d.bound_memory(size)
    assert limits == [(2 << 30) + 960, (2 << 30) + 1000]
    path = tmp_path / "run.c3d"
    path.write_bytes(b"x" * 500_000)
    asked: list[Any] = []
    answer = {"returncode": 0, "stdout": pickle.dumps("tracks"), "stderr": b""}

    def run(*given: Any) -> Any:
        asked.append(given)
        return type("Done", (), answer)

    monkeypatch.setattr(c3d, "run_limited", run)
    monkeypatch.setattr(c3d, "find_spec", lambda name: name)
    assert c3d.read_c3d(path) == "tracks"
    ((file, command, within_s),) = asked
    assert (file, within_s) == (path, 10.5)
    assert command == [sys.executable, "-P", "-m", "eimi_lab.dataset.tracked.c3d", str(path)]
    answer |= {"returncode": 1, "stderr": b"a warning\nrun.c3d: holds no markers\n"}
    refused(lambda: c3d.read_c3d(path), r"^run\.c3d: holds no markers$")
    refused(lambda: c3d.read_c3d(tmp_path / "no.c3d"), "no such file")
    monkeypatch.setattr(c3d, "find_spec", lambda name: None)
    refused(lambda: c3d.read_c3d(path), r"C3D needs another package: pip install 'eimi-lab\[c3d\]'")


def test_the_process_that_reads_markers_prints_them_or_its_problem(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsysbinary: pytest.CaptureFixture[bytes]
) -> None:
    path = tmp_path / "run.c3d"
    path.write_bytes(b"x" * 10)
    limits: list[Any] = []
    monkeypatch.setattr(c3d, "obey_processor_limit", limits.append)
    monkeypatch.setattr(c3d, "bound_memory", limits.append)
    monkeypatch.setattr(c3d, "read_in_this_process", lambda given: f"tracks of {given.name}")
    c3d._main(path, "12.5")
    assert limits == ["12.5", 10]
    assert pickle.loads(capsysbinary.readouterr().out) == "tracks of run.c3d"
    for error, words in (
        (MemoryError(), f"{path}: is damaged or too large: it needs more than a quarter of the free memory, or more "
                        "memory than 64 times the size of the file"),
        (InputError(f"{path}: holds no markers"), f"{path}: holds no markers"),
    ):  # fmt: skip

        def fail(given: Path, error: Exception = error) -> None:
            raise error

        monkeypatch.setattr(c3d, "read_in_this_process", fail)
        with pytest.raises(SystemExit) as caught:
            c3d._main(path, "12.5")
        assert caught.value.code == words
        assert capsysbinary.readouterr().out == b""


# Units and axes


def tracks_of(places: Any, **more: Any) -> Tracks:
    array = np.array(places, dtype=float)
    names = tuple(f"p{k}" for k in range(array.shape[1]))
    return Tracks(names=names, frames=np.arange(10, 10 + len(array)), places=array, **more)


IN_CM: dict[str, Any] = {"unit": "cm", "clamp": (1.0, 2.0), "axis_deg": 90.0, "sigma": 0.1, "rest": 11}


@pytest.mark.parametrize(("unit", "mm"), [("mm", 1.0), ("cm", 10.0), ("m", 1000.0), ("in", 25.4)])
def test_the_unit_and_the_axes_of_a_file_are_converted(unit: str, mm: float) -> None:
    # With an axis of 90 degrees, (1, 5) is 3 along the beam, and (0, 2) is 1 to the left of the axis, toward +y.
    placed = place(tracks_of([[[1, 5], [0, 2]], [[1, 2], [NAN, 2]]]), Placing(**IN_CM | {"unit": unit}), "t")
    same(placed.places_mm, np.array([[[3, 0], [0, 1]], [[0, 0], [NAN, NAN]]]) * mm)
    same(placed.rest_mm, np.array([[0, 0], [NAN, NAN]]) * mm)
    same(placed.sigma_mm, np.full((2, 2), 0.1 * mm))


def test_pixels_have_a_scale_and_the_file_may_have_rest_unit_and_sigma() -> None:
    given = tracks_of([[[3, 0]]], rest=np.array([[1.0, 0.0]]), sigma=np.array([[0.2]]), unit="px")
    placed = place(given, Placing(clamp=(1.0, 0.0), axis_deg=0.0, pixels_per_mm=4.0), "t")
    same(placed.places_mm, [[[0.5, 0]]])
    same(placed.rest_mm, [[0, 0]])
    same(placed.sigma_mm, [[0.05]])


@pytest.mark.parametrize(("plane", "axes"), [("xy", (0, 1)), ("zx", (2, 0)), ("yz", (1, 2)), ("xz", (0, 2))])
def test_a_plane_has_its_axes_in_the_order_of_its_letters(plane: str, axes: tuple[int, int]) -> None:
    spatial = tracks_of([[[3.0, 5.0, 7.0]]])
    options = IN_CM | {"unit": "mm", "clamp": (0.0, 0.0), "axis_deg": 0.0, "plane": plane, "rest": 10}
    place_mm = place(spatial, Placing(**options), "t").places_mm
    same(place_mm, [[[(3.0, 5.0, 7.0)[axis] for axis in axes]]])


PLAIN = [[[1.0, 5.0]], [[1.0, 2.0]]]


@pytest.mark.parametrize(
    ("change", "more", "words"),
    [
        (
            {"rest": None},
            {},
            r"contains no positions at rest; give --rest FRAME, .* \(the file has the frames 10 to 11\)",
        ),
        ({"rest": 12}, {}, "--rest 12: should be a frame of t, which has the frames 10 to 11"),
        ({"rest": 9}, {}, "--rest 9"),
        ({"rest": 10}, {"rest": np.zeros((1, 2))}, "--rest 10: t contains the positions at rest, .*; leave --rest out"),
        ({"plane": "xz"}, {}, "--plane xz: is for points in three dimensions"),
        ({"clamp": None}, {}, "give --clamp X,Y and --axis DEG"),
        ({"axis_deg": None}, {"image_axes": True}, "file, or --calibration of the pictures"),
        ({"unit": None}, {}, "does not contain its unit; give --unit with one of mm, cm, m, in and px"),
        ({"unit": "ft"}, {}, "--unit ft: should be one of mm, cm, m, in and px"),
        ({}, {"unit": "mm"}, "--unit cm: contradicts t, whose unit is mm"),
        ({"pixels_per_mm": 2.0}, {}, "--pixels-per-mm: is for positions in pixels, but the unit of t is cm"),
        ({"unit": "px"}, {}, "t: is in pixels; give --pixels-per-mm, greater than 0$"),
        ({"unit": "px", "pixels_per_mm": 0.0}, {"image_axes": True}, "greater than 0 or --calibration"),
        ({"unit": "px", "pixels_per_mm": math.inf}, {}, "t: is in pixels"),
        ({"sigma": None}, {}, "does not contain the uncertainty of its positions"),
        ({"sigma": 0.0}, {}, "--sigma 0: should be greater than 0"),
        ({"sigma": math.inf}, {}, "--sigma inf: should be greater than 0"),
    ],
)
def test_information_that_is_missing_or_wrong_is_named(
    change: dict[str, Any], more: dict[str, Any], words: str
) -> None:
    refused(lambda: place(tracks_of(PLAIN, **more), Placing(**IN_CM | change), "t"), words)


@pytest.mark.parametrize("plane", ["x", "xx", "xw", "xyz", "yy", None])
def test_a_wrong_plane_is_refused(plane: str | None) -> None:
    words = f"--plane {plane} is not a plane" if plane else "has points in three dimensions"
    refused(lambda: place(tracks_of([[[1, 2, 3]]]), Placing(**IN_CM | {"plane": plane}), "t"), words)


def calibration(**changes: Any) -> Calibration:
    # Return a calibration of 8 px/mm with the clamp at (50, 40) px, for a beam that points down in the picture.
    known: dict[str, Any] = {"pixels_per_mm": 8.0, "clamp_px": (50.0, 40.0), "axis_angle_deg": 90.0}
    return Calibration.model_construct(**{**_DEFAULTS, **known, **changes})


_DEFAULTS = {name: field.get_default(call_default_factory=True) for name, field in Calibration.model_fields.items()}


# Points on the beam, and the frame of a row


def placed_points(rest: Any, places: Any = None, times: Any = None) -> Any:
    given = tracks_of(np.array([rest]) if places is None else places, times_s=times, rest=np.array(rest, dtype=float))
    options = IN_CM | {"unit": "mm", "clamp": (0.0, 0.0), "axis_deg": 0.0, "rest": None}
    return place(given, Placing(**options), "t")


def beam(length_mm: float = 50.0, width_mm: float = 5.0, rest_shape: RestShape | None = None) -> Any:
    sizes = Specimen(length_mm, width_mm, 5.0, 1070.0, "plane-stress", rest_shape=rest_shape)
    return type("File", (), {"specimen": sizes, "mechanics": staticmethod(lambda: sizes)})


def test_points_up_to_2_percent_of_the_width_beside_the_beam_are_on_it(capsys: pytest.CaptureFixture[str]) -> None:
    # The tolerance is 0.02 * 5 mm = 0.1 mm beside the edges at +-2.5 mm, before the clamp, and beyond the tip.
    rest = [[-0.09, 0], [-0.11, 0], [50.09, 0], [50.11, 0], [25, 2.59], [25, 2.61], [25, -2.59], [25, -2.61], [9, 0]]
    chosen = tracked_states.points_on_beam(placed_points(rest), [0], beam(), Path("t"))
    assert chosen.tolist() == [0, 2, 4, 6, 8]
    assert "note: t: 4 of 9 points were left out" in capsys.readouterr().err
    wide = tracked_states.points_on_beam(placed_points(rest), [0], beam(), Path("t"), 0.2)
    assert wide.tolist() == list(range(9))
    assert capsys.readouterr().err == ""


def test_points_on_the_centre_line_of_a_bowed_beam_are_on_it() -> None:
    bowed = beam(rest_shape=RestShape(turns=((0.0, 0.0), (1.0, 0.4))))
    centre = Strip(bowed.specimen).at_rest(np.array([[10.0, 0.0], [30.0, 0.0], [50.0, 0.0]]))
    assert centre[2, 1] > 5.0
    assert tracked_states.points_on_beam(placed_points(centre), [0], bowed, Path("t")).tolist() == [0, 1, 2]
    straight = placed_points([[10.0, 0.0], [50.0, 0.0]])
    assert tracked_states.points_on_beam(straight, [0], bowed, Path("t")).tolist() == [0]


def test_a_point_must_be_seen_in_a_frame_that_is_used() -> None:
    rest = [[1.0, 0], [2.0, 0], [3.0, 0]]
    frames = [[[1, 0], [NAN, 0], [3, NAN]], [[NAN, 0], [NAN, 0], [3, 0]], [[1, 0], [2, 0], [3, 0]]]
    placed = placed_points(rest, frames)
    assert tracked_states.points_on_beam(placed, [0, 1], beam(), Path("t")).tolist() == [0, 2]
    assert tracked_states.points_on_beam(placed, [0], beam(), Path("t")).tolist() == [0]
    refused(
        lambda: tracked_states.points_on_beam(placed_points([[NAN, 0], [70, 1]]), [0], beam(), Path("t")),
        r"none of the points \(2\) is on the beam at rest, which reaches from x = 0 to 50 mm and from y = -2.5 to 2.5 "
        r"mm; the first point is at x = 70, y = 1 mm",
    )
    refused(
        lambda: tracked_states.points_on_beam(placed_points([[NAN, 0]]), [0], beam(), Path("t")),
        "no point was seen at rest",
    )


def test_pictures_have_the_scale_and_the_axes_of_their_calibration() -> None:
    # At 8 px/mm, with the beam down from (50, 40) px, the pixel (58, 64) is 3 mm along the beam and 1 mm beside it.
    pictures = Calibration(
        pixels_per_mm=8.0, clamp_midpoint_px=(50.0, 40.0), axis_angle_deg=90.0, gravity_angle_deg=90.0
    )
    in_pixels = tracks_of([[[58, 64]], [[50, 40]]], image_axes=True)
    placed = place(in_pixels, Placing(calibration=pictures, rest=11, sigma=2.0), "t")
    same(np.abs(placed.places_mm), [[[3, 1]], [[0, 0]]])
    same(placed.rest_mm, [[0, 0]])
    same(placed.sigma_mm, np.full((2, 1), 0.25))
    for tracks, options, words in (
        (tracks_of(PLAIN), {}, "t: the positions in this file are not pixels of a picture; give --unit, --clamp and"),
        (in_pixels, {"unit": "mm"}, "t: the positions in this file are not pixels of a picture"),
        (in_pixels, {"pixels_per_mm": 8.0}, "--pixels-per-mm: the calibration contains the scale already; give either"),
    ):
        given = Placing(calibration=pictures, rest=11, sigma=2.0, **options)  # type: ignore[arg-type]
        refused(lambda tracks=tracks, given=given: place(tracks, given, "t"), words)
    with_unit = Placing(calibration=pictures, rest=11, sigma=2.0, unit="px")
    same(place(in_pixels, with_unit, "t").sigma_mm, np.full((2, 1), 0.25))


@pytest.mark.parametrize(
    ("name", "fits"), [("a" * 64, True), ("a" * 65, False), ("\u00b5" * 32, True), ("\u00b5" * 33, False)]
)
def test_a_point_of_a_table_has_a_name_of_at_most_64_bytes(name: str, fits: bool) -> None:
    cells = {"point": name, "x0_mm": "5", "y0_mm": "0.5", "x_mm": "4", "y_mm": "2", "sigma_mm": "0.1"}
    rows = [Row(Path("states.csv"), 3, cells)]
    specimen = load_specimen("type1")
    if fits:
        found = points_csv._tracked(rows, specimen)
        assert found.names == (name,)
        same([*found.rest_mm[0], *found.points_mm[0], *found.sigma_mm], [5, 0.5, 4, 2, 0.1])
    else:
        words = r"^states\.csv: row 3: point = .* should be a name of at most 64 bytes$"
        refused(lambda: points_csv._tracked(rows, specimen), words)


def test_the_points_of_a_state_are_those_that_its_frame_shows(tmp_path: Path) -> None:
    places = [[[1, 0], [2, 0], [3, 0]], [[1, 4], [NAN, 0], [3, 6]], [[NAN, 0]] * 3]
    placed = placed_points([[1, 0], [2, 0], [3, 0]], places)
    placed.sigma_mm[1, 0] = NAN
    row = Row(Path("states.csv"), 4, {})
    found = tracked_states._points_of(placed, 1, np.array([0, 1, 2]), row, Path("t"))
    assert found.names == ("p2",)
    same(found.rest_mm, [[3, 0]])
    same(found.points_mm, [[3, 6]])
    same(found.sigma_mm, [0.1])
    words = r"^states\.csv: row 4: t has no point of the beam in this frame; list another frame$"
    refused(lambda: tracked_states._points_of(placed, 2, np.array([0, 1, 2]), row, Path("t")), words)
    refused(lambda: tracked_states._points_of(placed, 1, np.array([0, 1]), row, Path("t")), words)


@pytest.mark.parametrize(("count", "used"), [(300, 300), (301, 300), (899, 300)])
def test_at_most_300_points_evenly_spaced_are_used(count: int, used: int, capsys: pytest.CaptureFixture[str]) -> None:
    rest = [[50.0 * k / count, 0.0] for k in range(count)]
    chosen = tracked_states.points_on_beam(placed_points(rest), [0], beam(), Path("t"))
    assert len(chosen) == used
    assert (chosen[0], chosen[-1]) == (0, count - 1)
    assert set(np.diff(chosen)) <= {math.floor((count - 1) / 299), math.ceil((count - 1) / 299)}
    assert ("only 300 of" in capsys.readouterr().err) == (count > 300)


def row(**cells: str) -> Row:
    return Row(Path("states.csv"), 4, cells)


def test_a_row_gives_the_number_or_the_nearest_time_of_a_frame() -> None:
    # Frames 10, 11 and 12 have the times 0, 0.5 and 1 s; a time may be one step away from them.
    placed = placed_points([[1.0, 0]], [[[1, 0]]] * 3, np.array([0.0, 0.5, 1.0]))
    frame_of = tracked_states._frame_of
    assert [frame_of(row(frame=cell), placed, Path("t")) for cell in ("10", "12")] == [0, 2]
    assert [frame_of(row(time_s=cell), placed, Path("t")) for cell in ("0.2", "0.3", "1.5", "-0.5")] == [0, 1, 2, 0]
    for cells, words in (
        ({"frame": "13"}, "should be a frame of t, which has the frames 10 to 12"),
        ({"time_s": "1.51"}, "should be a time of t, from 0 to 1 s"),
        ({"time_s": "-0.51"}, "should be a time of t"),
        ({}, "needs one of the columns frame and time_s"),
        ({"frame": "10", "time_s": "0"}, "needs one of the columns frame and time_s"),
    ):
        refused(lambda cells=cells: frame_of(row(**cells), placed, Path("t")), words)
    refused(lambda: frame_of(row(time_s="0"), placed_points([[1.0, 0]]), Path("t")), "t has no times; give the column")
    alone = placed_points([[1.0, 0]], [[[1, 0]]], np.array([3.0]))
    assert frame_of(row(time_s="900"), alone, Path("t")) == 0


# Loads


OF_2_MT = Load(None, 2.0, 0.0)


def with_coil(constant: float) -> Any:
    return type("Calibration", (), {"mT_per_A": constant})


@pytest.mark.parametrize(
    ("cells", "constant", "load"),
    [
        ({"current_A": "0.5"}, 4.0, Load(0.5, 2.0, 0.0, None, None, None)),
        ({"field_mT": "2"}, 4.0, Load(0.5, 2.0, 0.0, None, None, None)),
        ({"field_mT": "2"}, 0.0, Load(None, 2.0, 0.0, None, None, None)),
        ({"field_mT": "2", "tip_force_N": "0.1", "tip_force_angle_deg": "30"}, None, Load(None, 2.0, 0.1, 30.0)),
        ({"field_mT": "2", "field_sigma_mT": "0"}, None, Load(None, 2.0, 0.0, None, 0.0, None)),
        ({"field_mT": "2", "temperature_degC": "-273.15"}, None, Load(None, 2.0, 0.0, None, None, -273.15)),
        ({"field_mT": "2", "field_sigma_mT": "", "temperature_degC": "", "tip_force_angle_deg": ""}, None, OF_2_MT),
        ({"current_A": "0"}, None, Load(0.0, 0.0, 0.0)),
        ({"current_A": "0"}, 0.0, Load(0.0, 0.0, 0.0)),
        ({"tip_force_N": "0.2"}, 0.0, Load(0.0, 0.0, 0.2)),
    ],
)  # fmt: skip
def test_the_load_of_a_row(cells: dict[str, str], constant: float | None, load: Load) -> None:
    assert load_of(row(**cells), None if constant is None else with_coil(constant)) == load


@pytest.mark.parametrize(
    ("cells", "constant", "words"),
    [
        ({"current_A": "1", "field_mT": "2"}, 4.0, "has both current_A and field_mT; give one"),
        ({"current_A": "1", "field_mT": "2", "tip_force_N": "1"}, 0.0, "has both"),
        ({}, 0.0, "has neither current_A nor field_mT"),
        ({"tip_force_N": "0.2"}, 4.0, "has neither"),
        ({"tip_force_N": "0.2"}, None, "has neither"),
        ({"current_A": "1", "field_sigma_mT": "0.1"}, 4.0, "field_sigma_mT = '0.1' should be 0 or above, in a table"),
        ({"field_mT": "1", "field_sigma_mT": "-0.1"}, 4.0, "should be 0 or above"),
        ({"field_mT": "1", "temperature_degC": "-273.16"}, 4.0, "not below -273.15"),
        ({"current_A": "1"}, 0.0, "should be 0, because the calibration has no coil_constant_mT_per_A"),
        ({"current_A": "1"}, None, "should be 0; for tracked points give field_mT instead"),
    ],
)
def test_a_wrong_load_is_named(cells: dict[str, str], constant: float | None, words: str) -> None:
    refused(lambda: load_of(row(**cells), None if constant is None else with_coil(constant)), words)


def test_states_are_numbered_once_and_sorted() -> None:
    loads = numbered_loads([row(state="3", field_mT="1"), row(state="1", field_mT="2")])
    assert list(loads.items()) == [(1, OF_2_MT), (3, Load(None, 1.0, 0.0))]
    refused(
        lambda: numbered_loads([row(state="3", field_mT="1"), row(state="3", field_mT="2")]),
        "state = '3' should be a number that no earlier row has",
    )


def test_a_weight_needs_a_direction() -> None:
    free, angled, none = Load(None, 0.0, 0.1), Load(None, 0.0, 0.1, 0.0), Load(None, 1.0, 0.0)
    check_directions(Path("s"), [free, angled, none], 0.0)
    check_directions(Path("s"), [angled, none], None)
    refused(lambda: check_directions(Path("s"), [none, free], None), r"^s: tip_force_N = 0\.1 has no direction")


# Tables of the user


def test_cells_of_a_table(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"

    def read(text: str) -> list[Row]:
        path.write_text(text, encoding="utf-8")
        return read_table(path, ["a", "b"], ["more"])

    first, second = read("\ufeff\nb;a\n1,5; x \n\n-2.5;y\n")
    assert (first.line, second.line) == (3, 5)
    assert (first.number("b"), second.number("b"), first.text("a")) == (1.5, -2.5, "x")
    assert read("a\tb\n7\t1\n")[0].count("a") == 7
    (comma,) = read("a,b,more\n1.5,0,\n")
    assert (comma.number("a"), comma.count("b"), comma.decimal_comma) == (1.5, 0, False)
    refused(lambda: comma.text("more"), r"row 2: more = '' should be filled in")
    for text, act, words in (
        ("a;b\n1,5,2;1.2,3\n", lambda r: r.number("a"), "a = '1,5,2' should be a number, with a point"),
        ("a;b\n1;1.2,3\n", lambda r: r.number("b"), "should be a number"),
        ('a,b\n"1,5",2\n', lambda r: r.number("a"), "a = '1,5' should be a number, with a point"),
        ("a,b\ninf,nan\n", lambda r: r.number("a"), "should be a finite number"),
        ("a,b\n1,nan\n", lambda r: r.number("b"), "should be a finite number"),
        ("a,b\n-1,\u00b2\n", lambda r: r.count("a"), "should be a whole number, 0 or more"),
        ("a,b\n-1,\u00b2\n", lambda r: r.count("b"), "should be a whole number"),
    ):
        refused(lambda text=text, act=act: act(read(text)[0]), words)
    for text, words in (
        ("", "is empty; its header should be a,b$"),
        ("a,b\n", "has a header but no rows"),
        (
            "a,b\n1,2,3\n",
            "row 2: has 3 cells, but the header has 2 columns; numbers with a decimal comma need semicolons",
        ),
        ("a,b\n1\n", "row 2: has 1 cells, but the header has 2 columns$"),
        ("a;b\n1;2;3\n", "row 2: has 3 cells, but the header has 2 columns$"),
        ("a,b,a\n1,2,3\n", "row 1: the column a appears twice"),
        ("a,b,moore\n1,2,3\n", "row 1: 'moore' is not a known column; did you mean more\\?"),
        ("a,b,xyz\n1,2,3\n", "'xyz' is not a known column; the known columns are a, b, more"),
        ("a\n1\n", "row 1: the column b is missing; the table has the columns a"),
        ("more\n1\n", "row 1: the columns a, b are missing"),
    ):
        refused(lambda text=text: read(text), words)


# Sensors, and the direction up


def test_the_mean_reading_of_each_state_leaves_missing_readings_out() -> None:
    sensor = LoggedSensor("probe", "model", "field", "mT")
    states, values = np.array([0, 0, 2, 2, 3, 7]), np.array([1.0, 2.0, 5.0, NAN, NAN, 100.0])
    log = SensorLog(sensor, states, np.zeros(6), values, np.full(6, NAN))
    same(log.by_state(4), [1.5, NAN, 5.0, NAN])
    same(log.by_state(8), [1.5, NAN, 5.0, NAN, NAN, NAN, NAN, 100.0])
    assert sensor.at_magnet == 1.0


def test_gravity_points_down_after_the_turn() -> None:
    same(turn(None, None), np.eye(2))
    for angle in (0.0, 30.0, -120.0):
        gravity = [math.cos(math.radians(angle)), math.sin(math.radians(angle))]
        same(turn(None, angle) @ gravity, [0.0, -1.0])
        assert np.linalg.det(turn(None, angle)) == pytest.approx(1.0)

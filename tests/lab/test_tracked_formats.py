"""Points from other tracking programs are imported from files in their formats."""

from __future__ import annotations

import os
import pickle
import sys
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from eimi_lab.config.calibration import load_calibration
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.fits.evidence import load_evidence
from eimi_lab.vision.beam_frame import BeamFrame

Run = Callable[..., tuple[int, str]]
Write = Callable[[Path, np.ndarray], Path]

REST_MM = np.array([[3.0, 0.5], [6.0, -0.5], [9.5, 0.0]])
BENT_MM = REST_MM + np.array([[0.0, 0.1], [-0.1, 0.6], [-0.4, 2.0]])
BY_CALIBRATION = ("--calibration", "calibration.toml")
STATES = "frame,field_mT\n{0},0\n{1},2.5\n"


def in_pixels(files: Path) -> np.ndarray:
    # Return the pixels (x, y) of three points of a beam, first at rest and then bent, shape (2, 3, 2).
    frame = BeamFrame(load_calibration(files / "calibration.toml"))
    return np.stack([frame.to_px(REST_MM), frame.to_px(BENT_MM)])


def imported(run: Run, files: Path, source: Path, tool: str, *options: object, states: str) -> tuple[int, str]:
    (files / "states.csv").write_text(states)
    arguments = ["--states", files / "states.csv", "--specimen", files / "specimen.toml", "-o", files / "out.h5"]
    paths = [files / word if word == "calibration.toml" else word for word in options]
    return run("import", source, "--format", tool, *arguments, "--force", *paths)


def check(files: Path, sigma_mm: float, tolerance: float = 1e-4) -> None:
    # Assert that the imported points have the right places and the deviation `sigma_mm`, and can be fitted.
    with open_dataset(files / "out.h5") as dataset:
        assert [state.field_mT for state in dataset.states] == [0.0, 2.5]
        rest, bent = dataset.points()
        gravity = dataset.gravity_angle_deg
    assert gravity == pytest.approx(0.0)
    for tracked, truth in ((rest, REST_MM), (bent, BENT_MM)):
        np.testing.assert_allclose(tracked.rest_mm, REST_MM, atol=tolerance)
        np.testing.assert_allclose(tracked.points_mm, truth, atol=tolerance)
        np.testing.assert_allclose(tracked.sigma_mm, sigma_mm, rtol=1e-6)
    assert len(load_evidence(files / "out.h5").states) == 2


def write_dice(folder: Path, places: np.ndarray) -> Path:
    # Write files as DICe v1.0-28 does (tests/examples/full_field), with one failed subset; return the folder.
    folder.mkdir()
    header = "***\n*** Digital Image Correlation Engine (DICe), (git sha1: v1.0-28-g0aaeef) Copyright 2021\n***\n"
    header += "*** Reference image: ./images/ref.tiff \n***\n"
    header += "SUBSET_ID,COORDINATE_X,COORDINATE_Y,DISPLACEMENT_X,DISPLACEMENT_Y,SIGMA,GAMMA,BETA,STATUS_FLAG\n"
    for number, there in enumerate(places):
        rows = [
            f"{k},{x:.6E},{y:.6E},{u:.6E},{v:.6E},4.0000E-02,2.1E-03,0.0000E+00,4.0000E+00"
            for k, ((x, y), (u, v)) in enumerate(zip(places[0], there - places[0], strict=True))
        ]
        rows.append("3,6.4E+01,2.0E+01,9.0E+01,0.0E+00,-1.0E+00,-1.0E+00,-1.0E+00,1.0E+01")
        (folder / f"DICe_solution_{number}.txt").write_text(header + "\n".join(rows) + "\n")
    return folder


def test_dice_files_of_frames_are_imported(run: Run, files: Path) -> None:
    source = write_dice(files / "results", in_pixels(files))
    status, message = imported(run, files, source, "dice", *BY_CALIBRATION, states=STATES.format(0, 1))
    assert (status, "1 of 4 points were left out" in message) == (0, True)
    check(files, 0.04 / 8.0, 1e-3)


def test_dice_files_of_subsets_are_imported(run: Run, files: Path) -> None:
    # As in DICe's tests/examples/mechanism; a high-speed camera has counted the frames, from 4837.
    places = in_pixels(files)
    (files / "results").mkdir()
    for k in range(3):
        rows = ["FRAME,COORDINATE_X,COORDINATE_Y,DISPLACEMENT_X,DISPLACEMENT_Y,ROTATION_Z,SIGMA"]
        for number, there in enumerate(places):
            cells = (4837 + number, *places[0, k], *(there[k] - places[0, k]), 0.0, 0.08)
            rows.append(f"{cells[0]}," + ",".join(f"{cell:.6E}" for cell in cells[1:]))
        (files / "results" / f"DICe_solution_{k}.txt").write_text("\n".join(rows) + "\n")
    source = files / "results"
    assert imported(run, files, source, "dice", *BY_CALIBRATION, states=STATES.format(4837, 4838)) == (0, "")
    check(files, 0.08 / 8.0, 1e-3)


def ncorr_grid(
    places: np.ndarray, spacing: int, pixel: float
) -> tuple[np.ndarray, list[tuple[np.ndarray, np.ndarray]]]:
    # Return tracked points as Ncorr stores them: grid points, and displacements along x and y.
    # places: points in px, (pictures, n, 2). spacing: pixels between grid points. pixel: size of a pixel in the unit of
    # the displacements.
    on_grid = np.rint(places[0] / (spacing + 1)).astype(int)
    fields = []
    for there in places[1:]:
        u, v = np.zeros((2, 96 // (spacing + 1), 128 // (spacing + 1)))
        for (column, row), (du, dv) in zip(on_grid, there - places[0], strict=True):
            u[row, column], v[row, column] = du * pixel, dv * pixel
        fields.append((u, v))
    return on_grid * (spacing + 1.0), fields


@pytest.mark.parametrize("pictures", [1, 2])
@pytest.mark.parametrize("version", ["7.3", "7"])
def test_ncorr_files_are_imported(run: Run, files: Path, version: str, pictures: int) -> None:
    # The files have the versions 7 and 7.3 of MATLAB's format, with one picture or several.
    places = in_pixels(files)
    rest, fields = ncorr_grid(np.stack([places[0], *[places[1]] * pictures]), 1, 0.125)
    path = files / "dic.mat"
    if version == "7":
        displacement = [{"plot_u_ref_formatted": u, "plot_v_ref_formatted": v} for u, v in fields]
        info = {"spacing": 1.0, "pixtounits": 0.125, "units": "mm", "type": "regular"}
        savemat(path, {"data_dic_save": {"displacements": np.array(displacement), "dispinfo": info}})
    else:
        with h5py.File(path, "w", userblock_size=512) as file:
            saved = file.create_group("data_dic_save")
            for name, value in (("spacing", 1.0), ("pixtounits", 0.125)):
                saved[f"dispinfo/{name}"] = [[value]]
            store = saved.create_group("displacements")
            for k, name in enumerate(("plot_u_ref_formatted", "plot_v_ref_formatted")):
                arrays = [pair[k].T for pair in fields]  # MATLAB stores an array column by column
                if pictures == 1:
                    store[name] = arrays[0]
                    continue
                references = []
                for number, array in enumerate(arrays):
                    file[f"#refs#/{name}_{number}"] = array
                    references.append([file[f"#refs#/{name}_{number}"].ref])
                store.create_dataset(name, data=np.array(references, dtype=h5py.ref_dtype), dtype=h5py.ref_dtype)
        with path.open("r+b") as raw:
            raw.write(b"MATLAB 7.3 MAT-file, Platform: PCWIN64".ljust(116) + b" " * 8 + b"\x00\x02IM")
    options = ("--sigma", "0.05", *BY_CALIBRATION)
    assert imported(run, files, path, "ncorr", *options, states=STATES.format(0, pictures)) == (0, "")
    with open_dataset(files / "out.h5") as dataset:
        before, after = dataset.points()
    moved = BeamFrame(load_calibration(files / "calibration.toml")).to_mm(rest)
    order = [int(np.abs(moved - place).sum(axis=1).argmin()) for place in before.rest_mm]
    np.testing.assert_allclose(before.points_mm, moved[order], atol=1e-9)
    np.testing.assert_allclose(after.points_mm - before.points_mm, (BENT_MM - REST_MM)[order], atol=1e-9)
    np.testing.assert_allclose(after.sigma_mm, 0.05 / 8.0)


class _Pickler(pickle.Pickler):
    # A pickler that writes arrays as the package dill does, with which µDIC saves its files.

    def reducer_override(self, value: Any) -> Any:
        if isinstance(value, np.ndarray):
            make, arguments, state = value.__reduce__()
            return sys.modules["dill._dill"]._create_array, (make, arguments, state, None)
        return NotImplemented


def as_mudic_saves(monkeypatch: pytest.MonkeyPatch, path: Path, **attributes: Any) -> Path:
    # Write a pickle of a muDIC.solver.correlate.DICOutput without µDIC, and return its path.
    with monkeypatch.context() as context:
        for name in ("muDIC", "muDIC.solver", "muDIC.solver.correlate", "dill", "dill._dill"):
            context.setitem(sys.modules, name, types.ModuleType(name))
        of_mudic = sys.modules["muDIC.solver.correlate"]
        for name in ("DICOutput", "DICInput"):
            setattr(of_mudic, name, type(name, (), {"__module__": "muDIC.solver.correlate"}))

        def _create_array(*arguments: Any) -> None:
            raise AssertionError

        _create_array.__module__ = "dill._dill"
        _create_array.__qualname__ = "_create_array"
        sys.modules["dill._dill"]._create_array = _create_array  # type: ignore[attr-defined]
        saved = of_mudic.DICOutput()
        saved.__dict__ |= {"crosscorrelation": None, "settings": of_mudic.DICInput(), **attributes}
        with path.open("wb") as file:
            _Pickler(file).dump(saved)
    return path


def test_mudic_files_are_imported(run: Run, files: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    places = in_pixels(files)
    nodes = {"xnodesT": places[..., 0].T.copy(), "ynodesT": places[..., 1].T.copy()}
    source = as_mudic_saves(monkeypatch, files / "results.p", **nodes)
    options = ("--sigma", "0.02", *BY_CALIBRATION)
    assert imported(run, files, source, "mudic", *options, states=STATES.format(0, 1)) == (0, "")
    check(files, 0.02 / 8.0)


class _Harmful:
    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, ("harm",)


def test_a_hostile_pickle_runs_no_program(run: Run, files: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(files)
    source = as_mudic_saves(monkeypatch, files / "results.p", xnodesT=_Harmful(), ynodesT=np.zeros((2, 2)))
    status, message = imported(run, files, source, "mudic", *BY_CALIBRATION, states=STATES.format(0, 1))
    assert (status, message.count("\n"), "results.p: is not a file of µDIC" in message) == (2, 1, True)
    assert not (files / "harm").exists()


def upward(places: np.ndarray) -> np.ndarray:
    # Convert pixels to coordinates from 1 at the lower left corner of a picture 96 px high, as in DLTdv5 to DLTdv7.
    return np.stack([places[..., 0] + 1.0, 96.0 - places[..., 1]], axis=-1)


IN_OWN_AXES = ("--pixels-per-mm", "8", "--clamp", "65,88", "--axis", "-90", "--gravity-angle", "0", "--rest", "2")


@pytest.mark.parametrize("ending", ["csv", "tsv"])
def test_dltdv_files_are_imported(run: Run, files: Path, ending: str) -> None:
    # The files are xypts.csv of DLTdv7 and the sparse file of DLTdv8; their first frame is empty.
    table = upward(in_pixels(files)).reshape(2, 6)
    if ending == "csv":
        header = ",".join(f"pt{k + 1}_cam1_{axis}" for k in range(3) for axis in "XY")
        rows = [",".join(["NaN"] * 6), *(",".join(f"{cell:.6f}" for cell in row) for row in table)]
        (files / "xypts.csv").write_text("\n".join([header, *rows]) + "\n")
    else:
        cells = [f"{row + 2}\t{k + 1}\t{table[row, k]:.6f}" for k in range(6) for row in range(2)]
        (files / "xypts.tsv").write_text("\n".join(["DLTdv data file", f"3\t6\t{len(cells)}", *cells]) + "\n")
    options = ("--sigma", "0.4", "--unit", "px", *IN_OWN_AXES)
    assert imported(run, files, files / f"xypts.{ending}", "dltdv", *options, states=STATES.format(2, 3)) == (0, "")
    check_orientation(files)
    check(files, 0.05, 2e-6)


def check_orientation(files: Path) -> None:
    # Assert that the tip of the imported points is on the +y side, and not mirrored.
    with open_dataset(files / "out.h5") as dataset:
        assert dataset.points()[1].points_mm[2, 1] > 1.9


def test_dltdv_files_in_three_dimensions_are_imported(run: Run, files: Path) -> None:
    # The points are in metres. The beam hangs along -z and bends along x.
    frames = [
        np.column_stack([0.2 + mm[:, 1] / 1e3, np.full(3, 0.7), 0.5 - mm[:, 0] / 1e3]) for mm in (REST_MM, BENT_MM)
    ]
    header = ",".join(f"pt{k + 1}_{axis}" for k in range(3) for axis in "XYZ")
    rows = [",".join(f"{cell:.6f}" for cell in frame.ravel()) for frame in frames]
    source = files / "xyzpts.csv"
    source.write_text("\n".join([header, *rows]) + "\n")
    options = ["--unit", "m", "--plane", "xz", "--clamp", "0.2,0.5", "--axis", "-90", "--rest", "1", "--sigma", "1e-4"]
    assert imported(run, files, source, "dltdv", *options, "--gravity-angle", "0", states=STATES.format(1, 2)) == (
        0,
        "",
    )
    check(files, 0.1, 1e-3)
    assert load_evidence(files / "out.h5").experiment.loads.gravity.any()
    assert imported(run, files, source, "dltdv", *options, "--no-gravity", states=STATES.format(1, 2)) == (0, "")
    assert not load_evidence(files / "out.h5").experiment.loads.gravity.any()


@pytest.mark.parametrize("kind", ["several", "decimal comma", "one of version 4"])
def test_tracker_files_are_imported(run: Run, files: Path, kind: str) -> None:
    # The files are those of version 6 with several tracks, of a German locale, and of version 4.
    cm = [np.column_stack([5.0 + mm[:, 1] / 10, 2.0 - mm[:, 0] / 10]) for mm in (REST_MM, BENT_MM)]  # y points up
    tracks = [0] if kind == "one of version 4" else [0, 1, 2]
    rows = []
    for t, frame in zip((0.0, 0.04), cm, strict=True):
        rows.append("\t".join([f"{t:.3E}", *(f"{frame[k][i]:.6E}" for k in tracks for i in (0, 1))]))
    if kind == "one of version 4":
        text = "mass_A\nt\tx\ty\n" + "\n".join(rows) + "\n"
    else:
        text = (
            "#multi:\n\tmass A\t\tmass B\t\tmass C\t\t\nt\t"
            + "x\ty\t" * 3
            + "\n"
            + "\n".join(rows)
            + "\n0.08\t\t\t\t\t\t\n"
        )
    if kind == "decimal comma":
        text = text.replace(".", ",").replace("\t", ";")
    (files / "data.txt").write_text(text)
    options = ["--clamp", "5,2", "--axis", "-90", "--gravity-angle", "0", "--rest", "0", "--sigma", "0.005"]
    times = "time_s,field_mT\n0,0\n0.04,2.5\n"
    status, message = imported(run, files, files / "data.txt", "tracker", *options, states=times)
    assert (status, "data.txt: does not contain its unit; give --unit with one of mm, cm" in message) == (2, True)
    assert imported(run, files, files / "data.txt", "tracker", *options, "--unit", "cm", states=times) == (0, "")
    if len(tracks) > 1:
        check(files, 0.05)
    else:
        with open_dataset(files / "out.h5") as dataset:
            assert dataset.points()[1].names == ("mass_A",)
            np.testing.assert_allclose(dataset.points()[1].points_mm, BENT_MM[:1], atol=1e-4)


@pytest.mark.parametrize("animals", [False, True])
def test_deeplabcut_files_are_imported(run: Run, files: Path, animals: bool) -> None:
    # The files have one animal or several; points with a small likelihood are left out.
    places = in_pixels(files)
    parts = ["root", "middle", "tip", "lost"]
    scorer = "DLC_resnet50_beamNov21shuffle1_50000"
    lines = [["scorer", *[scorer] * 12]]
    if animals:
        lines.append(["individuals", *["beam"] * 12])
    lines += [["bodyparts", *(part for part in parts for _ in range(3))], ["coords", *["x", "y", "likelihood"] * 4]]
    for number, frame in enumerate(places):
        sure = [cell for x, y in frame for cell in (f"{x:.6f}", f"{y:.6f}", "0.9998")]
        lines.append([str(number), *sure, "70.0", "40.0", "0.012"])
    (files / "video.csv").write_text("\n".join(map(",".join, lines)) + "\n")
    options = ("--sigma", "0.5", "--rest", "0", *BY_CALIBRATION)
    status, message = imported(run, files, files / "video.csv", "deeplabcut", *options, states=STATES.format(0, 1))
    assert (status, "1 of 4 points were left out" in message) == (0, True)
    check(files, 0.5 / 8.0)
    with open_dataset(files / "out.h5") as dataset:
        assert dataset.points()[0].names[2] == ("beam tip" if animals else "tip")


def test_c3d_files_are_imported(run: Run, files: Path) -> None:
    # The package ezc3d writes a C3D file (motion capture) in mm.
    ezc3d = pytest.importorskip("ezc3d")
    points = np.ones((4, 4, 2))
    for k, mm in enumerate((REST_MM, BENT_MM)):
        points[:3, :3, k] = np.stack([200.0 + mm[:, 1], np.full(3, 70.0), 500.0 - mm[:, 0]])
    points[:3, 3] = np.nan
    file = ezc3d.c3d()
    parameters = file["parameters"]["POINT"]
    parameters["UNITS"]["value"] = ["mm"]
    parameters["RATE"]["value"] = [100.0]
    parameters["LABELS"]["value"] = ("root", "middle", "tip", "lost")
    file["data"]["points"] = points
    file.write(str(files / "capture.c3d"))
    options = ["--clamp", "200,500", "--axis", "-90", "--gravity-angle", "0", "--rest", "1", "--sigma", "0.2"]
    status, message = imported(run, files, files / "capture.c3d", "c3d", *options, states=STATES.format(1, 2))
    assert (status, "points in three dimensions; give the plane in which the beam bends" in message) == (2, True)
    options += ["--plane", "xz"]
    assert imported(run, files, files / "capture.c3d", "c3d", *options, states=STATES.format(1, 2))[0] == 0
    check(files, 0.2, 1e-3)
    status, message = imported(
        run, files, files / "capture.c3d", "c3d", *options, "--unit", "m", states=STATES.format(1, 2)
    )
    assert (status, "--unit m: " in message, "whose unit is mm" in message) == (2, True, True)


MISTAKES: dict[str, tuple[tuple[object, ...], str]] = {
    "no sigma": (
        ("--rest", "0", *BY_CALIBRATION),
        "does not contain the uncertainty of its positions; give their standard deviation with --sigma",
    ),
    "no rest": (("--sigma", "1", *BY_CALIBRATION), "contains no positions at rest; give --rest FRAME"),
    "rest elsewhere": (("--sigma", "1", "--rest", "9", *BY_CALIBRATION), "--rest 9: "),
    "no scale": (
        ("--sigma", "1", "--rest", "0"),
        "is in pixels; give --pixels-per-mm, greater than 0 or --calibration",
    ),
    "no clamp": (("--sigma", "1", "--rest", "0", "--pixels-per-mm", "8"), "give --clamp X,Y and --axis DEG"),
    "no gravity": (
        ("--sigma", "1", "--rest", "0", "--pixels-per-mm", "8", "--clamp", "64,8", "--axis", "90"),
        "give --gravity-angle, the direction of gravity in the beam frame",
    ),
    "wrong clamp": (
        (
            "--sigma",
            "1",
            "--rest",
            "0",
            "--pixels-per-mm",
            "8",
            "--clamp",
            "0,0",
            "--axis",
            "90",
            "--gravity-angle",
            "0",
        ),
        "(1) is on the beam at rest, which reaches from x = 0 to 10 mm and from y = -1 to 1 mm; the first point",
    ),
    "other unit": (
        ("--unit", "mm", "--sigma=1", "--rest=0", *BY_CALIBRATION),
        "the positions in this file are not pixels of a picture",
    ),
    "twice": (("--sigma", "1", "--clamp", "1,2", *BY_CALIBRATION), "--clamp and --axis: the calibration gives these"),
    "of pictures": (("--channel", "red", *BY_CALIBRATION), "are only for images; leave them out for tracked points"),
    "unknown tool": (("--format", "gom", *BY_CALIBRATION), "--format gom: should be one of dice, ncorr, mudic"),
}


@pytest.mark.parametrize("case", MISTAKES)
def test_a_missing_option_is_requested_in_one_line(run: Run, files: Path, case: str) -> None:
    options, message = MISTAKES[case]
    rows = "scorer,a,a,a\nbodyparts,tip,tip,tip\ncoords,x,y,likelihood\n0,64,50,1\n1,66,50,1\n"
    (files / "video.csv").write_text(rows)
    status, answer = imported(run, files, files / "video.csv", "deeplabcut", *options, states=STATES.format(0, 1))
    assert (status, answer.count("\n"), message in answer) == (2, 1, True), answer
    assert not (files / "out.h5").exists()


@pytest.mark.parametrize("tool", ["dice", "ncorr", "mudic", "dltdv", "tracker", "deeplabcut", "c3d"])
@pytest.mark.parametrize("content", [b"", b"\x80\x04\xff", b"a,b,c\n1,2\n", b"t,x,y\n0,a,1\n", b"MATLAB 5.0 MAT-file"])
def test_a_file_of_another_format_is_refused_in_one_line(run: Run, files: Path, tool: str, content: bytes) -> None:
    if tool == "c3d":
        pytest.importorskip("ezc3d")
    (files / "what.dat").write_bytes(content)
    options = ("--sigma", "1", "--rest", "0", *BY_CALIBRATION)
    status, answer = imported(run, files, files / "what.dat", tool, *options, states=STATES.format(0, 1))
    assert (status, answer.count("\n"), "what.dat: " in answer) == (2, 1, True), answer


def test_options_of_tracks_are_refused_without_a_format(run: Run, pictures: Path) -> None:
    arguments = ["--states", pictures / "states.csv", "--specimen", pictures / "specimen.toml", "-o", pictures / "o.h5"]
    status, message = run("import", pictures / "frames", *arguments, "--unit", "mm")
    assert (status, "--unit: is only for points of a tracking program" in message) == (2, True)

# The commands `calibrate` and `import` choose the right function, pass its arguments on, and refuse contradictions.

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_lab.commands import calibrating, images
from eimi_lab.commands.picture_options import ask_where
from eimi_lab.commands.result import Result
from eimi_lab.commands.track_options import ImportOptions
from eimi_lab.process.errors import InputError

CLAMP = (320.0, 40.0)


class Calibration:
    # A replacement for a calibration, whose values are those in `values`.

    def __init__(self, **values: Any) -> None:
        self.values = values
        self.pixels_per_mm, self.axis_angle_deg, self.clamp_midpoint_px = 8.12345, 89.98765, (319.987, 40.123)
        self.gravity_angle_deg = 90.5
        self.uncertainty = values.get("uncertainty")

    def model_dump(self, mode: str) -> Any:
        return {"mode": mode, **self.values}


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    # The calls of the functions that measure a calibration: name and arguments.
    made: list[Any] = []

    def replace(name: str, answer: Any) -> None:
        def act(*arguments: Any) -> Any:
            made.append((name, arguments))
            return answer

        monkeypatch.setattr(f"eimi_lab.vision.calibration.calibration_file.{name}", act)

    for name in ("from_board", "from_beam", "from_ruler"):
        replace(name, (Calibration(of=name), [f"{name} remark"]))
    replace("with_measured_clamp", Calibration(of="clamp"))
    replace(
        "with_measured_gravity", (Calibration(uncertainty={"pixels_per_mm": 0.0123, "axis_angle_deg": 0.456}), ["down"])
    )
    monkeypatch.setattr(
        "eimi_lab.vision.calibration.calibration_file.check_hangs",
        lambda *angles, is_measured: made.append(("check_hangs", (*angles, is_measured))),
    )
    monkeypatch.setattr(
        "eimi_lab.vision.calibration.writing.write_calibration", lambda *given: made.append(("write", given))
    )
    monkeypatch.setattr("eimi_lab.config.specimen.load_specimen", lambda name: f"beam {name}")
    return made


def test_a_calibration_is_measured_from_a_board(calls: list[Any]) -> None:
    result = calibrating.calibrate([Path("a"), Path("b")], board="charuco", clamp_midpoint_px=CLAMP, coil_constant=4.7)
    name, (pictures, mid_plane, board, setup, share) = calls[0]
    assert (name, pictures, mid_plane, share) == ("from_board", [Path("a"), Path("b")], Path("a"), 0.001)
    assert (board.kind, board.columns, board.rows, board.square_mm) == ("charuco", 20, 16, 2.0)
    values = list(vars(setup).values())
    assert values == [4.7, CLAMP, 90.0, 90.0, 0.0, False]
    assert calls[1][0] == "write"
    assert calls[1][1][1:] == (Path("calibration.toml"), False)
    assert result.lines == ["from_board remark", Path("calibration.toml")]
    assert result.content == {
        **{"calibration": Path("calibration.toml"), "told": ["from_board remark"]},
        "values": {"mode": "json", "of": "from_board"},
    }
    calibrating.calibrate(
        [Path("a")],
        Path("o.toml"),
        "checkerboard",
        9,
        7,
        3.0,
        0.5,
        mid_plane=Path("m"),
        clamp_midpoint_px=CLAMP,
        axis_angle=80.0,
        gravity_angle=70.0,
        field_angle=60.0,
        telecentric=True,
        force=True,
    )
    _, (_, mid_plane, board, setup, share) = calls[2]
    assert (mid_plane, board.columns, board.rows, board.square_mm, share) == (Path("m"), 9, 7, 3.0, 0.005)
    assert list(vars(setup).values()) == [None, CLAMP, 80.0, 70.0, 60.0, True]
    assert calls[3][1][1:] == (Path("o.toml"), True)


def test_a_calibration_is_measured_from_a_beam_or_a_ruler(calls: list[Any]) -> None:
    calibrating.calibrate([Path("a")], specimen="s", clamp_midpoint_px=CLAMP, axis_angle=30.0)
    assert calls[0] == ("check_hangs", (Path("a"), 30.0, 30.0, False))
    name, (picture, beam, setup, tolerance) = calls[1]
    assert (name, picture, beam, tolerance) == ("from_beam", Path("a"), "beam s", 0.05)
    assert list(vars(setup).values()) == [None, CLAMP, 30.0, 30.0, -60.0, False]
    ruler = (1.0, 2.0, 3.0, 4.0)
    result = calibrating.calibrate(
        [Path("a")],
        ruler_px=ruler,
        ruler_mm=20.0,
        clamp_midpoint_px=CLAMP,
        specimen="s",
        beam=Path("rest"),
        plumb_line=Path("thread"),
        width_tolerance_mm=0.1,
    )
    named = dict(calls[3:])
    assert "check_hangs" not in named
    assert named["from_ruler"][:2] == (Path("a"), ruler)
    assert named["from_ruler"][2] == 20.0
    assert named["with_measured_clamp"][1:] == (Path("rest"), "beam s")
    assert named["with_measured_gravity"][1:] == (Path("thread"), 90.0)
    assert result.lines == [
        *("from_ruler remark", "middle of the clamp: x = 319.99, y = 40.12 px", "down", "8.1235 ± 0.012 px/mm"),
        *("direction of the straight beam: 89.988 ± 0.46 degrees", Path("calibration.toml")),
    ]
    calls.clear()
    calibrating.calibrate(
        [Path("a")],
        specimen="s",
        clamp_midpoint_px=CLAMP,
        plumb_line=Path("thread"),
        gravity_angle=-90.0,
        width_tolerance_mm=0.1,
    )
    named = dict(calls)
    assert (named["from_beam"][3], named["with_measured_gravity"][1:]) == (0.1, (Path("thread"), -90.0))
    assert named["check_hangs"] == (Path("a"), 89.98765, 90.5, True)
    assert [name for name, _ in calls].count("check_hangs") == 1


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"beam": Path("b"), "board": "charuco"}, "--beam: also needs --specimen"),
        ({"beam": Path("b"), "specimen": "s"}, "--beam: also needs --specimen and, for the scale"),
        ({}, "give exactly one of --board, --specimen and --ruler-px"),
        ({"board": "charuco", "specimen": "s"}, "give exactly one of"),
        ({"board": "charuco", "ruler_px": (1.0, 2.0, 3.0, 4.0)}, "give exactly one of"),
        ({"images": [], "board": "charuco"}, "IMAGES: give the images of the board"),
        ({"images": [Path("a"), Path("b")], "specimen": "s"}, "IMAGES: give the images of the board"),
        ({"specimen": "s", "clamp_midpoint_px": None}, "--clamp-midpoint-px is missing"),
        ({"specimen": "s", "coil_constant": 0.0}, "--coil-constant 0: should be greater than 0"),
        ({"board": "charuco", "columns": 1}, "--board, --columns, --rows, --square-mm: "),
        ({"specimen": "s", "output": Path("a")}, "a"),
    ],
)
def test_a_calibration_that_cannot_be_measured_is_refused(calls: list[Any], given: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        calibrating.calibrate(**({"images": [Path("a")], "clamp_midpoint_px": CLAMP} | given))  # type: ignore[arg-type]
    assert calls == []


def test_a_board_is_printed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    printed: list[Any] = []

    def draw(board: Any, path: Path) -> None:
        printed.append(board)
        path.write_bytes(b"pdf")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("eimi_lab.vision.calibration.board.print_board", draw)
    result = calibrating.calibrate(print_board=True)
    assert result == Result([Path("board.pdf")], {"board": Path("board.pdf")})
    assert (tmp_path / "board.pdf").read_bytes() == b"pdf"
    assert (printed[0].kind, printed[0].columns, printed[0].rows, printed[0].square_mm) == ("charuco", 20, 16, 2.0)
    with pytest.raises(InputError, match="exists"):
        calibrating.calibrate(print_board=True)
    calibrating.calibrate(output=Path("o.pdf"), print_board=True, board="circles", columns=5, rows=4, square_mm=3.0)
    assert (printed[1].kind, printed[1].columns, printed[1].rows, printed[1].square_mm) == ("circles", 5, 4, 3.0)


Called = Callable[..., list[Any]]


@pytest.fixture
def sources(tmp_path: Path) -> dict[str, Path]:
    # A folder of images, a video, a table of points and an image, and states.csv; all are empty.
    paths = {name: tmp_path / name for name in ("v.mp4", "p.csv", "i.png", "states.csv", "run.h5", "s.toml")}
    for path in paths.values():
        path.write_bytes(b"")
    paths["folder"] = tmp_path / "folder"
    paths["folder"].mkdir()
    return paths | {"output": tmp_path / "o.h5"}


def imported(sources: dict[str, Path], source: str, states: bool = True, **given: Any) -> Result:
    names = {field for field in ImportOptions.__dataclass_fields__}
    options = {key: given.pop(key) for key in list(given) if key in names}
    filled = {key: getattr(ImportOptions(**options), key) for key in names}
    arguments = {"specimen": "beam.toml", "output": sources["output"], **given, **filled}
    return images.import_(
        source=sources.get(source, Path(source)), states=sources["states.csv"] if states else None, **arguments
    )


def test_pictures_are_imported(called: Called, sources: dict[str, Path]) -> None:
    calls = called("eimi_lab.config.specimen.load_specimen", "beam")
    called("eimi_lab.config.calibration.missing_places", ())
    called("eimi_lab.config.calibration.load_calibration", "calibration")
    called("eimi_lab.dataset.dark_and_flat.read_correction_images", "correction")
    called("eimi_lab.dataset.importing.import_frames", 1)
    output = sources["output"]
    for source in ("folder", "v.mp4", "i.png"):
        result = imported(sources, source, calibration=Path("c"))
        assert result == Result([f"{output}: 1 state"], {"dataset": output, "states": 1})
        arguments = calls[-1][1]
        assert arguments[:7] == (sources[source], sources["states.csv"], "beam", "calibration", output, False, False)
        assert arguments[8:] == ("correction", None)
    called("eimi_lab.dataset.importing.import_frames", 3)
    result = imported(
        sources,
        "v.mp4",
        calibration=Path("c"),
        average="mean",
        every=5,
        dark=Path("d"),
        flat=Path("f"),
        axis=4.0,
        force=True,
    )
    assert result.lines == [f"{output}: 3 states"]
    tail = {name: arguments for name, arguments, _ in calls}
    assert tail["import_frames"][5:7] == (True, "mean")
    assert tail["import_frames"][9] == 5
    assert tail["missing_places"] == tail["load_calibration"] == ("c", {"axis_angle_deg": 4.0})
    assert tail["read_correction_images"] == (Path("d"), Path("f"))
    called("eimi_lab.config.calibration.missing_places", ("axis_angle_deg",))
    called("eimi_lab.commands.images.ask_where", InputError("asked"))
    with pytest.raises(InputError, match=r"^asked$"):
        imported(sources, "v.mp4", calibration=Path("c"), every=2)
    assert calls[-1][1] == (("axis_angle_deg",), sources["v.mp4"], sources["states.csv"], "c", output, 2)


@pytest.mark.parametrize(
    ("source", "given", "words"),
    [
        ("none", {}, "no such file or folder"),
        ("states.csv", {}, "is also given with --states"),
        ("run.h5", {}, "is a dataset already"),
        ("s.toml", {}, "is a TOML file"),
        ("folder", {"states": False}, "--states is missing; give states.csv or, for a motion"),
        ("folder", {}, "images need --calibration"),
        ("folder", {"calibration": Path("c"), "gravity_angle": 0.0}, "images need --calibration"),
        ("folder", {"calibration": Path("c"), "no_gravity": True}, "images need --calibration"),
        ("folder", {"calibration": Path("c"), "every": 2}, "--every 2: is for a video only"),
        ("v.mp4", {"format": "dice", "every": 2}, "--every 2: is for a video only"),
        ("p.csv", {"format": "dice", "dark": Path("d")}, "--dark, --flat and --average: are only for images"),
        ("p.csv", {"format": "dice", "flat": Path("d")}, "--dark, --flat and --average: are only for images"),
        ("p.csv", {"format": "dice", "average": True}, "--dark, --flat and --average: are only for images"),
        ("p.csv", {}, "a table of tracked points needs --gravity-angle or --no-gravity"),
        ("p.csv", {"no_gravity": True, "calibration": Path("c")}, "a table of tracked points needs"),
        ("p.csv", {"no_gravity": True, "dark": Path("c")}, "a table of tracked points needs"),
        ("p.csv", {"no_gravity": True, "flat": Path("c")}, "a table of tracked points needs"),
        ("p.csv", {"no_gravity": True, "axis": 1.0}, "a table of tracked points needs"),
        ("p.csv", {"no_gravity": True, "unit": "mm"}, "--unit: is only for points of a tracking program"),
        ("p.csv", {"creep": True, "unit": "mm"}, "--unit: is only for points of a tracking program"),
    ],
)
def test_an_import_that_cannot_be_is_refused(
    called: Called, sources: dict[str, Path], source: str, given: dict[str, Any], words: str
) -> None:
    called("eimi_lab.config.specimen.load_specimen", "beam")
    with pytest.raises(InputError, match=words):
        imported(sources, source, **given)


def test_tracked_points_are_imported(called: Called, sources: dict[str, Path]) -> None:
    calls = called("eimi_lab.config.specimen.load_specimen", "beam")
    called("eimi_lab.config.calibration.load_calibration", "calibration")
    called("eimi_lab.dataset.tracked.points_csv.import_points", 2)
    called("eimi_lab.dataset.tracked.tracked_states.import_tracks", 4)
    table, states, output = sources["p.csv"], sources["states.csv"], sources["output"]
    assert imported(sources, "p.csv", gravity_angle=0.0).lines == [f"{output}: 2 states"]
    assert calls[-1][1] == (table, states, "beam", 0.0, output, False, True)
    imported(sources, "p.csv", no_gravity=True, force=True)
    assert calls[-1][1] == (table, states, "beam", None, output, True, False)
    assert imported(sources, "p.csv", format="dice", gravity_angle=5.0, unit="cm").lines == [f"{output}: 4 states"]
    source, tool, table_of_states, beam, placing, angle, *rest = calls[-1][1]
    assert (source, tool, table_of_states, beam, angle, rest) == (
        table,
        "dice",
        states,
        "beam",
        5.0,
        [output, False, True],
    )
    assert (placing.calibration, placing.unit) == (None, "cm")
    imported(sources, "p.csv", format="dice", calibration=Path("c"), no_gravity=True, force=True)
    assert calls[-1][1][4].calibration == "calibration"
    assert calls[-1][1][5:] == (None, output, True, False)
    with pytest.raises(InputError, match="--gravity-angle: the calibration also gives the direction of gravity"):
        imported(sources, "p.csv", format="dice", calibration=Path("c"), gravity_angle=0.0)


def test_motions_are_imported_alone_or_with_states(called: Called, sources: dict[str, Path]) -> None:
    motions = tuple(SimpleNamespace(time_s=range(size), lost_frames=size - 3) for size in (3, 5))
    read = SimpleNamespace(motions=motions, calibration="found", in_words="8 frames")
    calls = called("eimi_lab.config.specimen.load_specimen", "beam")
    called("eimi_lab.face.moving.read_motions", read)
    called("eimi_lab.dataset.moving.motion_import.write_motion_dataset")
    called("eimi_lab.dataset.moving.motion_import.add_motions")
    called("eimi_lab.dataset.moving.recording_checks.flagged_lines", ["flagged"])
    called("eimi_lab.config.calibration.missing_places", ())
    called("eimi_lab.config.calibration.load_calibration", "calibration")
    called("eimi_lab.dataset.dark_and_flat.read_correction_images")
    called("eimi_lab.dataset.importing.import_frames", 2)
    output = sources["output"]
    result = imported(sources, "v.mp4", states=False, ring_down=True, axis=3.0)
    content = {"dataset": output, "states": 0, "motions": 2, "frames": 8, "lost": 2}
    assert result == Result([f"{output}: 8 frames", "flagged"], content)
    name, (source, beam, facts), how = calls[1]
    assert (name, source, beam, facts.kind) == ("read_motions", sources["v.mp4"], "beam", "ring_down")
    assert {key: how[key] for key in ("calibration", "changes", "tool", "has_gravity_direction", "output")} == {
        **{"calibration": None, "changes": {"axis_angle_deg": 3.0}, "tool": None, "has_gravity_direction": False},
        "output": output,
    }
    assert how["placing"](None).calibration is None
    assert calls[2][1] == (output, motions, "beam", "found", None, True, False)
    assert calls[3][1] == (motions,)
    calls.clear()
    imported(sources, "p.csv", states=False, creep=True, no_gravity=True, format="dice", unit="cm", force=True)
    assert (calls[1][2]["has_gravity_direction"], calls[1][2]["tool"]) == (True, "dice")
    assert calls[2][1][4:] == (None, False, True)
    imported(sources, "p.csv", states=False, creep=True, gravity_angle=0.0)
    assert calls[-2][1][4:] == (0.0, True, False)
    assert calls[-3][2]["has_gravity_direction"] is True
    result = imported(sources, "v.mp4", creep=True, calibration=Path("c"))
    assert result == Result([f"{output}: 2 states, 8 frames", "flagged"], content | {"states": 2})
    assert [call for call in calls if call[0] == "add_motions"] == [("add_motions", (output, motions, "beam"), {})]
    with pytest.raises(InputError, match="--states: a table of the points of a motion contains no states"):
        imported(sources, "p.csv", creep=True, no_gravity=True)
    output.write_text("x")
    with pytest.raises(InputError, match="exists"):
        imported(sources, "v.mp4", states=False, creep=True)


@pytest.mark.parametrize(
    ("missing", "words"),
    [
        (("clamp_midpoint_px",), r"c\.toml: clamp_midpoint_px is missing; .*, and give --clamp X,Y$"),
        (("axis_angle_deg",), r"c\.toml: axis_angle_deg is missing; .*, and give --axis DEG$"),
        (
            ("clamp_midpoint_px", "axis_angle_deg"),
            r"clamp_midpoint_px and axis_angle_deg are missing; .* and give --clamp X,Y and --axis DEG$",
        ),
    ],
)
def test_a_missing_place_is_asked_for_with_a_picture(
    called: Called, tmp_path: Path, missing: tuple[str, ...], words: str
) -> None:
    frame = SimpleNamespace(path=Path("folder/first.png"))
    listing = SimpleNamespace(images=lambda: iter([np.zeros((30, 40), np.uint8)]), frames=[frame])
    calls = called("eimi_lab.dataset.listing.list_frames", listing)
    called("eimi_lab.vision.ruled_picture.ruled_picture", lambda image: image)
    output = tmp_path / "o.h5"
    error = ask_where(missing, Path("s"), Path("t"), "c.toml", output, 3)
    with pytest.raises(InputError, match=words):
        raise error
    assert f"{tmp_path / 'o_where.png'} shows first.png with rulers in px" in str(error)
    assert (tmp_path / "o_where.png").stat().st_size > 0
    assert calls[0][1] == (Path("s"), Path("t"), 3)
    ask_where(missing, Path("s"), Path("t"), "c.toml", output)
    assert calls[2][1] == (Path("s"), Path("t"), None)

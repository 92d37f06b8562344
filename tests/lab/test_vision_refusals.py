"""Pictures, frames and beams that cannot be used are refused with a reason, just beyond their limits."""

from __future__ import annotations

import errno
import math
from dataclasses import replace
from datetime import date
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from eimi_drivers.clock import SimulatedClock
from eimi_drivers.interfaces import Frame
from eimi_fitting import Loads, Magnet, Specimen
from eimi_lab.config.rig import load_rig
from eimi_lab.config.specimen import SpecimenFile, load_specimen
from eimi_lab.config.toml import check, parse
from eimi_lab.process.errors import InputError
from eimi_lab.virtual import beam as beam_module
from eimi_lab.virtual import rod, simulation, virtual_rig
from eimi_lab.virtual.beam import VirtualBeam, VirtualLoads, forget_solids
from eimi_lab.virtual.rod import Rod, Stiffness
from eimi_lab.virtual.simulation import parse_parameters, simulate
from eimi_lab.virtual.virtual_rig import VirtualCamera
from eimi_lab.vision import heic, image_files
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.calibration.board import Board
from eimi_lab.vision.calibration.calibration_file import BenchSetup, from_board, with_measured_gravity
from eimi_lab.vision.calibration.clicked_bench import ClickedBench, measure_bench
from eimi_lab.vision.calibration.exif_lens import FocalLength
from eimi_lab.vision.calibration.known_width import _clamp_midpoint
from eimi_lab.vision.calibration.lens import Lens
from eimi_lab.vision.calibration.plumb_line import measure_plumb_line
from eimi_lab.vision.check import Check, Severity
from eimi_lab.vision.edges import suggested_corrections
from eimi_lab.vision.edges.edge_set import EdgePoints, EdgeSet
from eimi_lab.vision.edges.silhouette import measure_back_light
from eimi_lab.vision.field_at_beam import in_stated_field
from eimi_lab.vision.flags import CHECK_OF, judge
from eimi_lab.vision.following.follow import FollowedBeam
from eimi_lab.vision.frame_checks import state_flags
from eimi_lab.vision.image_sizes import claimed_size
from eimi_lab.vision.intensity import FieldCorrection
from eimi_lab.vision.projection import Projection
from eimi_lab.vision.ruled_picture import _round_step
from eimi_lab.vision.tracking.beam_curve import curve_through
from eimi_lab.vision.tracking.beam_tracker import BeamTracker
from tests.shared.small_pictures import CALIBRATION, SmallPicture, specimen

Array = np.ndarray
NOTHING = EdgePoints(np.zeros((0, 2)), np.zeros(0))


def test_a_correction_needs_a_bright_flat_field_of_the_same_shape() -> None:
    flat = np.full((20, 20), 100.0)
    with pytest.raises(ValueError, match="needs a dark frame or a flat field"):
        FieldCorrection(None, None)
    with pytest.raises(ValueError, match=r"the flat field has the shape \(20, 20\); it should have .* \(20, 19\)"):
        FieldCorrection(np.zeros((20, 19)), flat)
    flat[0, :4] = 4.0  # a hundredth of the pixels is darker than a twentieth of the median
    assert FieldCorrection(None, flat).apply(np.full((20, 20), 10.0))[0, 0] == pytest.approx(10.0 * 100.0 / 5.0)
    flat[0, 4] = 4.0
    with pytest.raises(ValueError, match="is dark in places"):
        FieldCorrection(None, flat)
    with pytest.raises(ValueError, match="is dark in places"):
        FieldCorrection(np.full((20, 20), 100.0), np.full((20, 20), 100.0))
    only_dark = FieldCorrection(np.full((20, 20), 10.0), None).apply(np.full((20, 20), 50.0))
    assert (only_dark == 40.0).all()
    both = FieldCorrection(np.full((4, 4), 10.0), np.array([[60.0] * 2 + [110.0] * 2] * 4)).apply(np.full((4, 4), 60.0))
    assert both[0] == pytest.approx([50.0 * 75.0 / 50.0] * 2 + [50.0 * 75.0 / 100.0] * 2)
    with pytest.raises(ValueError, match=r"the image has the shape \(4, 5\)"):
        FieldCorrection(None, np.full((4, 4), 100.0)).apply(np.zeros((4, 5)))
    assert Projection("red", (0.0, 0.0, 1.0)).apply([[1, 2], [3, 4]]).tolist() == [[1.0, 2.0], [3.0, 4.0]]


@pytest.mark.parametrize("below", [False, True])
def test_a_value_at_a_limit_is_within_it(below: bool) -> None:
    # A value at the limit raises no flag, and a value at the second limit does not make the state unusable.
    sign = -1.0 if below else 1.0
    row = Check(
        name="A", finding="a", quantity="", limit=2.0 * sign, remedy="", below=below, severity=Severity.DOUBTFUL,
        unusable_beyond=8.0 * sign, widens=lambda value: 0.5 * value,
    )  # fmt: skip
    flags = [row.flag(sign * value) for value in (8.0, 8.001)]
    assert [flag.severity for flag in flags] == [Severity.DOUBTFUL, Severity.UNUSABLE]
    assert [flag.widens for flag in flags] == [4.0 * sign, 0.0]
    assert judge({"blur_px": 2.5, "contrast": CHECK_OF["contrast"].limit}) == ()
    assert [flag.name for flag in judge({"blur_px": 2.5001})] == ["DEFOCUS"]


@pytest.mark.parametrize(
    ("least", "step"),
    [(0.2, 1), (1.0, 1), (1.1, 2), (2.1, 5), (5.0, 5), (5.1, 10), (10.1, 20), (53.0, 100), (200.0, 200)],
)
def test_the_lines_of_a_ruled_picture_are_at_round_numbers(least: float, step: int) -> None:
    assert _round_step(least) == step


def frames_of(*images: Array, step: int = 1) -> list[Frame]:
    return [Frame(image, 5 + step * number, 0.1 * number) for number, image in enumerate(images)]


def test_frames_without_even_areas_are_compared_by_their_numbers_alone() -> None:
    # If fewer than 500 pixels are clear of the edges, no motion is measured.
    rng = np.random.default_rng(1)
    small = [np.where(np.arange(48) < 24, 40, 200) + rng.integers(-2, 3, (30, 48)) for _ in range(3)]
    assert state_flags(frames_of(*(image.astype(np.uint8) for image in small)), True) == ()
    wide = [np.where(np.arange(200) + 3 * k < 60, 40, 200) + rng.integers(-2, 3, (60, 200)) for k in range(3)]
    [moving] = state_flags(frames_of(*(image.astype(np.uint8) for image in wide)), True)
    assert moving.name == "NOT_SETTLED"
    assert state_flags(frames_of(*(image.astype(np.uint8) for image in wide)), False) == ()
    still = [np.where(np.arange(200) < 60, 40, 200) + rng.integers(-2, 3, (60, 200)) for _ in range(3)]
    assert state_flags(frames_of(*(image.astype(np.uint8) for image in still)), True) == ()
    same = still[0].astype(np.uint8)
    assert state_flags(frames_of(same, same), True) == ()
    assert state_flags(frames_of(same), True) == ()


def test_a_damaged_or_large_heic_picture_is_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    avif = b"\0\0\0\x18ftypavif"
    with pytest.raises(InputError, match="is an AVIF picture, which cannot be read"):
        heic.read_heic(avif, tmp_path / "a.avif")
    pillow_heif = pytest.importorskip("pillow_heif")
    for size, is_refused in (((10_000, 10_000), False), ((10_000, 10_001), True)):
        picture = SimpleNamespace(size=size, __array_interface__=np.zeros((2, 2, 4), np.uint8).__array_interface__)
        monkeypatch.setattr(pillow_heif, "open_heif", lambda *arguments, picture=picture, **options: picture)
        if is_refused:
            with pytest.raises(InputError, match="has a size of 10000 x 10001 px"):
                heic.read_heic(b"\0\0\0\x18ftypheic", tmp_path / "a.heic")
        else:
            assert heic.read_heic(b"\0\0\0\x18ftypheic", tmp_path / "a.heic").shape == (2, 2, 3)


def test_only_files_of_a_permitted_size_are_read(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is not a folder of images"):
        image_files.find_images(tmp_path / "nowhere")
    with pytest.raises(InputError, match="is a folder, a device or a pipe, not a file"):
        image_files.read_image(tmp_path)
    (tmp_path / "empty.png").write_bytes(b"")
    with pytest.raises(InputError, match="is empty"):
        image_files.read_image(tmp_path / "empty.png")
    with pytest.raises(InputError, match="cannot be read"):
        image_files.read_image(tmp_path / "missing.png")
    assert cv2.imwrite(str(tmp_path / "small.png"), np.zeros((7, 9), np.uint8))
    asked: list[float] = []
    monkeypatch.setattr(image_files, "refuse_unpacked", lambda size, words: asked.append(size))
    assert image_files.read_image(tmp_path / "small.png").shape == (7, 9)
    assert asked == [7 * 9 * 8]
    for most, is_refused in ((63, False), (62, True)):
        monkeypatch.setattr(image_files, "MOST_PIXELS", most)
        if is_refused:
            with pytest.raises(InputError, match="has a size of 9 x 7 px; at most 62 pixels are read"):
                image_files.read_image(tmp_path / "small.png")
        else:
            image_files.read_image(tmp_path / "small.png")
    header = b"\xff\xd8\xff\xc0\x00\x11\x08\x01\xe0\x02\x80"
    assert claimed_size(header + b"\x03") == (640, 480)
    assert claimed_size(header) is None


def test_a_beam_that_cannot_be_tracked_is_refused() -> None:
    frame = BeamFrame(CALIBRATION)
    image = SmallPicture().beam().exposed()[..., 0]
    with pytest.raises(ValueError, match="no edges of the beam were found in the first frame"):
        BeamTracker(image, EdgeSet(NOTHING, NOTHING, (), np.zeros((4, 2))), frame, 12.0)
    x = np.linspace(1.0, 11.0, 20)
    sides = [EdgePoints(np.column_stack([x, np.full(20, y)]), np.full(20, 0.01)) for y in (-1.0, 1.0)]
    edges = EdgeSet(*sides, (), np.zeros((4, 2)))
    with pytest.raises(ValueError, match="the beam does not contrast with its surroundings"):
        BeamTracker(np.full_like(image, 90), edges, frame, 12.0)
    deep = SmallPicture(0.1).beam().exposed().astype(np.uint16) * 16
    tracker = BeamTracker(deep, edges, frame, 12.0)
    assert tracker.follow(deep).is_seen
    assert not tracker.follow(np.full_like(deep, 900)).is_seen
    assert tracker.follow(deep).is_seen
    half = deep.copy()
    half[10:60] = half[10:60].mean()
    assert not tracker.follow(half).is_seen


def test_points_beyond_the_length_of_a_beam_do_not_bend_its_line() -> None:
    along = np.linspace(0.0, 40.0, 41)
    straight = np.column_stack([along, np.zeros(41)])
    bent = straight.copy()
    bent[32:, 1] = 4.0 * (along[32:] - 31.0)
    line = curve_through(bent, 30.0).at(np.array([10.0, 25.0]))[0]
    assert line == pytest.approx(curve_through(straight, 30.0).at(np.array([10.0, 25.0]))[0], abs=0.3)


def test_the_beam_at_its_root_is_at_most_as_bright_as_the_light() -> None:
    lit = np.full((112, 128), 100.0)
    lit[10:40, 50:70] = 180.0
    found = measure_back_light(lit, BeamFrame(CALIBRATION), 2.0)
    assert found.dark == found.bright
    assert found.bright == pytest.approx(105.0, abs=12.0)
    outside = BeamFrame(CALIBRATION.model_copy(update={"clamp_midpoint_px": (300.0, 300.0)}))
    nowhere = measure_back_light(lit, outside, 2.0)
    assert nowhere.dark == nowhere.bright


def test_boards_threads_and_clicks_that_give_no_calibration_are_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    unclear = EdgeSet(NOTHING, NOTHING, (), np.full((4, 2), np.nan))
    with pytest.raises(ValueError, match="the edge of the clamp is not visible"):
        _clamp_midpoint(unclear, BeamFrame(CALIBRATION))
    monkeypatch.setattr(cv2, "solvePnP", lambda *arguments: (False, None, None))
    with pytest.raises(ValueError, match="the pose of the board in front of the camera cannot be computed"):
        Lens(np.eye(3), np.zeros(5), 1.0, 0.1).stand_off_mm((np.zeros((5, 2)), np.zeros((5, 2))))
    board = Board("checkerboard", 6, 5, 4.0)
    dark = np.kron(np.where(np.pad(board.cells(), 10), 20, 220).astype(np.uint8), np.ones((3, 3), np.uint8))
    paths = [tmp_path / f"{number}.png" for number in range(4)]
    for path in paths:
        cv2.imwrite(str(path), dark)
    with pytest.raises(InputError, match=r"0.png and 3 more images: the views of the board do not determine"):
        from_board(paths, paths[0], board, BenchSetup(None, (60.0, 26.0), 90.0, 90.0, 0.0), 0.001)
    y, x = np.mgrid[0:200, 0:160]
    short = np.where((np.abs(x - 80) < 2) & (y > 60) & (y < 118), 40, 200).astype(np.uint8)
    with pytest.raises(ValueError, match="shows no dark thread"):
        measure_plumb_line(short, CALIBRATION, 90.0)
    cv2.imwrite(str(tmp_path / "short.png"), short)
    with pytest.raises(InputError, match=r"short.png: shows no dark thread"):
        with_measured_gravity(CALIBRATION, tmp_path / "short.png", 90.0)
    clicks = {"clamp_px": [[1000, 1400]], "ruler_px": [[1000, 600], [3000, 600]], "ruler_mm": 50.0}
    lens = FocalLength(6000.0, "the lens")
    for rise_px, is_refused in ((50, False), (120, True)):
        clicked = check(ClickedBench, {**clicks, "tip_px": [2600, 1400 - rise_px]}, "", "clicks")
        if is_refused:
            with pytest.raises(InputError, match="the clicked tip is above the clamp"):
                measure_bench(clicked, (4000, 3000), 42.0, 6.0, lens, date(2026, 3, 4))
        else:
            measure_bench(clicked, (4000, 3000), 42.0, 6.0, lens, date(2026, 3, 4))


def test_the_reason_of_a_followed_body_is_suggested_last(monkeypatch: pytest.MonkeyPatch) -> None:
    # Without another beam in the picture, the suggestion is the reason why the followed body is unusable.
    picture = SmallPicture().beam().exposed()
    findings = {"followed_beyond": 0.5, "followed_sides": 0.5}
    monkeypatch.setattr(suggested_corrections, "follow_beam", lambda *arguments, **options: FollowedBeam(findings))
    monkeypatch.setattr(
        suggested_corrections,
        "find_edges",
        lambda *arguments, **options: EdgeSet(NOTHING, NOTHING, (), np.zeros((4, 2))),
    )
    suggest = suggested_corrections.suggest_correction
    assert suggest(picture, CALIBRATION, specimen(), None).words.startswith(
        "a body was followed from the clamp over 50 % of length_mm"
    )
    findings.clear()
    assert "--along, --region" in suggest(picture, CALIBRATION, specimen(), None).words
    thin = suggest(picture, CALIBRATION, specimen(0.85), None).words
    assert thin.startswith("the beam is 5.9 px wide and should be at least 6 px wide")
    cut = CALIBRATION.model_copy(update={"clamp_midpoint_px": (3.0, 10.0)})
    assert "an edge of the beam begins outside the picture" in suggest(picture, cut, specimen(), None).words
    x = np.linspace(0.0, 11.0, 9)
    sides = (EdgePoints(np.column_stack([x, np.full(9, y)]), np.zeros(9)) for y in (-1.0, 1.0))
    found = EdgeSet(*sides, (), np.zeros((4, 2)))
    monkeypatch.setattr(suggested_corrections, "find_edges", lambda *arguments, **options: found)
    suggestion = suggest(picture, CALIBRATION, specimen(), None)
    assert suggestion.words == "a beam is found with width_mm = 1.6, 0.8 times the given value: is the width right?"
    assert suggestion.edges_px[0][-1] == pytest.approx([53.0, 87.0])


def test_the_loads_of_a_fit_have_the_stated_background_field() -> None:
    loads = Loads.along([0.0, 3.0], 90.0, 0.0)
    beam = specimen().mechanics()
    plain = in_stated_field(loads, CALIBRATION, beam)
    assert plain.others == ()
    stated = CALIBRATION.model_copy(update={"background_field_mT": (0.3, -0.2)})
    [background] = in_stated_field(loads, stated, beam).others
    assert np.asarray(background.numbers) == pytest.approx(np.array([[-0.2e-3, 0.3e-3]] * 2))


MAGNET = Magnet(4.0, 3.0, 2.0, 1.2, 7500.0)
BEAM = Specimen(30.0, 3.0, 5.0, 1070.0, section="solid", magnet=MAGNET)


def test_a_virtual_beam_without_an_equilibrium_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    class Beside:
        def solve(self, *arguments: Any, **options: Any) -> Any:
            return SimpleNamespace(converged=[False], effect=SimpleNamespace(by_turn="effect"))

    monkeypatch.setattr(beam_module, "_solved", lambda *arguments: (Beside(), None, 0.0))
    material = load_rig("virtual").virtual.materials.silicone["Dragon Skin 10"]
    virtual = VirtualBeam(BEAM, material, (4, 1, 1), VirtualLoads(0.0, 90.0), 6.0)
    with pytest.raises(ArithmeticError, match="no equilibrium of the virtual beam was found at 2 mT"):
        virtual.outlines_mm(2.0)
    assert virtual.moves(2.0)


@pytest.mark.parametrize(
    ("field_mT", "sign", "has_effect"),
    [(-0.29, 1.0, True), (-0.31, -1.0, True), (3.0, 1.0, True), (3.1, 1.0, False), (-3.1, -1.0, False)],
)
def test_the_depth_effect_is_used_in_the_fields_for_which_it_was_computed(
    monkeypatch: pytest.MonkeyPatch, field_mT: float, sign: float, has_effect: bool
) -> None:
    # Weak negative fields, down to a twentieth of the strongest one, use the solution for positive fields.
    given: list[Any] = []

    class Beside:
        def solve(self, *arguments: Any, options: Any) -> Any:
            given.append(options.effect)
            return SimpleNamespace(converged=[False])

    def solved(of: Any, law: Any, values: Any, mesh: Any, loads: Any, strongest_mT: float) -> Any:
        given.append(strongest_mT)
        return Beside(), "effect", 0.5 * strongest_mT

    monkeypatch.setattr(beam_module, "_solved", solved)
    material = load_rig("virtual").virtual.materials.silicone["Dragon Skin 10"]
    virtual = VirtualBeam(BEAM, material, (4, 1, 1), VirtualLoads(0.0, 90.0), 6.0)
    with pytest.raises(ArithmeticError):
        virtual.outlines_mm(field_mT)
    assert given == [6.0 * sign, "effect" if has_effect else None]


def test_the_memory_of_the_solids_is_freed() -> None:
    beam_module._model(BEAM, (4, 1, 1))
    assert beam_module._model.cache_info().currsize >= 1
    forget_solids()
    assert beam_module._model.cache_info().currsize == beam_module._solved.cache_info().currsize == 0


def test_a_plain_solid_without_an_equilibrium_gives_no_rod(monkeypatch: pytest.MonkeyPatch) -> None:
    class Model:
        def __init__(self, *arguments: Any) -> None:
            pass

        def solve(self, *arguments: Any, **options: Any) -> Any:
            return SimpleNamespace(converged=[False])

    monkeypatch.setattr(rod, "SolidBeside", Model)
    with pytest.raises(ArithmeticError, match="under a small load"):
        rod.stiffness_of_solid(replace(BEAM, magnet=None), "neo-hookean", (5e4,), (4, 1, 1))


@pytest.mark.parametrize("magnetisation", [(20e3, 0.0), (0.0, 8e3), (20e3, 8e3)])
def test_a_magnetised_rod_turns_in_a_field(magnetisation: tuple[float, float]) -> None:
    # The torque on the straight rod is the volume times the cross product of magnetisation and field.
    beam = Specimen(30.0, 2.0, 5.0, 1500.0, section="plane-stress", magnetisation_A_per_m=magnetisation)
    straight = Rod(beam, Stiffness(0.03, math.inf))
    still = np.zeros(straight.size)
    derivatives, remaining = straight.moved(still, still)
    field = np.array([2e-3, 5e-3])
    force = straight.loads(still, derivatives, remaining, field, np.zeros(2))
    torque = 2e-3 * 5e-3 * 0.03 * (magnetisation[0] * field[1] - magnetisation[1] * field[0])
    assert force[0] == pytest.approx(0.5 * torque)  # the mean of a rotation that grows evenly to 1 at the tip


def test_a_moving_beam_is_drawn_again_only_if_it_has_moved(monkeypatch: pytest.MonkeyPatch) -> None:
    # The field of a coil in another process is interpolated between the times of two frames.
    rig, current, asked = load_rig("virtual"), [0.5], []

    class Moving:
        def start(self, time_s: float, field_mT: float) -> None:
            asked.append((time_s, field_mT))

        def advance(self, time_s: float, between: Any) -> Array:
            asked.append((between(time_s - 0.02), between(time_s - 0.01), between(time_s)))
            return np.array([[1.0, 2.0 + (1e-3 if current[0] > 0.5 else 1e-8 * len(asked))]])

    shapes = SimpleNamespace(at=lambda coordinates: (coordinates, None))
    monkeypatch.setattr(virtual_rig, "MovingOutlines", lambda *arguments: shapes)
    virtual = SimpleNamespace(relaxes=True, moving=Moving, outlines_mm=None)
    coil = SimpleNamespace(coil_current_A=lambda: current[0])
    frame = BeamFrame(rig.calibration)
    camera = VirtualCamera(virtual, coil, SimulatedClock(), frame, 4.0, rig.virtual, 0.0, 50.0, BEAM, 6.0)
    camera._exposed_s = 0.02
    assert camera._moved()[0].tolist() == pytest.approx([1.0, 2.0], abs=1e-6)
    assert asked[0] == (0.02, 2.0)
    camera._scene = object()
    camera._exposed_s = 0.04
    assert camera._moved() is None
    current[0] = 1.0
    camera._exposed_s = 0.06
    assert camera._moved()[0].tolist() == pytest.approx([1.0, 2.001])
    assert asked[-1] == pytest.approx((2.0, 3.0, 4.0))
    camera._exposed_s = 0.08
    assert camera._moved() is None
    assert asked[-1] == pytest.approx((4.0, 4.0, 4.0))


def test_a_simulation_draws_six_states_and_names_the_file_that_cannot_be_written(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    specimen_file = parse(SpecimenFile, load_specimen("type1").text.replace('"solid"', '"plane-stress"'), "type1")
    law, values = parse_parameters("neo-hookean", ["mu_Pa=46390"])
    result = simulate(specimen_file, law, values, np.linspace(0.0, 1.0, 9), 0.0)
    assert len(result.plot().axes[0].collections) == 6
    assert result.write(tmp_path / "out") == tmp_path / "out"
    assert (tmp_path / "out" / "tip.csv").exists()
    with pytest.raises(InputError):
        result.write(tmp_path / "out")
    assert result.write(str(tmp_path / "out"), force=True) == tmp_path / "out"
    import meshio

    def refuse(*arguments: Any) -> None:
        raise OSError(errno.EFBIG, "File too large")

    monkeypatch.setattr(meshio.Mesh, "write", refuse)
    with pytest.raises(OSError, match="File too large") as caught:
        simulation._write_vtu(tmp_path / "state_00.vtu", result, 0)
    assert (caught.value.errno, caught.value.filename) == (errno.EFBIG, str(tmp_path / "state_00.vtu"))

"""The pictures of the benchmark raise every flag (warning about the edges), and ordinary frames raise no flag."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from eimi_drivers.interfaces import Frame
from eimi_lab.dataset.layout import flags_from_text, flags_to_text
from eimi_lab.virtual.optics import expose
from eimi_lab.vision import flags
from eimi_lab.vision.check import Check, Flag, Severity, leaves_out
from eimi_lab.vision.edges.dimensions import stiffening_by_twist
from eimi_lab.vision.edges.finding import find_edges
from eimi_lab.vision.flags import CHECKS, judge
from eimi_lab.vision.frame_checks import frame_flags, state_flags
from tests.shared.flag_pictures import BEAM, CASES, Case, photograph, table, twisted
from tests.shared.rendered_edges import CALIBRATION, NOMINAL, SPECIMEN, bend, make_bent_scene

LISTED = {
    *("SATURATED", "LOW_CONTRAST", "DEFOCUS", "EDGE_RESIDUAL", "TOUCHES_FRAME", "MULTI_CONTOUR"),
    *("HOLE_OR_REFLECTION", "CLAMP_NOT_FOUND", "CORNER_AMBIGUOUS", "WIDTH_ANOMALY", "LENGTH_ANOMALY"),
    *("CALIBRATION_STALE", "GAMMA", "TWIST", "NOT_SETTLED", "DROPPED", "DUPLICATE"),
}
ALONE = set(CASES) - {
    *("LOW_CONTRAST", "EDGE_RESIDUAL", "TOUCHES_FRAME", "CORNER_AMBIGUOUS"),
    # These flags concern photographs, which also have no silhouette.
    *("TOO_NARROW", "NOT_FOLLOWED", "ROOT_AMBIGUOUS", "OWN_SHADOW"),
}


def test_every_flag_has_one_picture():
    names = {check.name for check in CHECKS}
    assert set(CASES) == names >= LISTED
    assert len({check.finding for check in CHECKS}) == len(CHECKS)
    assert sorted(check.name for check in CHECKS if check.picture) == sorted(names)


def test_the_documentation_has_the_table_of_flags():
    assert table() in (Path(__file__).parents[2] / "docs" / "why" / "edges.md").read_text(encoding="utf-8")


def test_a_new_flag_needs_only_one_entry_in_the_table(monkeypatch):
    hot = Check(name="HOT", finding="coil_temperature", quantity="degrees", limit=80.0, remedy="Let {what} cool.")
    cold = replace(hot, name="COLD", finding="room_temperature", limit=10.0, below=True)
    with pytest.raises(KeyError, match="coil_temperature"):
        judge({"coil_temperature": 90.0})
    monkeypatch.setattr(flags, "CHECKS", (*CHECKS, hot, cold))
    monkeypatch.setattr(flags, "CHECK_OF", {check.finding: check for check in flags.CHECKS})
    words = {"what": "the coil"}
    assert judge({"coil_temperature": 90.0}, words=words) == (Flag("HOT", 90.0, 80.0, "Let the coil cool."),)
    assert [flag.name for flag in judge({"room_temperature": 9.0, "blur_px": 9.0}, words=words)] == ["DEFOCUS", "COLD"]
    assert judge({"coil_temperature": 80.0, "room_temperature": 10.0}) == ()
    assert judge({"coil_temperature": 90.0}, {"coil_temperature": 95.0}) == ()


def test_the_severity_of_a_flag_and_the_deviation_it_adds():
    # A flag that makes edges doubtful adds a standard deviation to the points; other flags add none.
    [clipped] = judge({"saturated_share": 1.0})
    assert (clipped.severity, leaves_out([clipped])) == (Severity.DOUBTFUL, False)
    assert clipped.widens_mm(25.0, 3.0, 5.0) > 0.26 / 25.0  # docs/why/edges.md gives this error of a clipped back-light
    [bent] = judge({"gamma": 2.2})
    assert bent.widens_mm(25.0, 3.0, 5.0) > 0.45 / 25.0
    words = {"even_turn": "", "twist_effect": ""}
    [near], [far] = judge({"width_deviation": 0.1}, words=words), judge({"width_deviation": 0.2}, words=words)
    assert (near.severity, near.widens_mm(25.0, 3.0, 5.0)) == (Severity.DOUBTFUL, pytest.approx(0.15))
    assert (far.severity, far.widens, leaves_out([near, far])) == (Severity.UNUSABLE, 0.0, True)
    [turned] = judge({"twist_deg": 2.0}, words=words)
    assert turned.widens_mm(25.0, 3.0, 5.0) == pytest.approx(2.5 * np.sin(np.radians(2.0)))
    [stale] = judge({"clamp_offset_mm": 0.4})
    assert stale.widens_mm(25.0, 3.0, 5.0) == 0.4
    [dim], [none] = judge({"contrast": 0.1}), judge({"contrast": 0.0})
    assert (dim.severity, none.severity) == (Severity.NOTE, Severity.UNUSABLE)
    assert judge({"repeated_images": 1}, words={"image": "x"})[0].severity is Severity.UNUSABLE


def test_flags_are_stored_with_their_severity_and_older_files_are_read():
    flags_found = judge({"saturated_share": 0.5, "blur_px": 9.0})
    assert flags_from_text(flags_to_text(flags_found)) == flags_found
    [old] = flags_from_text(b'[["DEFOCUS", 3.0, 2.5, "Focus."]]')
    assert old == Flag("DEFOCUS", 3.0, 2.5, "Focus.", Severity.UNUSABLE)


@pytest.mark.parametrize("name", sorted(CASES))
def test_the_picture_of_a_flag_raises_it(name):
    flag_of = {flag.name: flag for flag in CASES[name]().edges().flags}
    assert name in flag_of
    assert name not in ALONE or set(flag_of) == {name}
    flag = flag_of[name]
    assert np.isfinite(flag.value)
    assert flag.value != flag.limit
    assert flag.remedy[0].isupper()
    assert flag.remedy.count(". ") == 0
    assert flag.remedy.endswith(".")


def test_gamma_and_twist_are_measured():
    values = {flag.name: flag.value for name in ("GAMMA", "TWIST") for flag in CASES[name]().edges().flags}
    assert values["GAMMA"] == pytest.approx(2.2, abs=0.4)
    assert values["TWIST"] == pytest.approx(2.0, abs=0.15)


def test_twist_is_flagged_above_the_limit_with_its_effect_on_the_modulus():
    assert Case(photograph(beam=twisted(1.0))).edges().flags == ()
    [flag] = CASES["TWIST"]().edges().flags
    assert "a fitted modulus by +0.0" in flag.remedy
    # A uniform turn φ at 3 x 5 mm gives 1/(cos² φ + 0.36 sin² φ) - 1; a linear twist gives a third of it.
    exact = 1 / (np.cos(0.1) ** 2 + 0.36 * np.sin(0.1) ** 2) - 1
    assert stiffening_by_twist(0.0, np.degrees(0.1), 3.0, 5.0) == pytest.approx(exact / 3, rel=0.02)
    assert stiffening_by_twist(*np.degrees([0.1, 0.1]), 3.0, 5.0) == pytest.approx(exact, rel=0.02)
    assert stiffening_by_twist(0.0, 5.0, 3.0, 3.0) == 0.0


def test_a_beam_turned_as_a_whole_looks_wide_and_the_remedy_states_the_effect():
    [flag] = Case(photograph(beam=twisted(3.0, root_deg=3.0))).edges().flags
    assert flag.name == "WIDTH_ANOMALY"
    assert "a turn of 3.0 degrees" in flag.remedy
    # 1/(cos² φ + 0.36 sin² φ) - 1 is 0.18 % at 3 degrees.
    assert "a fitted modulus by +0.18 %" in flag.remedy
    [narrow] = CASES["WIDTH_ANOMALY"]().edges().flags
    assert "turn of" not in narrow.remedy


def test_a_clamp_that_moved_since_the_calibration_is_flagged():
    moved = CALIBRATION.model_copy(update={"clamp_midpoint_px": (640.3 + 5.0, 99.6)})  # 5 px are 0.2 mm
    [flag] = find_edges(photograph(), moved, SPECIMEN).flags
    assert (flag.name, flag.value) == ("CALIBRATION_STALE", pytest.approx(0.2, abs=0.01))
    along = CALIBRATION.model_copy(update={"clamp_midpoint_px": (640.3, 99.6 + 5.0)})
    [flag] = find_edges(photograph(), along, SPECIMEN).flags
    assert (flag.name, flag.value) == ("CALIBRATION_STALE", pytest.approx(0.2, abs=0.01))


def test_lost_repeated_and_moving_frames_are_flagged():
    scene = make_bent_scene(NOMINAL, CALIBRATION, SPECIMEN, BEAM)
    rng = np.random.default_rng(0)
    frames = [Frame(expose(scene, rng), 3 * number, 0.0) for number in range(4)]
    assert state_flags(frames, lossless=True) == ()
    assert state_flags(frames[:1], lossless=True) == ()

    def names(changed):
        return {flag.name for flag in state_flags(changed, lossless=True)}

    assert names([frames[0], replace(frames[0], number=3), frames[2]]) == {"DUPLICATE"}
    assert names([frames[0], frames[1], frames[3]]) == {"DROPPED"}
    shifted = np.roll(frames[3].image, 1, axis=1)
    assert names([*frames[:3], replace(frames[3], image=shifted)]) == {"NOT_SETTLED"}
    creeping = [replace(frame, image=_shifted(frame.image, 0.15 * k)) for k, frame in enumerate(frames)]
    assert names(creeping) == {"NOT_SETTLED"}
    assert state_flags(creeping, lossless=False) == ()


@pytest.mark.parametrize(
    ("numbers", "values"),
    [
        ((5, 6, 7), {}),
        ((5, 6, 8, 12), {"DROPPED": 1 + 3}),
        ((1, 1, 2), {"DUPLICATE": 1}),
        ((3, 2, 1, 4), {"DUPLICATE": 2, "DROPPED": 2}),
    ],
)
def test_missing_and_repeated_frames_are_counted(numbers, values):
    frames = [Frame(np.full((2, 2), k, np.uint8), number, 0.0) for k, number in enumerate(numbers)]
    flags = frame_flags(frames, SimpleNamespace(exceeds_rounding=True))
    assert {flag.name: flag.value for flag in flags} == values


def test_equal_pixels_are_a_repeated_frame_only_if_the_camera_has_noise():
    frames = [Frame(np.zeros((2, 2), np.uint8), number, 0.0) for number in range(3)]
    assert frame_flags(frames, SimpleNamespace(exceeds_rounding=False)) == ()
    (flag,) = frame_flags(frames, SimpleNamespace(exceeds_rounding=True))
    assert (flag.name, flag.value) == ("DUPLICATE", 2)


def test_frames_whose_numbers_differ_by_two_are_consecutive_and_motion_shows_in_any_channel():
    scene = make_bent_scene(NOMINAL, CALIBRATION, SPECIMEN, BEAM)
    rng = np.random.default_rng(0)
    images = [expose(scene, rng) for _ in range(4)]

    def values(numbers, shown):
        frames = [Frame(image, number, 0.0) for image, number in zip(shown, numbers, strict=True)]
        return {flag.name: flag.value for flag in state_flags(frames, lossless=True)}

    assert values((10, 12, 14, 16), images) == {}
    assert values((10, 12, 14, 18), images) == {"DROPPED": 1}
    flat = [np.full_like(image, 90) + (image % 3) for image in images]
    moved = [*images[:3], np.roll(images[3], 1, axis=1)]
    for channel in range(3):
        colours = [[still] * 3 for still in flat]
        for colour, image in zip(colours, moved, strict=True):
            colour[channel] = image
        assert set(values(range(4), [np.dstack(colour) for colour in colours])) == {"NOT_SETTLED"}


def _shifted(image, by_px):
    return cv2.warpAffine(image, np.array([[1.0, 0.0, by_px], [0.0, 1.0, 0.0]]), image.shape[::-1])


def ordinary_frames(count, seed):
    rng = np.random.default_rng(seed)
    done = 0
    while done < count:
        calibration = CALIBRATION.model_copy(
            update={"clamp_midpoint_px": (640.0 + rng.uniform(-20, 20), 99.0 + rng.uniform(-20, 20))}
        )
        optics = replace(
            NOMINAL,
            blur_px=rng.uniform(0.6, 1.8),
            background=rng.uniform(0.6, 0.88),
            gradient=rng.uniform(0.0, 0.2),
            silicone_transmission=rng.uniform(0.0, 0.15),
            full_well_e=rng.uniform(5e3, 2e4),
        )
        beam = bend(SPECIMEN, rng.uniform(-100.0, 100.0))
        scene = make_bent_scene(optics, calibration, SPECIMEN, beam)
        for _ in range(min(10, count - done)):
            yield expose(scene, rng), calibration
            done += 1


def flagged(count, seed):
    return [
        [flag.name for flag in edges.flags]
        for image, calibration in ordinary_frames(count, seed)
        if (edges := find_edges(image, calibration, SPECIMEN)).flags
    ]


def test_ordinary_frames_raise_no_flag():
    assert flagged(20, seed=1) == []


@pytest.mark.slow
def test_a_thousand_ordinary_frames_raise_no_flag():
    assert flagged(1000, seed=2) == []

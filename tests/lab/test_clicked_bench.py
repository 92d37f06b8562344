"""The calibration from clicks on a photograph agrees with calculations by hand."""

# The picture has 4000 x 3000 px: a click is uncertain by 4e-4 times the diagonal, 2 px. The ticks of the ruler are
# 2000.1 px and 50 mm apart: 40.002 px/mm. A lens with a focal length of 6000 px is 150.0 mm away. The near face of the
# beam is 3 mm nearer to the lens than the ruler: its points move by 3 / 150.0 towards the middle (1999.5, 1499.5) of
# the picture.

from __future__ import annotations

from datetime import date
from typing import Any

import pytest

from eimi_lab.config.toml import check
from eimi_lab.process.errors import InputError
from eimi_lab.vision.calibration.clicked_bench import ClickedBench, MeasuredBench, measure_bench
from eimi_lab.vision.calibration.exif_lens import FocalLength

CLICKED = {
    "clamp_px": [[1000, 1400]],
    "tip_px": [2600, 1500],
    "ruler_px": [[1000, 600], [3000, 620]],
    "ruler_mm": 50.0,
}
LENS = FocalLength(6000.0, "the lens")
BOTH_ENDS = [[1000, 1380], [1000, 1420]]


def measured(lens: FocalLength | None = LENS, **changes: Any) -> MeasuredBench:
    clicked = check(ClickedBench, {**CLICKED, **changes}, "", "clicks")
    return measure_bench(clicked, (4000, 3000), 42.0, 6.0, lens, date(2026, 3, 4))


def test_every_line_of_the_calibration_follows_from_the_clicks() -> None:
    first, _, others = measured().calibration.text.partition("\n")
    assert first.startswith('# Written by the page "Weights and a phone" from clicks on a picture.')
    assert others == (
        "# Tip: [2600.0, 1500.0].\n"
        "pixels_per_mm = 40.002                # ticks of the ruler, 50 mm and 2000.1 px apart\n"
        "clamp_midpoint_px = [1020.0, 1402.0]  # where the beam leaves its clamp: clicked on the near face of the "
        "beam, moved to its middle plane\n"
        "axis_angle_deg = 0.57                 # the beam leaves its clamp horizontally (assumed to 0.5 degrees)\n"
        "gravity_angle_deg = 90.57             # the ruler is horizontal or vertical (assumed to 0.5 degrees), the "
        "phone tilted by 0.57 degrees\n"
        "stand_off_mm = 150.0                  # the lens, and the scale\n"
        "camera_tilt_deg = [0.0, 0.0]          # the phone was parallel to the plane of the beam (assumed to 2 degrees "
        "about both axes)\n"
        "ruler_px = [[1000.0, 600.0], [3000.0, 620.0]]    # the ticks of the ruler\n"
        "calibrated_on = 2026-03-04\n"
        "\n"
        "[uncertainty]    # standard uncertainties; correct them if you know better\n"
        "pixels_per_mm = 0.27\n"  # 40.002 times the root of (sqrt(2) 2 / 2000.1)^2 + (1 / 150)^2
        "clamp_midpoint_px = 11\n"  # 2 px, half of the shift of 20.1 px, and 3 mm at 2 degrees
        "axis_angle_deg = 0.5\n"
        "gravity_angle_deg = 0.51\n"  # 0.5 degrees, and sqrt(2) 2 px over 2000.1 px
        "stand_off_mm = 4.5\n"  # 3 %
        "camera_tilt_deg = 2\n"
        "\n"
        "[picture]\n"
        "region_px = [0, 0, 3121, 3000]    # the part of the picture that the beam can reach\n"  # 1.25 times 42 mm
    )


def test_a_clamp_whose_ends_were_clicked_gives_the_axis_and_points_along_the_beam_are_kept() -> None:
    line = {"plumb": "clamp", "leaves": "clamp", "clamp_px": BOTH_ENDS}
    bench = measured(None, **line, stand_off_mm=160.0, along_px=[[1500, 1400], [2000, 1430]])
    calibration = bench.calibration
    assert calibration.clamp_midpoint_px == (1018.7, 1401.9)  # 3 / 160 of the distance from the middle of the picture
    assert (calibration.axis_angle_deg, calibration.gravity_angle_deg) == (0.0, 90.0)
    assert calibration.stand_off_mm == 160.0
    assert calibration.uncertainty == {
        "pixels_per_mm": 0.26,
        "clamp_midpoint_px": 10.0,
        "axis_angle_deg": 4.1,  # sqrt(2) 2 px over 40 px, and 0.5 degrees
        "gravity_angle_deg": 4.1,
        "stand_off_mm": 8.0,  # 5 %
        "camera_tilt_deg": 2.0,
    }
    assert calibration.picture is not None
    assert calibration.picture.along_px == ((1500.0, 1400.0), (2000.0, 1430.0), (2600.0, 1500.0))
    assert [bench.sources[key] for key in ("axis_angle_deg", "gravity_angle_deg", "stand_off_mm")] == [
        "perpendicular to the clamp's edge",
        "the clamp's edge is horizontal or vertical (assumed to 0.5 degrees), the phone tilted by 0.00 degrees",
        "measured with a ruler",
    ]


@pytest.mark.parametrize(
    ("changes", "axis_deg", "gravity_deg"),
    [
        ({"leaves": "downward"}, 90.57, 90.57),
        ({"leaves": "upward"}, -89.43, 90.57),
        ({"plumb": "picture"}, 0.0, 90.0),
        ({"plumb": "picture", "tip_px": [100, 1400]}, -180.0, 90.0),
        ({"tip_px": [100, 1400]}, -179.43, 90.57),  # a beam that leaves its clamp to the left
        ({"ruler_px": [[1000, 600], [1020, 2600]]}, -0.57, 89.43),  # a plumb ruler
        ({"leaves": "clamp", "clamp_px": BOTH_ENDS, "tip_px": [100, 1400]}, -180.0, 90.57),
    ],
)
def test_axis_and_gravity_follow_from_the_answers(changes: dict[str, Any], axis_deg: float, gravity_deg: float) -> None:
    calibration = measured(**changes).calibration
    assert (calibration.axis_angle_deg, calibration.gravity_angle_deg) == (axis_deg, gravity_deg)


def test_the_uncertainty_of_a_distance_measured_with_a_ruler_is_at_most_100_mm() -> None:
    assert (measured(stand_off_mm=1900.0).calibration.uncertainty or {})["stand_off_mm"] == 95.0
    assert (measured(stand_off_mm=2100.0).calibration.uncertainty or {})["stand_off_mm"] == 100.0


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"tip_px": [2900, 1400]}, "the tip is 47.5 mm from the clamp by the ruler, but length_mm = 42"),
        ({"tip_px": [1000, 1400]}, "the clicked tip is 0 px from the clamp (at least 40)"),
        ({"tip_px": [1039, 1400], "leaves": "downward"}, "the clicked tip is 39 px from the clamp"),
        ({"stand_off_mm": 11.9}, "the lens would be 11.9 mm from the beam, less than twice the beam's depth_mm = 6"),
        ({"lens": None}, "stand_off_mm is missing"),
        ({"ruler_px": [[1000, 600], [1039, 600]]}, "39 px apart; click ticks that are at least 40 px apart"),
        ({"ruler_px": [[1000, 600], [2000, 970]]}, "the ruler is turned by 20 degrees"),
        ({"plumb": "clamp"}, "click both ends of the clamp's edge, at least 20 px apart"),
        ({"plumb": "clamp", "clamp_px": [[1000, 1400], [1000, 1419]]}, "at least 20 px apart"),
        ({"plumb": "clamp", "clamp_px": [[1000, 1380], [1015, 1420]]}, "the clamp's edge is turned by -21 degrees"),
        ({"tip_px": [3999.6, 1400]}, "the point [3999.6, 1400] should lie in the picture of 4000 x 3000 px"),
        ({"tip_px": [2600, 2999.6]}, "the point [2600, 2999.6]"),
        ({"clamp_px": [[-0.6, 1400]]}, "the point [-0.6, 1400]"),
        ({"ruler_px": [[1000, -0.6], [3000, 20]]}, "the point [1000, -0.6]"),
        ({"along_px": [[4000, 5]]}, "the point [4000, 5]"),
    ],
)
def test_clicks_that_contradict_each_other_are_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError) as refused:
        measured(**changes)
    assert words in str(refused.value)


@pytest.mark.parametrize(
    "changes",
    [
        {"tip_px": [2840, 1400]},  # 46.0 mm of the length of 42 mm
        {"stand_off_mm": 12.1},
        {"ruler_px": [[1000, 600], [2000, 960]], "ruler_mm": 25.0, "tip_px": [2300, 2300]},  # turned by 19.8 degrees
        {"clamp_px": [[3999.5, 2999.5]], "tip_px": [3500, 2900], "leaves": "upward"},
        {"clamp_px": [[-0.5, -0.5]], "tip_px": [300, 300]},
    ],
)
def test_clicks_at_a_limit_are_accepted(changes: dict[str, Any]) -> None:
    left, top, wide, high = measured(**changes).calibration.picture.region_px  # type: ignore[union-attr, misc]
    assert (left >= 0, top >= 0, left + wide <= 4000, top + high <= 3000) == (True, True, True, True)

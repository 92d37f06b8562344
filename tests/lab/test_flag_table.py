"""Every flag (warning about edges) has the right limits, severities, and contribution to the standard deviation."""

# This file repeats the table of flags; `docs/why/edges.md` gives the sources of the limits.

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pytest

from eimi_lab.vision.check import Severity
from eimi_lab.vision.flags import CHECKS, judge


class Row(NamedTuple):
    # A row of the table of flags: a warning, and the limits of the measured value.
    # severity: severity beyond `limit`. unusable: limit beyond which a state is unusable. below: whether small values
    # get the warning. adds: an example of a value with the warning, and the standard deviation that is then added to
    # that of the edge points, as a number and its unit.

    name: str
    limit: float
    severity: str
    unusable: float | None = None
    below: bool = False
    adds: tuple[float, float, str] | None = None


ROWS = {
    "contrast": Row("LOW_CONTRAST", 0.2, "note", 0.03, below=True),
    "saturated_share": Row("SATURATED", 0.01, "doubtful", adds=(0.25, 0.15, "px")),
    "gamma": Row("GAMMA", 1.3, "doubtful", adds=(2.25, 0.5, "px")),
    "clamp_seen": Row("CLAMP_NOT_FOUND", 0.5, "note", below=True),
    "clamp_offset_mm": Row("CALIBRATION_STALE", 0.1, "doubtful", adds=(0.2, 0.2, "mm")),
    "calibration_age_days": Row("CALIBRATION_STALE", 90.0, "note"),
    "touches_frame": Row("TOUCHES_FRAME", 0.0, "unusable"),
    "other_bodies": Row("MULTI_CONTOUR", 0.0, "note"),
    "hole_share": Row("HOLE_OR_REFLECTION", 0.002, "note"),
    "corner_turn_deg": Row("CORNER_AMBIGUOUS", 55.0, "note", 10.0, below=True),
    "blur_px": Row("DEFOCUS", 2.5, "note", 8.0),
    "residual": Row("EDGE_RESIDUAL", 0.03, "doubtful", 0.15, adds=(0.1, 0.4, "px")),
    "width_deviation": Row("WIDTH_ANOMALY", 0.05, "doubtful", 0.15, adds=(0.1, 0.05, "width")),
    "followed_px": Row("TOO_NARROW", 6.0, "unusable", below=True),
    "followed_click": Row("NOT_FOLLOWED", 0.5, "unusable"),
    "followed_length": Row("NOT_FOLLOWED", 0.55, "unusable", below=True),
    "followed_stretch": Row("NOT_FOLLOWED", 0.55, "doubtful", 0.4, below=True),
    "followed_sides": Row("NOT_FOLLOWED", 0.7, "unusable", below=True),
    "followed_patches": Row("NOT_FOLLOWED", 0.7, "doubtful", 0.4, below=True, adds=(0.6, 0.02, "width")),
    "followed_contrast": Row("NOT_FOLLOWED", 3.0, "unusable", below=True),
    "followed_gain": Row("NOT_FOLLOWED", 0.2, "unusable", below=True),
    "followed_faint": Row("NOT_FOLLOWED", 0.2, "doubtful", 0.0, below=True, adds=(0.1, 0.01, "width")),
    "followed_begin": Row("NOT_FOLLOWED", 1.5, "unusable"),
    "followed_late": Row("NOT_FOLLOWED", 1.5, "doubtful", 3.0),
    "followed_width": Row("WIDTH_ANOMALY", 0.1, "doubtful", 0.21, adds=(0.2, 0.1, "width")),
    "followed_beyond": Row("LENGTH_ANOMALY", 1.15, "doubtful"),
    "followed_narrowing": Row("WIDTH_ANOMALY", 0.4, "unusable"),
    "followed_change": Row("WIDTH_ANOMALY", 0.08, "doubtful", adds=(0.2, 0.05, "width")),
    "followed_shadow": Row("OWN_SHADOW", 0.0, "doubtful", adds=(3.0, 1.5, "px")),
    "followed_penumbra": Row("OWN_SHADOW", 0.0, "doubtful", adds=(3.0, 3.0, "px")),
    "followed_clipped": Row("SATURATED", 0.1, "doubtful", adds=(0.64, 0.4, "px")),
    "followed_gleam": Row("HOLE_OR_REFLECTION", 0.03, "doubtful", adds=(0.25, 0.05, "width")),
    "followed_rival": Row("ROOT_AMBIGUOUS", 0.93, "doubtful"),
    "followed_tip": Row("CORNER_AMBIGUOUS", 0.0, "note"),
    "followed_clamp": Row("CLAMP_NOT_FOUND", 0.5, "note", below=True),
    "followed_out": Row("TOUCHES_FRAME", 0.0, "note"),
    "twist_deg": Row("TWIST", 1.5, "doubtful", 10.0, adds=(6.0, 0.5 * math.sin(math.pi / 30), "depth")),
    "length_deviation": Row("LENGTH_ANOMALY", 0.1, "note", 0.25),
    "missing_frames": Row("DROPPED", 0.0, "note"),
    "damaged_frames": Row("DROPPED", 0.0, "note"),
    "repeated_frames": Row("DUPLICATE", 0.0, "note"),
    "repeated_images": Row("DUPLICATE", 0.0, "unusable"),
    # A ratio of 2.2 corresponds to a motion of a fifth of a pixel, see `settling_statistic`.
    "settling_ratio": Row("NOT_SETTLED", 1.2, "doubtful", 30.0, adds=(2.2, 0.2, "px")),
    "motion_ratio": Row("NOT_SETTLED", 1.2, "doubtful", 30.0, adds=(2.2, 0.2, "px")),
}
WORDS = {"even_turn": "", "narrow_px": "5", "clicks_off": "none", "twist_effect": "1", "image": "a.png"}


def test_every_check_is_in_the_table() -> None:
    assert [check.finding for check in CHECKS] == list(ROWS)


@pytest.mark.parametrize("finding", ROWS)
def test_a_value_is_judged_on_both_sides_of_every_limit(finding: str) -> None:
    row = ROWS[finding]
    outward = -1.0 if row.below else 1.0

    def severity(value: float) -> str | None:
        flags = judge({finding: value}, words=WORDS)
        assert all((flag.name, flag.value, flag.limit) == (row.name, value, row.limit) for flag in flags)
        return str(flags[0].severity) if flags else None

    step = 1e-6 * max(row.limit, 1.0)
    assert severity(row.limit - outward * step) is None
    assert severity(row.limit) is None
    assert severity(row.limit + outward * step) == row.severity
    if row.unusable is None:
        far = row.limit / 100.0 if row.below else 100.0 * max(row.limit, 1.0)
        assert severity(far) == row.severity
    else:
        assert severity(row.unusable) == row.severity
        assert severity(row.unusable + outward * step) == "unusable"


@pytest.mark.parametrize("finding", ROWS)
def test_a_doubtful_value_adds_its_deviation_to_the_points(finding: str) -> None:
    row = ROWS[finding]
    if row.adds is None:
        (flag,) = judge({finding: row.limit / 1.001 if row.below else 1.001 * row.limit + 0.001}, words=WORDS)
        assert flag.widens == 0.0
        return
    value, deviation, unit = row.adds
    (flag,) = judge({finding: value}, words=WORDS)
    assert flag.severity is Severity.DOUBTFUL
    scale_mm = {"px": 1.0 / 25.0, "mm": 1.0, "width": 3.0, "depth": 5.0}[unit]
    assert flag.widens_mm(25.0, 3.0, 5.0) == pytest.approx(deviation * scale_mm)


def test_a_deviation_grows_with_its_value() -> None:
    # The standard deviation that a flag adds never falls as the value moves past its limit.
    for check in CHECKS:
        if check.widens is None:
            continue
        end = check.unusable_beyond if check.unusable_beyond is not None else 3.0 * max(check.limit, 1.0)
        added = [check.widens(value) for value in np.linspace(check.limit, end, 50)]
        assert (np.diff(added) >= 0).all(), check.finding
        assert added[0] >= 0.0, check.finding
        assert math.isfinite(added[-1]), check.finding

"""The wait for the beam at rest compares the right frames, and ends at its limits."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from eimi_drivers.interfaces import Frame
from eimi_lab.acquisition import settling
from eimi_lab.acquisition.settling import Settling, wait_until_settled
from eimi_lab.config.protocol import Settle


class Bench:
    # A camera, its noise and a clock: a picture of one pixel comes every 0.125 s, and its grey value is its place.
    # The difference ratio of two pictures is the distance of their places; `compared` lists what was compared with
    # which band, and bands are numbered.

    def __init__(self, monkeypatch: pytest.MonkeyPatch, places: list[float], *, exceeds_rounding: bool = False) -> None:
        self.places, self.taken, self.bands, self.exceeds_rounding = places, 0, 0, exceeds_rounding
        self.compared: list[tuple[float, float, Any]] = []
        self.seen: list[float] = []
        self.checks = self.flushes = 0
        self.special: dict[tuple[float, float, int], float] = {}
        monkeypatch.setattr(settling, "edge_pixels", self.edge_pixels)
        monkeypatch.setattr(settling, "mean_grey", lambda image: image)

    def edge_pixels(self, image: Any) -> int:
        self.bands += 1
        return self.bands

    def now(self) -> float:
        return self.taken * 0.125

    def flush(self) -> None:
        self.flushes += 1

    def grab(self, timeout_s: float) -> Frame:
        assert timeout_s == 5.0
        place = self.places[min(self.taken, len(self.places) - 1)]
        self.taken += 1
        return Frame(np.full((1, 1), place), self.taken, self.now())

    def difference_ratio(self, earlier: Any, later: Any, band: Any) -> float:
        given = (float(earlier[0, 0]), float(later[0, 0]), band)
        self.compared.append(given)
        return self.special.get(given, abs(given[0] - given[1]))

    def check(self) -> None:
        self.checks += 1

    def settle(self, not_before_s: float = 0.0, **changes: Any) -> Settling:
        rule = {"noise_ratio": 1.5, "pairs": 2, "drift_window_s": 0.25, "timeout_s": 1.0} | changes
        noise: Any = self
        return wait_until_settled(
            self,  # type: ignore[arg-type]
            self,  # type: ignore[arg-type]
            Settle(**rule),  # type: ignore[arg-type]
            noise,
            self.check,
            lambda frame, at_s: self.seen.append(at_s),
            not_before_s,
        )


def test_a_beam_at_rest_is_compared_with_its_last_band(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(monkeypatch, [1.0, 2.0, 3.0, 3.0])
    assert bench.settle() == Settling(0.0, 1.0, 0.5, ())
    assert bench.compared == [
        (1.0, 2.0, 1),
        (1.0, 2.0, 2),  # the first quiet pair again, with its own band
        (2.0, 3.0, 2),
        (1.0, 3.0, 2),  # the window of 0.25 s: too large
        (3.0, 3.0, 2),
        (2.0, 3.0, 2),  # the window: small
        (3.0, 3.0, 3),  # both again, with the band of the last picture
        (2.0, 3.0, 3),
    ]
    assert bench.seen == [0.125, 0.25, 0.375, 0.5]
    assert (bench.flushes, bench.checks) == (1, 8)


EIGHTHS = [0.25 * number for number in range(1, 10)]


def test_a_pair_that_is_not_quiet_in_its_last_band_begins_the_count_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(monkeypatch, EIGHTHS)
    bench.special = {(0.5, 0.75, 3): 1.75}
    assert bench.settle() == Settling(0.25, 0.5, 0.625, ())
    assert bench.compared[3:] == [
        (0.25, 0.75, 2),
        (0.5, 0.75, 3),
        (0.25, 0.75, 3),
        (0.75, 1.0, 3),
        (0.75, 1.0, 4),  # the first quiet pair of the new count
        (1.0, 1.25, 4),
        (0.75, 1.25, 4),
        (1.0, 1.25, 5),
        (0.75, 1.25, 5),
    ]


def test_a_window_that_is_not_quiet_in_its_last_band_leaves_the_count(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(monkeypatch, EIGHTHS)
    bench.special = {(0.25, 0.75, 3): 1.75}
    assert bench.settle() == Settling(0.25, 0.5, 0.5, ())
    assert bench.compared[5:] == [
        (0.25, 0.75, 3), (0.75, 1.0, 3), (0.5, 1.0, 3), (0.75, 1.0, 4), (0.5, 1.0, 4)
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("places", "not_before_s", "expected"),
    [
        ([0.0, 0.75, 1.5], 0.0, (0.75, 1.5, 0.375)),  # the window is at its limit
        ([0.0, 1.5, 0.0], 0.0, (1.5, 0.0, 0.375)),  # the pairs are at their limit
        ([0.0], 0.0, (0.0, 0.0, 0.375)),
        ([0.0], 0.5, (0.0, 0.0, 0.5)),
        ([0.0], 0.51, (0.0, 0.0, 0.625)),
        ([0.0], 2.0, (0.0, 0.0, 2.0)),  # later than the time limit
        ([0.0, 9.0, 9.0, 9.0], 0.0, (0.0, 0.0, 0.5)),  # the first pair is not quiet
    ],
)
def test_the_wait_ends_at_the_first_time_at_which_all_limits_hold(
    monkeypatch: pytest.MonkeyPatch, places: list[float], not_before_s: float, expected: Any
) -> None:
    assert Bench(monkeypatch, places).settle(not_before_s) == Settling(*expected, ())


@pytest.mark.parametrize(
    ("places", "ratio", "drift_ratio", "worst"),
    [
        ([0.0, 9.0, 0.0, 9.0, 0.0, 9.0, 0.0, 3.0, 0.75], 3.0, np.inf, 3.0),  # the larger of the last two
        ([1.25 * number for number in range(9)], 1.25, 2.5, 2.5),
        ([0.0, 1.0, 2.0, 5.0, 2.0, 5.0, 2.0, 5.0, 2.0], 3.0, 2.0, 3.0),
    ],
)
def test_a_beam_that_does_not_rest_is_flagged_with_its_largest_ratio(
    monkeypatch: pytest.MonkeyPatch, places: list[float], ratio: float, drift_ratio: float, worst: float
) -> None:
    # A frame begins at the time limit of 1 s and ends the wait at 1.125 s.
    found = Bench(monkeypatch, places).settle()
    assert (found.ratio, found.drift_ratio, found.waited_s) == (ratio, drift_ratio, 1.125)
    (flag,) = found.flags
    assert (flag.name, flag.value, flag.limit) == ("NOT_SETTLED", worst, 1.5)


def test_a_single_frame_is_flagged_without_a_ratio(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(monkeypatch, [0.0])
    monkeypatch.setattr(bench, "now", lambda: 2.0 * bench.taken)
    found = bench.settle()
    assert (found.ratio, found.drift_ratio, found.waited_s) == (np.inf, np.inf, 2.0)
    assert [(flag.name, flag.value, flag.limit) for flag in found.flags] == [("NOT_SETTLED", 0.0, 1.5)]


@pytest.mark.parametrize(
    ("exceeds_rounding", "expected", "seen"),
    [
        (True, Settling(0.5, 0.5, 0.625, ()), [0.125, 0.375, 0.625]),
        (False, Settling(0.5, 0.5, 0.375, ()), [0.125, 0.25, 0.375]),
    ],
)
def test_the_same_picture_twice_counts_once_if_the_noise_is_more_than_rounding(
    monkeypatch: pytest.MonkeyPatch, exceeds_rounding: bool, expected: Settling, seen: list[float]
) -> None:
    bench = Bench(monkeypatch, [0.0, 0.0, 0.5, 0.5, 1.0], exceeds_rounding=exceeds_rounding)
    assert bench.settle() == expected
    assert bench.seen == seen
    assert bench.checks == 2 * bench.taken

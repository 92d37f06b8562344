"""Frame numbers of GigE and USB3 cameras keep increasing, and every lost frame is counted once with its reason."""

from __future__ import annotations

from collections import Counter

import pytest

from eimi_drivers.cameras.aravis import AravisCamera


def camera(gige: bool = True) -> AravisCamera:
    # Return an Aravis camera without a frame yet: GigE, or else USB3.
    made = object.__new__(AravisCamera)
    made._gige, made._last_id, made._number, made._counting = gige, None, 0, False
    made._incomplete, made.lost_frames = Counter(), Counter()
    return made


@pytest.mark.parametrize(
    ("gige", "identifiers", "numbers", "lost"),
    [
        (True, [1, 2, 3], [1, 2, 3], 0),
        (True, [7, 9, 12], [7, 9, 12], 3),
        (True, [65534, 65535, 1, 2], [65534, 65535, 65536, 65537], 0),
        (True, [65535, 2], [65535, 65537], 1),
        (True, [65536, 65537], [65536, 65537], 0),  # identifiers of 64 bits do not begin again
        (False, [65535, 65536], [65535, 65536], 0),
        (False, [0, 1, 4], [0, 1, 4], 2),
    ],
)
def test_numbers_go_on_when_the_counter_of_the_camera_begins_again(
    gige: bool, identifiers: list[int], numbers: list[int], lost: int
) -> None:
    made = camera(gige)
    assert [made._numbered(identifier) for identifier in identifiers] == numbers
    assert dict(made.lost_frames) == ({"no packet": lost} if lost else {})


def test_incomplete_frames_are_counted_with_their_reason_and_only_while_counting() -> None:
    made = camera()
    made._numbered(1)
    made._incomplete = Counter({"missing packets": 2})
    assert made._numbered(5) == 5
    assert +made.lost_frames == Counter({"missing packets": 2, "no packet": 1})
    assert made._incomplete.total() == 0
    made._counting = False
    made._incomplete = Counter({"missing packets": 1})
    assert made._numbered(9) == 9
    assert made.lost_frames.total() == 3
    assert made._numbered(11) == 11
    assert made.lost_frames["no packet"] == 2


def test_incomplete_frames_before_the_first_complete_one_count() -> None:
    made = camera()
    made._counting = True
    made._incomplete = Counter({"timeout": 2})
    assert made._numbered(8) == 8
    assert +made.lost_frames == Counter({"timeout": 2})

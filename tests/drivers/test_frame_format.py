"""A frame that is no image, or differs in format from the first frame of a run, is refused with an error message."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_drivers.cameras.frame_format import check_frame
from eimi_drivers.interfaces import Frame, ReplyNotUnderstood

FIRST = Frame(np.zeros((24, 32), np.uint8), 1, 0.0)


def of(shape: tuple[int, ...], dtype: type = np.uint8) -> Frame:
    return Frame(np.ones(shape, dtype), 2, 0.1)


@pytest.mark.parametrize(
    ("frame", "words"),
    [
        (None, "nothing instead of an image"),
        (SimpleNamespace(image="a picture"), "a str instead of an image"),
        (of((0, 32)), "an empty image instead of an image"),
        (of((24, 32), np.float64), r"32 x 24 float64; it should be an array of shape \(height, width\)"),
        (of((24, 32, 4)), "32 x 24 uint8 in colour; it should be"),
        (of((24,)), "24 uint8; it should be"),
        (of((2, 24, 32, 3)), "it should be"),
        (of((24, 33)), "frame 2 is 33 x 24 uint8, the earlier frames are 32 x 24 uint8; size, bit depth"),
        (of((24, 32), np.uint16), "frame 2 is 32 x 24 uint16, the earlier"),
        (of((24, 32, 3)), "frame 2 is 32 x 24 uint8 in colour, the earlier"),
    ],
)
def test_a_frame_that_does_not_fit_is_refused(frame: Any, words: str) -> None:
    with pytest.raises(ReplyNotUnderstood, match=f"^camera 7: .*{words}"):
        check_frame("camera 7", frame, FIRST)


@pytest.mark.parametrize("frame", [of((24, 32)), of((24, 32), np.uint16), of((24, 32, 3)), of((1, 1))])
def test_the_first_frame_may_have_every_format_and_the_others_the_same(frame: Frame) -> None:
    assert check_frame("camera 7", frame, None) is frame
    assert check_frame("camera 7", frame, frame) is frame

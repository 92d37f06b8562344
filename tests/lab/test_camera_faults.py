"""If a camera returns no image, or an image of another size or type, the run ends with the coil off."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from eimi_drivers.interfaces import Frame, ReplyNotUnderstood
from eimi_lab.dataset.reading import open_dataset

SPOILT: dict[str, Callable[[Frame], Any]] = {
    "returned nothing": lambda frame: None,
    "returned an empty image": lambda frame: replace(frame, image=np.zeros((0, 128), np.uint8)),
    "is 64 x 96 uint8, the earlier frames are 128 x 96 uint8": lambda frame: replace(frame, image=frame.image[:, :64]),
    "is 128 x 96 uint16": lambda frame: replace(frame, image=frame.image.astype(np.uint16)),
    "is 128 x 96 uint8 in colour": lambda frame: replace(frame, image=np.dstack([frame.image] * 3)),
    "returned 128 x 96 float64": lambda frame: replace(frame, image=frame.image.astype(float)),
}


@pytest.mark.parametrize(
    ("expected", "after"),
    [
        *((expected, 30) for expected in SPOILT),
        *((expected, 0) for expected in SPOILT if expected.startswith("returned")),
    ],
)
def test_a_camera_that_returns_no_frame_ends_the_run_in_one_line_with_the_coil_off(
    setup: Any, expected: str, after: int
) -> None:
    grab = setup.camera.grab

    def spoilt(timeout_s: float) -> Any:
        frame = grab(timeout_s)
        return SPOILT[expected](frame) if frame.number > after else frame

    setup.camera.grab = spoilt
    with pytest.raises(ReplyNotUnderstood, match=expected) as fault:
        setup.run()
    assert "\n" not in str(fault.value)
    assert setup.is_off()


def test_frames_whose_number_never_advances_are_flagged(setup: Any) -> None:
    grab = setup.camera.grab
    setup.camera.grab = lambda timeout_s: replace(grab(timeout_s), number=7)
    setup.run()
    with open_dataset(setup.path) as dataset:
        assert all("DUPLICATE" in [flag.name for flag in state.flags] for state in dataset.states)

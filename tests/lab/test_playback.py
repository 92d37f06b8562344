"""A recording can take the place of a camera, and a viewer receives every frame."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import pytest

from eimi_drivers.cameras.settings import NO_SETTINGS
from eimi_drivers.interfaces import EndOfPlayback, Frame, Identity, ReplyNotUnderstood
from eimi_lab.acquisition import playback
from eimi_lab.acquisition.live_view import Live, WatchedCamera
from eimi_lab.acquisition.playback import Cue, PlayedCamera, describe_recording_length
from eimi_lab.acquisition.ring_downs import frame_times
from eimi_lab.acquisition.stepping import _with_lost_frames
from eimi_lab.config.rig import Playback
from eimi_lab.process.errors import InputError
from eimi_lab.vision.check import Flag


class Pictures:
    # A recording of three pictures, whose grey values are 1, 2 and 3.

    settings = NO_SETTINGS

    def __init__(self) -> None:
        self.at = 0
        self.closed = False
        self.waits_s: list[float] = []
        self.lost_frames: Counter[str] = Counter()

    def identify(self) -> Identity:
        return Identity("pictures", "three pictures", "memory")

    def flush(self) -> None:
        raise AssertionError("a recording is never flushed")

    def grab(self, timeout_s: float) -> Frame:
        self.waits_s.append(timeout_s)
        if self.at == 3:
            raise EndOfPlayback("end of playback after 3 images")
        self.at += 1
        return Frame(np.full((2, 3), self.at, np.uint8), self.at, float(self.at))

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[Pictures]:
    monkeypatch.setattr(playback, "HELD_FRAME_S", 0.0)
    return []


def played(opened: list[Pictures], cue: Cue | None = None, **rule: bool) -> PlayedCamera:
    def open_it() -> Any:
        opened.append(Pictures())
        return opened[-1]

    return PlayedCamera(open_it, Playback(**rule), cue or Cue())


def shown(frame: Frame) -> tuple[int, int]:
    return frame.number, int(frame.image[0, 0])


def test_a_recording_is_played_frame_by_frame_to_its_end(opened: list[Pictures]) -> None:
    camera = played(opened, picture_a_state=False, loop=False)
    camera.flush()
    assert camera.settings is NO_SETTINGS
    assert [shown(camera.grab(wait_s)) for wait_s in (0.5, 1.0, 2.0)] == [(1, 1), (2, 2), (3, 3)]
    with pytest.raises(EndOfPlayback):
        camera.grab(4.0)
    assert opened[0].waits_s == [0.5, 1.0, 2.0, 4.0]
    assert camera.identify().text == "three pictures"
    camera.close()
    assert opened[0].closed


def test_a_recording_in_a_loop_begins_again_and_its_frames_are_numbered_on(opened: list[Pictures]) -> None:
    camera = played(opened, picture_a_state=False, loop=True)
    assert [shown(camera.grab(1.0)) for _ in range(5)] == [(1, 1), (2, 2), (3, 3), (4, 1), (5, 2)]
    assert [recording.closed for recording in opened] == [True, False]


def test_a_picture_serves_for_a_whole_state(opened: list[Pictures]) -> None:
    cue = Cue()
    assert cue.state == 0
    camera = played(opened, cue, picture_a_state=True, loop=False)
    assert [shown(camera.grab(1.0)) for _ in range(3)] == [(1, 1), (2, 1), (3, 1)]
    assert opened[0].waits_s == [1.0]
    times_s = [camera.grab(1.0).timestamp_s for _ in range(2)]
    assert times_s[0] <= times_s[1]
    cue.state = 2  # the run resumed: the picture of state 1 is passed over
    assert [shown(camera.grab(1.0)) for _ in range(2)] == [(6, 3), (7, 3)]
    cue.state = 3
    with pytest.raises(EndOfPlayback):
        camera.grab(1.0)


def test_a_loop_of_pictures_begins_again_with_the_state_after_the_last_picture(opened: list[Pictures]) -> None:
    cue = Cue()
    camera = played(opened, cue, picture_a_state=True, loop=True)
    seen = []
    for cue.state in range(5):
        seen.append(shown(camera.grab(1.0))[1])
    assert seen == [1, 2, 3, 1, 2]


@pytest.mark.parametrize(
    ("pictures", "rule", "said"),
    [
        (
            40,
            {"picture_a_state": False, "loop": False},
            "has 40 pictures; the run uses at least 28 pictures, and more while",
        ),
        (
            28,
            {"picture_a_state": False, "loop": False},
            "has 28 pictures; the run uses at least 28 pictures, and more while",
        ),
        (27, {"picture_a_state": False, "loop": True}, "settle; the recording starts again after its last picture"),
        (27, {"picture_a_state": False, "loop": False}, "set picture_a_state = true to use one picture for each state"),
        (4, {"picture_a_state": True, "loop": False}, "has 4 pictures; the run uses 4 pictures, one for each state"),
        (3, {"picture_a_state": True, "loop": False}, "one for each state; set loop = true to start again after the"),
        (3, {"picture_a_state": True, "loop": True}, "state; the recording starts again after its last picture"),
    ],
)
def test_the_length_of_a_recording_is_compared_with_the_run(
    setup: Any, monkeypatch: pytest.MonkeyPatch, pictures: int, rule: dict[str, bool], said: str
) -> None:
    # The run takes 28 frames.
    monkeypatch.setattr(playback, "recording_length", lambda source: pictures)
    chosen = setup.rig.camera.model_copy(update={"driver": playback.PLAYER, "playback": Playback(**rule)})
    rig = setup.rig.model_copy(update={"camera": chosen})
    if "; set " in said or said.startswith("set "):
        with pytest.raises(InputError) as refused:
            describe_recording_length(setup.protocol, rig)
        assert said in str(refused.value)
        assert str(refused.value).endswith("after the last picture, in [camera] playback")
    else:
        assert said in describe_recording_length(setup.protocol, rig)
    device = rig.model_copy(update={"camera": chosen.model_copy(update={"driver": "basler"})})
    assert describe_recording_length(setup.protocol, device) == ""


def test_a_viewer_receives_each_frame_with_the_state_of_the_run() -> None:
    seen: list[Live] = []
    recording, cue = Pictures(), Cue()
    camera = WatchedCamera(recording, seen.append, cue)
    first = camera.grab(1.0)
    camera.at(4, 0.25)
    second = camera.grab(1.0)
    assert [(live.frame, live.state, live.current_A) for live in seen] == [(first, None, None), (second, 4, 0.25)]
    assert cue.state == 4
    assert camera.identify().text == "three pictures"
    camera.close()
    assert recording.closed


def test_a_frame_of_another_size_than_the_first_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = Pictures()
    camera = WatchedCamera(recording, lambda live: None, Cue())
    camera.grab(1.0)
    monkeypatch.setattr(recording, "grab", lambda timeout_s: Frame(np.zeros((3, 2), np.uint8), 2, 0.0))
    with pytest.raises(ReplyNotUnderstood, match="memory"):
        camera.grab(1.0)


def test_lost_frames_are_counted_once() -> None:
    recording = Pictures()
    camera = WatchedCamera(recording, lambda live: None, Cue())
    recording.lost_frames["no packet"] = 2
    assert camera.newly_lost() == {"no packet": 2}
    assert camera.newly_lost() == {}
    recording.lost_frames.update({"no packet": 1, "late": 1})
    assert camera.newly_lost() == {"no packet": 1, "late": 1}
    del recording.lost_frames
    assert camera.newly_lost() == {}


def test_lost_frames_flag_a_state_once() -> None:
    kept = (Flag("NOT_SETTLED", 2.0, 1.2, "Wait."), Flag("DROPPED", 1.0, 0.0, "Look."))
    assert _with_lost_frames(kept, 0) == kept
    flagged = _with_lost_frames(kept, 3)
    assert [flag.name for flag in flagged] == ["NOT_SETTLED", "DROPPED"]
    assert flagged[1].value == 3


@pytest.mark.parametrize(
    ("arrived_s", "stamped_s", "times_s"),
    [
        ([10.02, 10.05, 10.07], [1.0, 1.02, 1.04], [10.02, 10.04, 10.06]),
        ([10.02, 10.03, 10.07], [1.0, 1.02, 1.04], [10.01, 10.03, 10.05]),  # the second frame had the shortest delay
        ([10.02], [1.0], [10.02]),
        ([10.02, 10.03], [1.0, 1.1], [9.93, 10.03]),
        ([10.0, 10.1, 10.2], [1.0, 1.0, 1.2], None),  # a time stamp twice
        ([10.0, 10.1, 10.2], [1.2, 1.1, 1.0], None),
        ([10.0, 10.1, 10.2], [1.0, float("nan"), 1.2], None),
        ([0.0, 100.0], [0.0, 102.9], [-2.9, 100.0]),  # 2 % of 100 s, and 1 s of waiting, are permitted
        ([0.0, 100.0], [0.0, 103.1], None),
        ([0.0, 100.0], [0.0, 97.1], [0.0, 97.1]),
        ([0.0, 100.0], [0.0, 96.9], None),
    ],
)
def test_time_stamps_are_shifted_to_the_frame_with_the_shortest_delay(
    arrived_s: list[float], stamped_s: list[float], times_s: list[float] | None
) -> None:
    assert frame_times(arrived_s, stamped_s) == pytest.approx(arrived_s if times_s is None else times_s)

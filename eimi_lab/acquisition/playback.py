"""Play a recording (a video or a folder of pictures) in place of a camera."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from eimi_drivers.cameras.image_series import recording_length
from eimi_drivers.cameras.settings import settings_of
from eimi_drivers.interfaces import Camera, EndOfPlayback, Frame, Identity
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.rig import PLAYER, Playback, Rig
from eimi_lab.process.errors import InputError

HELD_FRAME_S = 1 / 30
"""Time (s) between two frames that show the same picture, like the time between two frames of a camera."""

NOISE_FRAMES = 8
"""Number of frames of the beam at rest that are taken before the run to measure the noise of the camera."""


@dataclass
class Cue:
    """The number of the present state (load step) of the run, for a camera that plays a recording."""

    state: int = 0


class PlayedCamera:
    """A camera that plays a recording (a video or a folder of pictures). Its frames are numbered from 1.

    Parameters
    ----------
    open_it : callable
        Opens the recording at its beginning.
    rule : Playback
        Whether all frames of a state (load step) show one picture, and whether the recording is repeated.
    cue : Cue
        Holds the number of the present state of the run.
    """

    def __init__(self, open_it: Callable[[], Camera], rule: Playback, cue: Cue) -> None:
        self._open_it, self._rule, self._cue = open_it, rule, cue
        self._camera = open_it()
        self.settings = settings_of(self._camera)
        self._number = self._pictures = 0
        self._held: Frame | None = None

    def identify(self) -> Identity:
        """Return the identity of the camera that plays the recording."""
        return self._camera.identify()

    def flush(self) -> None:
        """Do nothing: a recording has no old frames."""

    def grab(self, timeout_s: float) -> Frame:
        """Return the next frame of the recording.

        With `picture_a_state`, return the same picture at each call during a state (load step). `timeout_s` is the
        longest wait for a frame, s. Raises EndOfPlayback at the end of the recording.
        """
        frame = self._held
        if not self._rule.picture_a_state:
            frame = self._next(timeout_s)
        else:
            time.sleep(HELD_FRAME_S)
            while frame is None or self._pictures <= self._cue.state:
                frame = self._held = self._next(timeout_s)
        self._number += 1
        return replace(frame, number=self._number, timestamp_s=time.monotonic())

    def close(self) -> None:
        """Close the recording."""
        self._camera.close()

    def _next(self, timeout_s: float) -> Frame:
        try:
            frame = self._camera.grab(timeout_s)
        except EndOfPlayback:
            if not self._rule.loop:
                raise
            self._camera.close()
            self._camera = self._open_it()
            frame = self._camera.grab(timeout_s)
        self._pictures += 1
        return frame


def describe_recording_length(protocol: Protocol, rig: Rig) -> str:
    """Return a sentence that compares the number of pictures in a recording with the number of pictures for a run.

    The sentence is empty if the rig does not use a recording in place of a camera. Raises InputError if the
    recording is too short.
    """
    available = recording_length(str(rig.camera.source)) if rig.camera.driver == PLAYER else None
    if available is None:
        return ""
    rule, states = rig.camera.playback, len(protocol.currents_A)
    if rule.picture_a_state:
        needed, usage = states, f"uses {states} pictures, one for each state"
    else:
        needed = NOISE_FRAMES + states * (protocol.settle.pairs + 1 + protocol.frames_per_state)
        usage = f"uses at least {needed} pictures, and more while it waits for the beam to settle"
    sentence = f"camera.source = {rig.camera.source!r} has {available} pictures; the run {usage}"
    if available >= needed:
        return sentence
    if not rule.loop:
        alternative = "" if rule.picture_a_state else "picture_a_state = true to use one picture for each state, or "
        raise InputError(
            f"rig {rig.name}: {sentence}; set {alternative}loop = true to start again after the last picture, in "
            "[camera] playback"
        )
    return f"{sentence}; the recording starts again after its last picture"

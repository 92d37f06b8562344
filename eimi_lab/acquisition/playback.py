"""Pictures that play the camera: one for each state, or all of them as fast as they are asked for; over and over."""

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
"""A picture that is held is handed out no faster than a camera would."""

NOISE_FRAMES = 8
"""Taken of the beam at rest before the run."""


@dataclass
class Cue:
    """Tells a camera that plays pictures which state the run is at."""

    state: int = 0


class PlayedCamera:
    """A camera whose recording is played as `rule` says. Frames are numbered anew."""

    def __init__(self, open_it: Callable[[], Camera], rule: Playback, cue: Cue) -> None:
        """open_it: opens the recording at its beginning. Raises what it raises."""
        self._open_it, self._rule, self._cue = open_it, rule, cue
        self._camera = open_it()
        self.settings = settings_of(self._camera)
        self._number = self._pictures = 0
        self._held: Frame | None = None

    def identify(self) -> Identity:
        """See `Camera.identify`."""
        return self._camera.identify()

    def flush(self) -> None:
        """A recording waits."""

    def grab(self, timeout_s: float) -> Frame:
        """See `Camera.grab`. Raises EndOfPlayback, unless it begins again."""
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
        """See `Camera.close`."""
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
    """How many pictures a recording has and a run takes, in words; empty for a camera that is none.

    Raises InputError where they are too few.
    """
    there = recording_length(str(rig.camera.source)) if rig.camera.driver == PLAYER else None
    if there is None:
        return ""
    rule, states = rig.camera.playback, len(protocol.currents_A)
    if rule.picture_a_state:
        needed, words = states, f"shows {states}, one a state"
    else:
        needed = NOISE_FRAMES + states * (protocol.settle.pairs + 1 + protocol.frames_per_state)
        words = f"takes at least {needed}, and as many more as it asks for while the beam settles"
    said = f"camera.source = {rig.camera.source!r} has {there} pictures; the run {words}"
    if there >= needed:
        return said
    if not rule.loop:
        more = "" if rule.picture_a_state else "picture_a_state = true holds one for each state, "
        raise InputError(f"rig {rig.name}: {said}: [camera] playback has {more}loop = true begins again")
    return f"{said}; it begins again after the last"

"""Check recorded motions of the beam for lost frames, and for a camera slower than the protocol requires."""

from __future__ import annotations

from collections.abc import Sequence

from eimi_fitting.time.measured import Motion
from eimi_lab.vision.check import Check, Severity

LOST = Check(
    name="RING_DOWN_LOST",
    finding="lost_frames",
    quantity="number of frames that the camera took during a recording but that did not arrive",
    limit=0.0,
    remedy="Reduce the frame rate or the region of the camera, or disconnect other devices from the bus of the camera. "
    "For a phone, add light or film at a lower frame rate.",
    severity=Severity.NOTE,
)
SLOW = Check(
    name="RING_DOWN_SLOW",
    finding="rate_share",
    quantity="frames per second of a ring-down, divided by ring_down.rate_Hz of the protocol",
    limit=0.95,
    below=True,
    remedy="Increase frame_rate_Hz in [camera] of the rig file, with an exposure that allows this rate.",
    severity=Severity.NOTE,
)


def flag_names(motion: Motion) -> tuple[str, ...]:
    """Return the flag for lost frames if frames of a recorded motion were lost; otherwise an empty tuple."""
    return (LOST.name,) if motion.lost_frames else ()


def flagged_lines(motions: Sequence[Motion]) -> list[str]:
    """Return a line of text for each recorded motion in which frames were lost.

    Examples
    --------
    >>> flagged_lines([])
    []
    """
    return [
        f"{motion.label}: {motion.lost_frames} of {motion.lost_frames + len(motion.time_s)} frames were lost "
        f"({', '.join(flag_names(motion))}); the times of the other frames are correct"
        for motion in motions
        if flag_names(motion)
    ]


def recordings_in_words(motions: Sequence[Motion]) -> str:
    """Return a text with the number of recorded motions, of their frames, and of the lost frames.

    Examples
    --------
    >>> recordings_in_words([])
    '0 recordings with 0 frames'
    """
    frames = sum(len(motion.time_s) for motion in motions)
    lost = sum(motion.lost_frames for motion in motions)
    several = "s" if len(motions) != 1 else ""
    return f"{len(motions)} recording{several} with {frames} frames" + (f"; {lost} lost ({LOST.name})" if lost else "")

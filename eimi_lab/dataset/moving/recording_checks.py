"""Checks of recorded motions: frames that were lost, and a camera slower than was asked for."""

from __future__ import annotations

from collections.abc import Sequence

from eimi_fitting.time.measured import Motion
from eimi_lab.vision.check import Check, Severity

LOST = Check(
    name="RING_DOWN_LOST",
    finding="lost_frames",
    quantity="number of frames of a recording that were taken and did not arrive",
    limit=0.0,
    remedy="Lower the frame rate or the region of the camera, or remove other devices from its bus. "
    "For a phone, add light or film at a lower frame rate.",
    severity=Severity.NOTE,
)
SLOW = Check(
    name="RING_DOWN_SLOW",
    finding="rate_share",
    quantity="frames per second of a ring-down, as a share of ring_down.rate_Hz",
    limit=0.95,
    below=True,
    remedy="Set frame_rate_Hz in [camera] of the rig, and an exposure that allows it.",
    severity=Severity.NOTE,
)


def flag_names(motion: Motion) -> tuple[str, ...]:
    """Return the names of the flags of a recording."""
    return (LOST.name,) if motion.lost_frames else ()


def flagged_lines(motions: Sequence[Motion]) -> list[str]:
    """Return a line for each recording with a flag: its name, the count, and the flag.

    Examples
    --------
    >>> flagged_lines([])
    []
    """
    return [
        f"{motion.label}: {motion.lost_frames} of {motion.lost_frames + len(motion.time_s)} frames were lost "
        f"({', '.join(flag_names(motion))}); the times of the others are right"
        for motion in motions
        if flag_names(motion)
    ]


def recordings_in_words(motions: Sequence[Motion]) -> str:
    """Return the number of recordings, of their frames, and of the frames that were lost.

    Examples
    --------
    >>> recordings_in_words([])
    '0 recordings with 0 frames'
    """
    frames = sum(len(motion.time_s) for motion in motions)
    lost = sum(motion.lost_frames for motion in motions)
    several = "s" if len(motions) != 1 else ""
    return f"{len(motions)} recording{several} with {frames} frames" + (f"; {lost} lost ({LOST.name})" if lost else "")

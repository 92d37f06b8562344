"""Render films of a horizontal silicone strip that vibrates, with the shutter and the perspective of a phone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from eimi_lab.config.calibration import Calibration
from eimi_lab.config.simulated_optics import Optics
from eimi_lab.config.specimen import Beam, SpecimenFile
from eimi_lab.dataset.moving.beam_modes import cantilever_modes
from eimi_lab.virtual.optics import expose, make_scene
from eimi_lab.vision.beam_frame import BeamFrame

Array = NDArray[np.float64]

STRIP = SpecimenFile(
    specimen=Beam(name="strip", material="silicone", length_mm=40.0, width_mm=3.0, depth_mm=10.0, density_kg_m3=1070.0)
)
LEVEL = Calibration(
    pixels_per_mm=10.0,
    coil_constant_mT_per_A=1.0,
    clamp_midpoint_px=(60.0, 150.0),
    axis_angle_deg=0.0,
    gravity_angle_deg=90.0,
    field_angle_deg=90.0,
)


@dataclass(frozen=True)
class Flick:
    """A silicone strip that vibrates in its first mode about its sagged shape, and the camera.

    row_time_s : time between the readout of two rows of pixels
    tilt : relative change of the scale from the left to the right side of the picture
    size : width and height of the film (px)
    """

    frequency_Hz: float = 6.0
    decay_per_s: float = 1.2
    amplitude_mm: float = 4.0
    sag_mm: float = 2.0
    rate_Hz: float = 120.0
    seconds: float = 1.0
    size: tuple[int, int] = (560, 360)
    exposure_s: float = 0.0
    row_time_s: float = 0.0
    tilt: float = 0.0
    optics: Optics = field(default_factory=lambda: replace(Optics(), vignette=0.1, gradient=0.1))

    @property
    def times_s(self) -> Array:
        """Time (s) of each frame: the middle of the exposure of its first row."""
        return np.arange(round(self.seconds * self.rate_Hz)) / self.rate_Hz

    def deflection_mm(self, time_s: Array) -> Array:
        """Return the downward deflection (mm) of the tip from its sagged position at the times `time_s`."""
        return self.amplitude_mm * np.exp(-self.decay_per_s * time_s) * np.cos(2 * np.pi * self.frequency_Hz * time_s)

    def centre_mm(self, along_mm: Array, time_s: float) -> Array:
        """Return p points (x, y) of the centre line in mm, shape (p, 2), at one time.

        along_mm : distance of each point from the clamp along the line, shape (p,)
        """
        grid = np.linspace(0.0, STRIP.specimen.length_mm, 400)
        tip = self.sag_mm + float(self.deflection_mm(np.array(time_s)))
        slope = np.gradient(tip * cantilever_modes(grid / grid[-1])[:, 0], grid)
        steps = np.column_stack([np.cos(slope), np.sin(slope)]) * grid[1]
        places = np.concatenate([np.zeros((1, 2)), np.cumsum(0.5 * (steps[1:] + steps[:-1]), axis=0)])
        return np.column_stack([np.interp(along_mm, grid, places[:, axis]) for axis in range(2)])

    def to_px(self, points_mm: Array) -> Array:
        """Return the pixels (x, y), shape (n, 2), of n points of the beam in mm."""
        points = BeamFrame(LEVEL).to_px(points_mm)
        middle = 0.5 * np.array(self.size)
        away = (points - middle) / self.size[0]
        return np.asarray(middle + (points - middle) / (1.0 + self.tilt * (away[:, :1] + 0.5 * away[:, 1:])))

    def outline_px(self, first_row_s: float) -> Array:
        """Return the outline of the beam in one frame with a rolling shutter: n points (x, y) in px, shape (n, 2).

        first_row_s : time at which the first row is exposed
        """
        readout_s = self.row_time_s * (self.size[1] - 1)
        if not readout_s:
            return self._outline_px_at(first_row_s)
        delays = np.linspace(0.0, readout_s, 9)
        outlines = np.stack([self._outline_px_at(first_row_s + delay) for delay in delays])
        row = outlines[0, :, 1]
        for _ in range(4):
            at = np.clip(row * self.row_time_s / delays[1], 0.0, len(delays) - 1.001)
            low, share = at.astype(int), at % 1.0
            points = np.arange(outlines.shape[1])
            shown = outlines[low, points] * (1 - share)[:, None] + outlines[low + 1, points] * share[:, None]
            row = shown[:, 1]
        return np.asarray(shown)

    def _outline_px_at(self, time_s: float) -> Array:
        along = np.linspace(0.0, STRIP.specimen.length_mm, 80)
        centre = self.centre_mm(along, time_s)
        tangent = np.gradient(centre, axis=0)
        tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
        normal = np.column_stack([-tangent[:, 1], tangent[:, 0]]) * 0.5 * float(STRIP.specimen.width_mm)
        left, right = centre - normal, centre + normal
        return self.to_px(np.vstack([[[-6.0, -1.5]], left, right[::-1], [[-6.0, 1.5]]]))

    def frames(self, seed: int = 0) -> Iterator[NDArray[np.uint8]]:
        """Yield the frames with noise, shape (height, width)."""
        rng = np.random.default_rng(seed)
        clamp_px = self.to_px(np.array([[-6.0, -8.0], [0.0, -8.0], [0.0, 8.0], [-6.0, 8.0]]))
        within_s = self.exposure_s * (np.arange(6) / 6.0 - 5.0 / 12.0) if self.exposure_s else np.zeros(1)
        for start_s in self.times_s:
            scenes = [
                make_scene(self.optics, self.size, self.outline_px(start_s + t), None, clamp_px) for t in within_s
            ]
            mean = np.mean([scene.mean for scene in scenes], axis=0, dtype=np.float32)
            yield expose(replace(scenes[0], mean=mean), rng)

    def write(self, path: Path, seed: int = 0, quality: str = "FFV1") -> Path:
        """Write the film as a video file with the codec `quality` (FFV1 is lossless), and return `path`."""
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*quality), self.rate_Hz, self.size)
        for frame in self.frames(seed):
            writer.write(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
        writer.release()
        return path

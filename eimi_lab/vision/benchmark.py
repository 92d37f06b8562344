"""Error of the edges on rendered beams of known shape: ``python -m eimi_lab.vision.benchmark``.

A beam is a circular arc with a straight magnet block at its end, so that its outline is known exactly.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from eimi_lab.config.calibration import Calibration
from eimi_lab.config.specimen import Beam, Magnet, SpecimenFile
from eimi_lab.virtual.optics import Optics, Scene, expose, make_scene
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edge_set import EdgeSet
from eimi_lab.vision.edges import find_edges

Array = NDArray[np.float64]

SIZE = (1280, 1024)
CALIBRATION = Calibration(
    pixels_per_mm=25.0,
    coil_constant_mT_per_A=4.7,
    clamp_midpoint_px=(640.3, 99.6),
    axis_angle_deg=90.0,
    gravity_angle_deg=90.0,
    field_angle_deg=0.0,
)
SPECIMEN = SpecimenFile(
    specimen=Beam(
        name="benchmark",
        material="silicone",
        length_mm=30.0,
        width_mm=3.0,
        depth_mm=5.0,
        density_kg_m3=1070.0,
        section="plane-stress",
    ),
    magnet=Magnet(length_mm=4.0, width_mm=3.0, depth_mm=3.0, remanence_T=1.3, density_kg_m3=7500.0),
)
NOMINAL = Optics()
CONDITIONS = {
    "nominal": NOMINAL,
    "hard": replace(NOMINAL, blur_px=1.5, full_well_e=2500.0, gradient=0.25, lumps=0.08, silicone_transmission=0.15),
    "defocused": replace(NOMINAL, blur_px=3.0),
}
ANGLES_DEG = (-75.0, -40.0, -10.0, 0.0, 3.0, 20.0, 55.0, 75.0, 90.0)


@dataclass(frozen=True)
class BentBeam:
    """A beam bent to a tip angle (positive toward +y), its outline in the beam frame in millimetres.

    left, right: (n, 2) dense points of the edges from the clamp to the tip. magnet: (4, 2) or None.
    """

    left: Array
    right: Array
    magnet: Array | None

    @property
    def outline(self) -> Array:
        return np.vstack([self.left, self.right[::-1]])


def bend(specimen_file: SpecimenFile, tip_angle_deg: float, points_per_mm: float = 50.0) -> BentBeam:
    """The flexible part as a circular arc of its own length, then the magnet's block straight on."""
    mechanics = specimen_file.mechanics()
    flexible, half = mechanics.flexible_length_mm, 0.5 * mechanics.width_mm
    place = np.linspace(0.0, mechanics.length_mm, max(8, round(points_per_mm * mechanics.length_mm)))
    curvature = math.radians(tip_angle_deg) / flexible
    arc = np.minimum(place, flexible)
    angle = curvature * arc
    # sin(a)/a forms of the arc's coordinates hold for a straight beam too
    x = arc * np.sinc(angle / np.pi) + (place - arc) * np.cos(angle)
    y = arc * np.sinc(0.5 * angle / np.pi) * np.sin(0.5 * angle) + (place - arc) * np.sin(angle)
    centre, across = np.column_stack([x, y]), np.column_stack([-np.sin(angle), np.cos(angle)])
    magnet = None
    if mechanics.magnet is not None:
        begin, direction = centre[-1], np.array([np.cos(angle[-1]), np.sin(angle[-1])])
        begin = begin - direction * mechanics.magnet.length_mm
        aside = 0.5 * mechanics.magnet.width_mm * across[-1]
        magnet = np.array([begin - aside, centre[-1] - aside, centre[-1] + aside, begin + aside])
    return BentBeam(centre - half * across, centre + half * across, magnet)


def make_bent_scene(
    optics: Optics,
    calibration: Calibration,
    specimen_file: SpecimenFile,
    beam: BentBeam,
    size: tuple[int, int] = SIZE,
) -> Scene:
    """A scene with the beam and a clamp four times as wide, whose lower edge is at x = 0.

    Oversampled, so that the renderer's own error does not count as the search's.
    """
    frame = BeamFrame(calibration)
    wide, high = 2.0 * specimen_file.specimen.width_mm, 0.5 * specimen_file.specimen.length_mm
    clamp = frame.to_px([[0.0, -wide], [0.0, wide], [-high, wide], [-high, -wide]])
    magnet = None if beam.magnet is None else frame.to_px(beam.magnet)
    return make_scene(optics, size, frame.to_px(beam.outline), magnet, clamp, oversampling=2)


def outward_errors_mm(points_mm: Array, edge_mm: Array, outward: float) -> Array:
    """Signed distances (n,) of points from a dense edge; outward: +1 where outside is toward +y of its run."""
    tangent = np.gradient(edge_mm, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    nearest = cKDTree(edge_mm).query(points_mm)[1]
    gap, along = points_mm - edge_mm[nearest], tangent[nearest]
    return outward * (along[:, 0] * gap[:, 1] - along[:, 1] * gap[:, 0])


def errors_px(edges: EdgeSet, beam: BentBeam, calibration: Calibration) -> tuple[Array, Array]:
    """Signed errors of the left and right points along the normal, outward positive, in pixels."""
    left = outward_errors_mm(edges.left.points_mm, beam.left, -1.0)
    right = outward_errors_mm(edges.right.points_mm, beam.right, 1.0)
    return left * calibration.pixels_per_mm, right * calibration.pixels_per_mm


def measure(optics: Optics, angles_deg: tuple[float, ...], frames: int, seed: int) -> list[dict[str, Any]]:
    """Bias, RMS and time for each angle, over several frames of it."""
    rng = np.random.default_rng(seed)
    rows = []
    for angle in angles_deg:
        beam = bend(SPECIMEN, angle)
        scene = make_bent_scene(optics, CALIBRATION, SPECIMEN, beam)
        left: list[Array] = []
        right: list[Array] = []
        pulls: list[Array] = []
        flags: set[str] = set()
        seconds: list[float] = []
        for _ in range(frames):
            image = expose(scene, rng)
            begin = time.process_time()
            edges = find_edges(image, CALIBRATION, SPECIMEN)
            seconds.append(time.process_time() - begin)
            errors = errors_px(edges, beam, CALIBRATION)
            left.append(errors[0])
            right.append(errors[1])
            for error, side in zip(errors, (edges.left, edges.right), strict=True):
                pulls.append(error / (side.sigma_mm * CALIBRATION.pixels_per_mm))
            flags |= {flag.name for flag in edges.flags}
        lefts, rights = np.concatenate(left), np.concatenate(right)
        rows.append(
            {
                "angle": angle,
                "points": len(lefts) // frames,
                "left_bias": lefts.mean(),
                "right_bias": rights.mean(),
                "left_rms": np.sqrt((lefts**2).mean()),
                "right_rms": np.sqrt((rights**2).mean()),
                "worst": np.abs(np.concatenate([lefts, rights])).max(),
                "pull": np.sqrt((np.concatenate(pulls) ** 2).mean()),
                "ms": 1e3 * float(np.median(seconds)),
                "flags": " ".join(sorted(flags)),
            }
        )
    return rows


def main() -> None:
    cv2.setNumThreads(1)
    print("error along the normal, outward positive, px; pull: RMS of error over stated standard deviation")
    print("condition   tip deg  points  bias left  right    RMS left  right    worst  pull  ms  flags")
    for name, optics in CONDITIONS.items():
        for row in measure(optics, ANGLES_DEG, frames=3, seed=1):
            print(
                f"{name:10s} {row['angle']:8.0f} {row['points']:7d} "
                f"{row['left_bias']:+10.4f} {row['right_bias']:+.4f} "
                f"{row['left_rms']:9.4f} {row['right_rms']:.4f} "
                f"{row['worst']:8.3f} {row['pull']:5.2f} {row['ms']:3.0f}  {row['flags']}"
            )


if __name__ == "__main__":
    main()

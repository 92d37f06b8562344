"""Render frames of beams of known shape, and measure the errors of the edges that are detected in them."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from eimi_lab.config.calibration import Calibration
from eimi_lab.config.simulated_optics import Optics
from eimi_lab.config.specimen import Beam, Magnet, SpecimenFile
from eimi_lab.virtual.optics import Scene, expose, make_scene
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edges.edge_set import EdgeSet
from eimi_lab.vision.edges.finding import find_edges

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
# Optics, width (px) of the silicone beside a magnet that is narrower than the beam, and displacement of the magnet from
# the middle as a share of this width.
BESIDE = {
    "1 px beside the magnet": (NOMINAL, 1.0, 0.0),
    "3 px beside the magnet": (NOMINAL, 3.0, 0.0),
    "3 px, silicone 30 %": (replace(NOMINAL, silicone_transmission=0.3), 3.0, 0.0),
    "3 px, blur 3 px": (replace(NOMINAL, blur_px=3.0), 3.0, 0.0),
    "0.5 px, hard": (CONDITIONS["hard"], 0.5, 0.0),
    "0.5 px, hard, magnet off the middle by 0.7 of it": (CONDITIONS["hard"], 0.5, -0.7),
    "0.5 px, hard, 40 000 electrons": (replace(CONDITIONS["hard"], full_well_e=40_000.0), 0.5, 0.0),
}
POINTS_PER_MM = 50.0
NEAR_MM = 0.12  # largest distance from an edge at which a point of another method counts
END_MM = 1.0  # length that does not count at each end, where clamp and corners disturb the edge


@dataclass(frozen=True)
class BentBeam:
    """The outline of a bent beam in the beam frame in mm.

    left, right : n points of each edge from the clamp to the tip, shape (n, 2)
    magnet : four corners of the magnet, shape (4, 2); None without a magnet
    """

    left: Array
    right: Array
    magnet: Array | None

    @property
    def outline(self) -> Array:
        return np.vstack([self.left, self.right[::-1]])


def bend(specimen_file: SpecimenFile, tip_angle_deg: float, points_per_mm: float = POINTS_PER_MM) -> BentBeam:
    """Return the outline of a beam that is a circular arc, with a straight magnet at its end."""
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
    """Return a scene to render: a beam that hangs at x = 0 of the beam frame from a wider clamp."""
    frame = BeamFrame(calibration)
    wide, high = 2.0 * specimen_file.specimen.width_mm, 0.5 * specimen_file.specimen.length_mm
    clamp = frame.to_px([[0.0, -wide], [0.0, wide], [-high, wide], [-high, -wide]])
    magnet = None if beam.magnet is None else frame.to_px(beam.magnet)
    return make_scene(optics, size, frame.to_px(beam.outline), magnet, clamp, oversampling=2)


def outward_errors_mm(points_mm: Array, edge_mm: Array, outward: float) -> Array:
    """Return the signed distances (mm), shape (n,), of n points from an edge.

    edge_mm : points (x, y) of the true edge
    outward : +1 or -1, the side of the beam (+y or -y) on which the edge lies
    """
    tangent = np.gradient(edge_mm, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    nearest = cKDTree(edge_mm).query(points_mm)[1]
    gap, along = points_mm - edge_mm[nearest], tangent[nearest]
    return outward * (along[:, 0] * gap[:, 1] - along[:, 1] * gap[:, 0])


def errors_px(edges: EdgeSet, beam: BentBeam, calibration: Calibration) -> tuple[Array, Array]:
    """Return the errors (px) of the left and right points normal to the true edge, positive outward."""
    left = outward_errors_mm(edges.left.points_mm, beam.left, -1.0)
    right = outward_errors_mm(edges.right.points_mm, beam.right, 1.0)
    return left * calibration.pixels_per_mm, right * calibration.pixels_per_mm


def with_silicone_beside(magnet_px: float) -> SpecimenFile:
    """Return a specimen with a magnet that is narrower than the beam by `magnet_px` on each side."""
    assert SPECIMEN.magnet is not None
    width_mm = SPECIMEN.specimen.width_mm - 2.0 * magnet_px / CALIBRATION.pixels_per_mm
    return SpecimenFile(specimen=SPECIMEN.specimen, magnet=SPECIMEN.magnet.model_copy(update={"width_mm": width_mm}))


def off_middle(beam: BentBeam, distance_mm: float) -> BentBeam:
    """Return the beam with its magnet displaced toward the right edge."""
    assert beam.magnet is not None
    across = beam.magnet[3] - beam.magnet[0]
    return replace(beam, magnet=beam.magnet + distance_mm * across / np.linalg.norm(across))


def measure(
    optics: Optics,
    angles_deg: tuple[float, ...],
    frames: int,
    seed: int,
    specimen: SpecimenFile = SPECIMEN,
    off_middle_mm: float = 0.0,
    from_tip_mm: float = math.inf,
) -> list[dict[str, Any]]:
    """Render frames at each tip angle and search their edges; return bias, RMS error (px) and time (ms) for each angle.

    off_middle_mm : displacement of the magnet toward the right edge
    from_tip_mm : largest distance of evaluated points from the tip
    """
    rng = np.random.default_rng(seed)
    rows = []
    for angle in angles_deg:
        beam = off_middle(bend(specimen, angle), off_middle_mm)
        scene = make_bent_scene(optics, CALIBRATION, specimen, beam)
        left: list[Array] = []
        right: list[Array] = []
        pulls: list[Array] = []
        flags: set[str] = set()
        seconds: list[float] = []
        for _ in range(frames):
            image = expose(scene, rng)
            begin = time.process_time()
            edges = find_edges(image, CALIBRATION, specimen)
            seconds.append(time.process_time() - begin)
            sides = zip(
                errors_px(edges, beam, CALIBRATION), (edges.left, edges.right), (beam.left, beam.right), strict=True
            )
            for errors, (error, side, edge) in zip((left, right), sides, strict=True):
                near = np.linalg.norm(side.points_mm - edge[-1], axis=1) < from_tip_mm
                errors.append(error[near])
                pulls.append(error[near] / (side.sigma_mm[near] * CALIBRATION.pixels_per_mm))
            flags |= {flag.name for flag in edges.flags}
        lefts, rights = np.concatenate(left), np.concatenate(right)
        rows.append(
            {
                "angle": angle,
                "points": len(lefts) // frames,
                "left_bias": _mean(lefts),
                "right_bias": _mean(rights),
                "left_rms": math.sqrt(_mean(lefts**2)),
                "right_rms": math.sqrt(_mean(rights**2)),
                "worst": np.abs(np.concatenate([lefts, rights])).max(),
                "pull": np.sqrt((np.concatenate(pulls) ** 2).mean()),
                "ms": 1e3 * float(np.median(seconds)),
                "flags": " ".join(sorted(flags)),
            }
        )
    return rows


def _mean(values: Array) -> float:
    """Return the mean of the values; NaN if there are no values."""
    return float(values.mean()) if len(values) else math.nan


def overall(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Summarise the rows of `measure`: errors (px), time (ms), and pull (errors divided by uncertainties)."""
    summary = {name: float(np.nanmean([row[name] for row in rows])) for name in ("left_bias", "right_bias", "ms")}
    for name in ("left_rms", "right_rms", "pull"):
        summary[name] = float(np.sqrt(np.nanmean([row[name] ** 2 for row in rows])))
    pulls = [float(row["pull"]) for row in rows]
    return summary | {
        "worst": max(float(row["worst"]) for row in rows),
        "least_pull": min(pulls),
        "largest_pull": max(pulls),
    }


def measure_other(
    method: Callable[[NDArray[Any]], Array], optics: Optics, angles_deg: tuple[float, ...], seed: int
) -> dict[str, float]:
    """Return bias and RMS error (px) of each side, and the time (ms), of another method of edge detection."""
    rng = np.random.default_rng(seed)
    frame, ppm = BeamFrame(CALIBRATION), CALIBRATION.pixels_per_mm
    errors: dict[str, list[Array]] = {"left": [], "right": []}
    seconds = []
    for angle in angles_deg:
        beam = bend(SPECIMEN, angle)
        image = expose(make_bent_scene(optics, CALIBRATION, SPECIMEN, beam), rng)
        begin = time.process_time()
        points = method(image)
        seconds.append(time.process_time() - begin)
        places = frame.to_mm(points)
        for side, edge, outward in (("left", beam.left, -1.0), ("right", beam.right, 1.0)):
            distance, nearest = cKDTree(edge).query(places)
            counted = (distance < NEAR_MM) & (nearest > END_MM * POINTS_PER_MM)
            counted &= nearest < len(edge) - END_MM * POINTS_PER_MM
            errors[side].append(ppm * outward_errors_mm(places[counted], edge, outward))
    left, right = (np.concatenate(errors[side]) for side in ("left", "right"))
    return {
        "left_bias": float(left.mean()),
        "right_bias": float(right.mean()),
        "left_rms": float(np.sqrt((left**2).mean())),
        "right_rms": float(np.sqrt((right**2).mean())),
        "ms": 1e3 * float(np.median(seconds)),
    }

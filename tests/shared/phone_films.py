"""Simulate phone videos of a vibrating silicone strip with a known viscoelastic law."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.beside import SolidBeside, SolidOptions
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.path import candidates
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.beam.vibration import Vibration
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.prony import Prony
from tests.shared.mp4_boxes import state_capture_rate, state_times, state_turn
from tests.shared.phone_photographs import (
    CLAMP_COLOUR,
    DIAGONAL_35MM,
    MESH,
    BentBody,
    PhoneScene,
    clamp,
    colours,
    cover,
    paint,
    paint_ruler,
    silhouette,
    wall,
)

Array = NDArray[np.float64]
SIZE = (1280, 720)
_STATIONS = 60  # number of points along the centre line
_NOISES = 6
_SKIN = np.array([120.0, 150.0, 205.0])
_PUSH_S, _STAY_S = 0.20, 0.25  # duration of the push, and time for which the finger stays visible after it


@dataclass(frozen=True)
class HiddenStrip:
    """A silicone strip with its viscoelastic law, and its small vibrations about the shape at rest.

    Attributes
    ----------
    specimen : Specimen
        True dimensions.
    instantaneous_Pa : float
        Instantaneous shear modulus.
    series : Prony
        The Prony series of the material.
    rest_rad : ndarray, shape (_STATIONS,)
        Direction of the centre line at rest.
    first_rad, second_rad : ndarray, shape (_STATIONS,)
        Change of this direction in the first and second mode, for each mm of deflection at the tip.
    rates : tuple of complex
        Minus the decay rate plus i times the angular frequency (1/s) of both modes.
    """

    specimen: Specimen
    instantaneous_Pa: float
    series: Prony
    rest_rad: Array
    first_rad: Array
    second_rad: Array
    rates: tuple[complex, complex]

    @property
    def frequency_Hz(self) -> float:
        return self.rates[0].imag / (2 * np.pi)

    @property
    def dynamic_Pa(self) -> float:
        """Storage modulus (Pa) at the frequency of the first mode."""
        return self.instantaneous_Pa * float(self.series.complex_ratio(np.array(2j * np.pi * self.frequency_Hz)).real)

    @property
    def loss_factor(self) -> float:
        return float(self.series.loss_factor(2 * np.pi * self.frequency_Hz))


@dataclass(frozen=True)
class PhoneFilm:
    # A phone video of a vibrating silicone strip.
    # scene : PhoneScene
    #     Camera, colours, clamp and ruler.
    # strip : HiddenStrip
    #     The strip in the video.
    # rate_Hz : float
    #     Frame rate.
    # seconds : float
    #     Duration.
    # flicks_mm : tuple of float
    #     Amplitude of each flick at the tip.
    # released_s : tuple of float
    #     Time of each release of the tip.
    # exposure_s : float
    #     Exposure of each frame.
    # row_time_s : float
    #     Time between the exposures of neighbouring rows of pixels.
    # shake_px : float
    #     Standard deviation of the motion of the phone.
    # drift_px : float
    #     Downward motion of the picture during the video.
    # lost : float
    #     Share of lost frames.
    # played_Hz : float or None
    #     Frame rate of a slow-motion display; None without slow motion.
    # is_stated : bool
    #     Whether a slow-motion file contains the true frame rate.
    # turn_deg : int
    #     Clockwise rotation of the display: 0, 90, 180 or 270.
    # finger : bool
    #     Whether the finger is drawn.
    # quality : int
    #     JPEG quality (0 to 100) of the frames before the video is encoded.

    scene: PhoneScene
    strip: HiddenStrip
    rate_Hz: float = 240.0
    seconds: float = 2.4
    flicks_mm: tuple[float, ...] = (4.0,)
    released_s: tuple[float, ...] = (0.4,)
    exposure_s: float = 1 / 500
    row_time_s: float = 5e-6
    shake_px: float = 0.0
    drift_px: float = 0.0
    lost: float = 0.0
    played_Hz: float | None = None
    is_stated: bool = True
    turn_deg: int = 0
    finger: bool = True
    quality: int = 70
    seed: int = 0

    @cached_property
    def times_s(self) -> Array:
        """Time (s) at which the first row of each stored frame is exposed."""
        times = np.arange(round(self.seconds * self.rate_Hz)) / self.rate_Hz
        kept = np.random.default_rng([self.seed, 3]).random(len(times)) >= self.lost
        kept[0] = True
        return times[kept]

    @property
    def _along_mm(self) -> Array:
        return np.linspace(0.0, self.strip.specimen.length_mm, _STATIONS)

    def deflections_mm(self, time_s: float) -> tuple[float, float]:
        """Return the downward deflections (mm) of the tip in the first and second mode at one time."""
        first = second = 0.0
        for size, released_s in zip(self.flicks_mm, self.released_s, strict=True):
            since = time_s - released_s
            following = [at for at in self.released_s if at > released_s]
            if following and time_s > following[0] - _PUSH_S:
                continue
            if -_PUSH_S < since <= 0:
                first += size * 0.5 * (1 - np.cos(np.pi * (since / _PUSH_S + 1)))
            elif since > 0:
                one, two = self.strip.rates
                first += size * ((0.97 * np.exp(one * since)).real + 0.03 * np.exp(-since / 0.5))
                second += 0.05 * size * float(np.exp(two * since).real)
        return first, second

    def body(self, time_s: float) -> BentBody:
        """Return the surface of the vibrating beam at one time in the world frame (right, down, away)."""
        first, second = self.deflections_mm(time_s)
        slope = self.strip.rest_rad + first * self.strip.first_rad + second * self.strip.second_rad
        step = self._along_mm[1]
        directions = np.column_stack([np.cos(slope), np.sin(slope)])
        middle = np.vstack([np.zeros((1, 2)), np.cumsum(0.5 * (directions[1:] + directions[:-1]) * step, axis=0)])
        half = 0.5 * float(self.strip.specimen.width_mm) * np.column_stack([-directions[:, 1], directions[:, 0]])
        side = np.vstack([middle - half, (middle + half)[::-1]])
        depth = 0.5 * self.strip.specimen.depth_mm
        faces = [np.column_stack([side, np.full(len(side), z)]) for z in (-depth, depth)]
        return BentBody(self.scene.in_world(np.stack(faces)))

    @property
    def at_rest(self) -> BentBody:
        """The surface of the beam at rest in the world frame (right, down, away)."""
        return self.body(1e6)

    def seen(self, first_row_s: float) -> list[Array]:
        """Return the polygons of the beam in one frame, with n corners (x, y) in px, shape (n, 2).

        The first polygon is the face toward the camera.
        first_row_s : time of the first row
        """
        begin = self.scene.to_px(self.body(first_row_s).around)
        rows = np.array([begin[..., 1].min() - 80, begin[..., 1].max() + 80])
        early, late = (self.scene.to_px(self.body(first_row_s + row * self.row_time_s).around) for row in rows)
        share = np.clip((early[..., 1:] - rows[0]) / np.ptp(rows), 0.0, 1.0)
        layers = early + share * (late - early)
        near, far = layers
        sides = [np.array([a, b, d, c]) for a, b, c, d in zip(near[:-1], near[1:], far[:-1], far[1:], strict=True)]
        return [near, far, *sides]

    @cached_property
    def _behind(self) -> tuple[NDArray[np.float32], Array, NDArray[np.float32]]:
        """The picture without the beam, the colour of the beam, and the mask of the front of the clamp."""
        rng = np.random.default_rng([self.scene.seed, 7])
        behind, beam = colours(rng)
        picture = wall(self.scene, behind, rng)
        holder = BentBody(clamp(self.scene))
        paint(picture, silhouette(self.scene, holder), 0.8 * CLAMP_COLOUR)
        paint_ruler(self.scene, picture)
        mask = np.zeros(picture.shape[:2], np.float32)
        cover(mask, [self.scene.to_px(holder.around[0])], 1.0)
        return picture, beam, mask

    def frames(self) -> Iterator[NDArray[np.uint8]]:
        """Yield the stored frames, each of shape (height, width, 3)."""
        behind, beam, holder = self._behind
        rng = np.random.default_rng([self.scene.seed, 9, self.seed])
        within_s = self.exposure_s * (np.arange(4) / 4 - 3 / 8) if self.exposure_s else np.zeros(1)
        noises = rng.standard_normal((_NOISES, *behind.shape), dtype=np.float32)
        noises *= 1.2 + 0.08 * np.sqrt(behind)
        unmoved = [np.clip(np.rint(behind + noise), 0, 255).astype(np.uint8) for noise in noises]
        shakes = self._shakes_px()
        for number, time_s in enumerate(self.times_s):
            drawn = [self.seen(time_s + offset_s) for offset_s in within_s]
            shown = self._changed_part(drawn, float(time_s))
            part, corner = behind[shown].copy(), np.array([shown[1].start, shown[0].start])
            for colour, first in ((0.86 * beam, None), (beam, 1)):
                total = np.zeros(part.shape[:2], np.float32)
                for polygons in drawn:
                    mask = np.zeros_like(total)
                    cover(mask, [polygon - corner for polygon in polygons[:first]], 1.0 / len(within_s))
                    total += mask
                part += total[..., None] * (colour.astype(np.float32) - part)
            if self._shows_finger(float(time_s)):
                self._point(part, float(time_s))  # the whole picture has changed, so that its corner is at the origin
            part += holder[shown][..., None] * (CLAMP_COLOUR.astype(np.float32) - part)
            chosen = int(rng.integers(_NOISES))
            part += np.roll(noises[chosen][shown], int(rng.integers(part.shape[1])), axis=1)
            exact = unmoved[chosen].copy()
            exact[shown] = np.clip(np.rint(part), 0, 255).astype(np.uint8)
            if self.shake_px or self.drift_px:
                x, y, turn = shakes[number]
                middle = 0.5 * np.array(self.scene.size)
                moved = cv2.getRotationMatrix2D(tuple(middle), float(turn), 1.0) + np.array([[0, 0, x], [0, 0, y]])
                exact = cv2.warpAffine(exact, moved, self.scene.size, borderMode=cv2.BORDER_REFLECT)
            stored = cv2.imencode(".jpg", exact, (cv2.IMWRITE_JPEG_QUALITY, self.quality))[1]
            yield np.asarray(cv2.imdecode(stored, cv2.IMREAD_COLOR), np.uint8)

    def _changed_part(self, drawn: list[list[Array]], time_s: float) -> tuple[slice, slice]:
        """Return the part of the picture to draw anew for a frame, as slices of rows and columns.

        drawn : polygons of the beam at several times of the exposure
        """
        if self._shows_finger(time_s):
            return slice(0, self.scene.size[1]), slice(0, self.scene.size[0])
        faces = np.vstack([face for polygons in drawn for face in polygons[:2]])
        limit = np.array(self.scene.size)
        first = np.clip(np.floor(faces.min(axis=0)).astype(int) - 4, 0, limit - 8)
        last = np.clip(np.ceil(faces.max(axis=0)).astype(int) + 5, first + 8, limit)
        return slice(int(first[1]), int(last[1])), slice(int(first[0]), int(last[0]))

    def _shows_finger(self, time_s: float) -> bool:
        return self.finger and any(-_PUSH_S - 0.3 < time_s - released_s < _STAY_S for released_s in self.released_s)

    def _point(self, picture: NDArray[np.float32], time_s: float) -> None:
        """Draw the finger that pushes the tip down and then goes away; change `picture` in place."""
        for released_s in self.released_s:
            since = time_s - released_s
            if not -_PUSH_S - 0.3 < since < _STAY_S:
                continue
            half = 0.5 * float(self.strip.specimen.width_mm)
            first, _ = self.deflections_mm(min(time_s, released_s - 1e-9))
            away = 60.0 * max(since, 0.0) + 60.0 * max(-_PUSH_S - since, 0.0)
            tip = self.body(released_s - _PUSH_S - 1e-6).around[0, _STATIONS - 1]
            end = tip + np.array([-2.0 + away, first - 0.3 * half - 5.0 - 0.5 * away, 0.0])
            finger = np.array([[-4, 5], [4, 5], [5, 0], [30, -60], [12, -60], [-5, 0]], float)
            paint(picture, [self.scene.to_px(np.column_stack([end[:2] + finger, np.full(6, end[2])]))], _SKIN)

    def _shakes_px(self) -> Array:
        """Return the motion of n frames, shape (n, 3): x and y in px, and a rotation in degrees."""
        rng, time = np.random.default_rng([self.seed, 4]), self.times_s
        motion = np.zeros((len(time), 3))
        for axis in range(3):
            for frequency in rng.uniform(0.3, 9.0, 8):
                size = 1.0 / (1.0 + frequency)
                motion[:, axis] += size * np.sin(2 * np.pi * (frequency * time + rng.random()))
        motion *= self.shake_px / max(float(motion[:, :2].std()), 1e-9)
        motion[:, 2] *= 0.02
        motion[:, 1] += self.drift_px * time / time[-1]
        return motion

    def write(self, path: Path) -> Path:
        """Write the video as MP4 with the time of every frame; return `path`."""
        size = self.scene.size if self.turn_deg % 180 == 0 else self.scene.size[::-1]
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), self.rate_Hz, size)
        back = {90: cv2.ROTATE_90_COUNTERCLOCKWISE, 180: cv2.ROTATE_180, 270: cv2.ROTATE_90_CLOCKWISE}
        for frame in self.frames():
            writer.write(cv2.rotate(frame, back[self.turn_deg]) if self.turn_deg else frame)
        writer.release()
        slower = 1.0 if self.played_Hz is None else self.rate_Hz / self.played_Hz
        state_times(path, list((self.times_s - self.times_s[0]) * slower))
        if self.played_Hz is not None and self.is_stated:
            state_capture_rate(path, self.rate_Hz)
        if self.turn_deg:
            state_turn(path, self.turn_deg)
        return path


def hidden_strip(specimen: Specimen, instantaneous_Pa: float, series: Prony, axis_deg: float = 0.0) -> HiddenStrip:
    # Return a virtual strip of a given material; its clamp points `axis_deg` degrees below the horizontal.
    law, model = LAWS["neo-hookean"], SolidBeside(specimen, *MESH)
    at_rest_Pa = instantaneous_Pa * float(series.ratio(60.0))
    parameters = np.array([[at_rest_Pa]])
    loads = Loads.along(np.zeros(1), gravity_angle_deg=90.0 - axis_deg)
    bent = model.solve(law, parameters, loads, tolerance_mm=1e-5, options=SolidOptions(method="follow"))
    if not bent.converged.all():
        raise ArithmeticError("a virtual strip has no equilibrium")
    chosen = candidates(law, parameters, "solid", None, None)
    motion = Vibration(model.solid).near(chosen, loads, bent.last)
    relative = instantaneous_Pa / at_rest_Pa
    rates = motion.roots(lambda s: relative * series.complex_ratio(s), 2)[0]
    along = np.linspace(0.0, specimen.length_mm, _STATIONS)
    line = np.column_stack([along, np.zeros((_STATIONS, 2))])
    places = model.positions(bent, line)[0, 0]
    nodes, weights = model.solid.grid.place(model.solid.grid.straightened(line))

    def directions(places_mm: Array) -> Array:
        steps = np.gradient(places_mm[:, :2], axis=0)
        return np.asarray(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])))

    rest = directions(places)
    changes = []
    for mode in range(2):
        moved = np.einsum("nai,na->ni", motion.nodal[mode, 0][nodes], weights)
        unit = moved * (0.1 / moved[-1, 1])
        changes.append((directions(places + unit) - rest) / 0.1)
    return HiddenStrip(specimen, instantaneous_Pa, series, rest, changes[0], changes[1], (rates[0], rates[1]))


def drawn_film(seed: int, share: float = 1.0) -> PhoneFilm:
    """Choose a video at random: a strip that sags by 3 to 9 % of its length, and a phone at 120 or 240 Hz on a support.

    share : scale of the frames (1280 x 720 px)
    """
    size = (round(SIZE[0] * share), round(SIZE[1] * share))
    rng = np.random.default_rng([seed, 31])
    length, depth = rng.uniform(38, 60), rng.uniform(8.0, 14.0)
    width = length * rng.uniform(0.11, 0.16)
    specimen = Specimen(length, width, depth, rng.uniform(1040.0, 1120.0), "solid")
    sag = rng.uniform(0.03, 0.09)
    dynamic_Pa = 1.5 * specimen.density_kg_m3 * 9.81 * (1e-3 * length) ** 4 / (1e-3 * width) ** 2
    dynamic_Pa = 1.3 * dynamic_Pa / (sag * 1e-3 * length) / 3.0
    tau = np.array([0.002, 0.02, 0.2, 2.0, 20.0])
    shares = rng.uniform(0.02, 0.12) * rng.uniform(0.6, 1.4, len(tau))
    series = Prony(shares, tau)
    clamp_deg = float(rng.normal(0.0, 1.0))
    strip = hidden_strip(specimen, dynamic_Pa / float(series.ratio(0.02)), series, clamp_deg)
    equivalent = rng.choice([24.0, 26.0, 28.0, 52.0])
    focal_px = 1.15 * equivalent / DIAGONAL_35MM * float(np.hypot(*size))  # a video shows a part of the sensor
    far = max(150.0, rng.uniform(1.5, 2.2) * length * focal_px / size[0])
    angles = np.radians(rng.normal(0.0, [1.0, 1.0, 1.0]))
    turned = np.asarray(cv2.Rodrigues(angles)[0])
    aim = np.array([rng.uniform(0.4, 0.6) * length, rng.uniform(-0.1, 0.1) * length, 0.0])
    scene = PhoneScene(
        modulus_Pa=strip.dynamic_Pa,
        specimen=specimen,
        grams=(),
        size=size,
        focal_px=focal_px,
        stated_focal_mm=round(equivalent),
        camera_mm=aim - turned.T @ np.array([0.0, 0.0, far]),
        turned=turned,
        distortion=0.01 * rng.standard_normal(),
        clamp_deg=clamp_deg,
        ruler_deg=0.4 * rng.standard_normal(),
        ruler_z_mm=1.0 * rng.standard_normal(),
        seed=seed,
    )
    rate = float(rng.choice([120.0, 240.0]))
    return PhoneFilm(
        scene,
        strip,
        rate_Hz=rate,
        flicks_mm=(float(rng.uniform(0.05, 0.12)) * length,),
        exposure_s=1.0 / float(rng.uniform(300, 1000)),
        row_time_s=0.6 / rate / size[1],
        seed=seed,
    )


def typed_sizes(film: PhoneFilm, rng: np.random.Generator) -> dict[str, float]:
    """Return dimensions and density that a user measures, with random errors, by key."""
    beam = film.strip.specimen
    sigma = SIGMAS
    return {
        "length_mm": round(beam.length_mm + sigma["length_mm"] * rng.standard_normal(), 1),
        "width_mm": round(float(beam.width_mm) + sigma["width_mm"] * rng.standard_normal(), 2),
        "depth_mm": round(float(beam.depth_mm) + sigma["depth_mm"] * rng.standard_normal(), 2),
        "density_kg_m3": round(float(beam.density_kg_m3) + sigma["density_kg_m3"] * rng.standard_normal()),
    }


SIGMAS = {"length_mm": 0.15, "width_mm": 0.03, "depth_mm": 0.05, "density_kg_m3": 10.0}
"""Standard uncertainties of the dimensions that a user types, by key."""


def clicked_line(film: PhoneFilm, rng: np.random.Generator) -> tuple[tuple[float, float], ...]:
    """Return three pixels (x, y) that a user clicks on the centre line at rest: clamp, middle and tip."""
    near = film.at_rest.around[0]
    lower, upper = near[:_STATIONS], near[_STATIONS:][::-1]
    middle = film.scene.to_px(0.5 * (lower + upper))
    sigma_px = 2.0 * film.scene.size[0] / SIZE[0]
    clicks = middle[[0, _STATIONS // 2, -1]] + sigma_px * rng.standard_normal((3, 2))
    return tuple((float(x), float(y)) for x, y in clicks.round(1))


__all__ = ["PhoneFilm", "clicked_line", "drawn_film", "hidden_strip", "replace", "typed_sizes"]

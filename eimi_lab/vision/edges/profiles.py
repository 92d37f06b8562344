"""Grey values along an edge's normals, and the blurred step fitted to them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

Array = NDArray[np.float64]

AVERAGED_PX = 4  # along the edge: fewer is noisier, more hurts where the edge is curved
_STEP_PX = 0.5
_ROUNDS = 8
_ROUNDS_WITH_COVER = 24  # two steps close together part slowly
_SETTLED_PX = 1e-3  # the last correction; what is left is its square in order
_BLUR_LIMITS_PX = (0.3, 8.0)


def sample(image: NDArray[Any], points_px: Array) -> Array:
    """Bilinear interpolation at points (..., 2) x, y; beyond the frame the border pixel's value holds.

    Of an image (height, width) or (height, width, channels); the channels come last in what is returned.
    Written out because cv2.remap rounds places to 1/32 px before OpenCV 5.
    """
    height, width = image.shape[:2]
    x = np.clip(points_px[..., 0], 0.0, width - 1.0)
    y = np.clip(points_px[..., 1], 0.0, height - 1.0)
    left = np.minimum(x.astype(np.int64), max(width - 2, 0))
    top = np.minimum(y.astype(np.int64), max(height - 2, 0))
    right, below = min(width - 1, 1), (min(height - 1, 1)) * width
    x, y = x - left, y - top
    flat, first = image.reshape(height * width, *image.shape[2:]), top * width + left
    if image.ndim == 3:
        x, y = x[..., None], y[..., None]
    read = np.take(flat, first, axis=0) * ((1.0 - x) * (1.0 - y))
    read += np.take(flat, first + right, axis=0) * (x * (1.0 - y))
    read += np.take(flat, first + below, axis=0) * ((1.0 - x) * y)
    read += np.take(flat, first + below + right, axis=0) * (x * y)
    return np.asarray(read, dtype=np.float64)


def normals_of(tangents: Array) -> Array:
    """Unit tangents (..., 2) turned by a quarter, clockwise in the image."""
    return np.asarray(np.stack([-tangents[..., 1], tangents[..., 0]], axis=-1), dtype=np.float64)


def stations(inner_px: float, outer_px: float) -> Array:
    """Places along a normal from -inner_px to outer_px, zero among them."""
    first, last = -round(inner_px / _STEP_PX), round(outer_px / _STEP_PX)
    return np.arange(first, last + 1, dtype=np.float64) * _STEP_PX


def read_profiles(
    image: NDArray[Any], points_px: Array, normals: Array, stations_px: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """Profiles (n, m) along normals, each the mean of its window's k lines; and which of them lie in the frame.

    Of an image (height, width, channels) they are (n, m, channels). points_px, normals: (n, k, 2). stations_px: (m,)
    distances along the normal; the lines are shifted along it by less than half a pixel, on the mean not at all.
    """
    # Interpolation blurs least at a pixel's middle and most between two. The lines are shifted against each other by
    # parts of a pixel, so that the profile of an edge along the pixels' rows is blurred as that of any other.
    lines = points_px.shape[1]
    shifted = stations_px + ((np.arange(lines) + 0.5) / lines - 0.5)[:, None]
    places = points_px[:, :, None, :] + shifted[..., None] * normals[:, :, None, :]
    high = np.array([image.shape[1] - 1.0, image.shape[0] - 1.0])
    inside = np.asarray(((places >= 0.0) & (places <= high)).all(axis=(1, 2, 3)))
    return sample(image, places).mean(axis=1), inside


@dataclass(frozen=True)
class Cover:
    """Silicone outside a narrower magnet: a second, fainter step inside the edge.

    group: (n,) which of the k covers a profile has, -1 for none. width_px, tolerance_px: (k,) what is believed of
    each, and its standard deviation. transmission: share of the light that comes through silicone alone.
    """

    group: NDArray[np.int64]
    width_px: Array
    tolerance_px: Array
    transmission: float


@dataclass(frozen=True)
class Steps:
    """Blurred steps fitted to n profiles.

    offset_px: (n,) place of the edge along the normal. dark, bright: (n,) the plateaus on both sides.
    blur_px: the standard deviation of the blur, one for all. residual: (n,) root mean square of what is left,
    as a share of the step. sensitivity: (n,) by how many pixels the offset moves for noise of one grey level, were it
    independent from station to station. common_px: (n,) standard deviation of the offset that comes of
    the uncertain width of a cover, the same way for all that share it. sound: (n,) where a step was found.
    """

    offset_px: Array
    dark: Array
    bright: Array
    blur_px: float
    residual: Array
    sensitivity: Array
    common_px: Array
    sound: NDArray[np.bool_]


def fit_steps(
    stations_px: Array,
    profiles: Array,
    blur_px: float = 1.2,
    usable: NDArray[np.bool_] | None = None,
    cover: Cover | None = None,
) -> Steps:
    """Fit dark + (bright - dark) (1 + erf((u - offset) / (sqrt(2) blur))) / 2 to rising profiles (n, m).

    Offset and plateaus belong to each profile and the blur to all: Gauss-Newton in which the three are
    eliminated profile by profile from the normal equations of the blur. blur_px: where to start. usable: (n,)
    profiles that may speak for the blur. A profile with a cover has two steps: from dark to the silicone's share of
    the bright plateau, as far inside the edge as the cover is wide, and from there to the bright plateau. The widths
    of the covers are shared as the blur is, and held to what is believed of them by their tolerances.
    """
    u = stations_px
    cover = cover or Cover(np.full(len(profiles), -1), np.zeros(0), np.zeros(0), 0.0)
    covered = np.flatnonzero(cover.group >= 0)
    dark, bright, offset = _first_guess(u, profiles, cover, covered)
    rises = bright - dark > 1e-9
    speaks = rises if usable is None else rises & usable
    shared = _SharedUnknowns(blur_px, cover, float(u[-1] - u[0]))

    for _ in range(_ROUNDS_WITH_COVER if len(covered) else _ROUNDS):
        columns, common = _derivatives(u, dark, bright, offset, shared.values, cover, covered)
        left_over = profiles - dark[:, None] * columns[..., 0] - bright[:, None] * columns[..., 1]
        inverse = _inverse(np.swapaxes(columns, 1, 2) @ columns)
        follow = inverse @ (np.swapaxes(columns, 1, 2) @ common)
        good = speaks & _typical(left_over, bright - dark, cover.group)
        change = shared.step((common - columns @ follow)[good], left_over[good])
        update = _solve(columns, inverse, left_over - common @ change)
        dark, bright = dark + update[:, 0], bright + update[:, 1]
        offset = np.clip(offset + np.clip(update[:, 2], -1.0, 1.0), u[0], u[-1])
        still = np.abs(change).max() < _SETTLED_PX
        if still and (not good.any() or float(np.abs(update[good, 2]).max()) < _SETTLED_PX):
            break

    blur, height = shared.blur_px, bright - dark
    sound = rises & (height > 1e-9) & (offset > u[0] + blur) & (offset < u[-1] - blur)
    height = np.where(sound, height, 1.0)
    residual = np.sqrt((left_over**2).mean(axis=1)) / height
    sensitivity = np.sqrt(np.maximum(inverse[:, 2, 2], 0.0))
    common_px = np.sqrt(follow[:, 2, 1:] ** 2 @ shared.cover_variances())
    sound &= np.isfinite(offset + residual + sensitivity + common_px)
    return Steps(
        offset_px=offset,
        dark=dark,
        bright=bright,
        blur_px=blur,
        residual=residual,
        sensitivity=sensitivity,
        common_px=common_px,
        sound=sound,
    )


def _first_guess(u: Array, profiles: Array, cover: Cover, covered: NDArray[np.int64]) -> tuple[Array, Array, Array]:
    """Plateaus from the ends of the profiles (n, m), and the offset from the area under them."""
    ends = max(2, len(u) // 6)
    dark, bright = profiles[:, :ends].mean(axis=1), profiles[:, -ends:].mean(axis=1)
    height = np.where(bright - dark > 1e-9, bright - dark, 1.0)
    share = (profiles - dark[:, None]) / height[:, None]
    # The area under a step from 0 to 1 is the distance from the step to the far end.
    offset = np.clip(u[-1] - _STEP_PX * (share.sum(axis=1) - 0.5 * (share[:, 0] + share[:, -1])), u[0], u[-1])
    fainter = np.clip((cover.transmission * bright - dark) / height, 0.0, 1.0)[covered]
    offset[covered] = np.minimum(offset[covered] + fainter * cover.width_px[cover.group[covered]], u[-1])
    return dark, bright, offset


class _SharedUnknowns:
    """The unknowns that profiles have in common: ``values`` are the blur, then the widths of the k covers, px."""

    def __init__(self, blur_px: float, cover: Cover, span_px: float) -> None:
        # The widths are begun at half of what is believed, for from too wide a cover the search may end at none.
        self.values = np.concatenate([[blur_px], 0.5 * cover.width_px])
        self._believed = np.concatenate([[0.0], cover.width_px])
        self._firmness = np.concatenate([[0.0], cover.tolerance_px**-2.0])
        widest = np.full(len(cover.width_px), span_px)
        self._largest = np.concatenate([[min(_BLUR_LIMITS_PX[1], 0.4 * span_px)], widest])
        self._smallest = np.concatenate([[_BLUR_LIMITS_PX[0]], np.zeros(len(cover.width_px))])

    @property
    def blur_px(self) -> float:
        return float(self.values[0])

    def step(self, reduced: Array, left_over: Array) -> Array:
        """Take one Gauss-Newton step and return it, from derivatives (n, m, 1 + k) and what is left over (n, m)."""
        self._noise = float((left_over**2).mean()) if len(left_over) else 0.0
        known = reduced.reshape(-1, len(self.values))
        normal = known.T @ known + self._noise * np.diag(self._firmness)
        target = known.T @ left_over.ravel() - self._noise * self._firmness * (self.values - self._believed)
        self._normal = normal + np.diag(1e-12 * np.maximum(np.diag(normal), 1e-12) + 1e-12)
        most = 0.5 * self.blur_px
        change: Array = np.clip(np.linalg.solve(self._normal, target), -most, most)
        self.values = np.clip(self.values + change, self._smallest, self._largest)
        return change

    def cover_variances(self) -> Array:
        """(k,) px²: of the widths of the covers, after the last step."""
        return np.asarray(self._noise * np.diag(np.linalg.inv(self._normal))[1:])


def _derivatives(
    u: Array, dark: Array, bright: Array, offset: Array, shared: Array, cover: Cover, covered: NDArray[np.int64]
) -> tuple[Array, Array]:
    """Of the profiles: (n, m, 3) by dark, bright and offset, and (n, m, 1 + k) by the shared unknowns.

    A profile is linear in its plateaus: it is dark times the first column plus bright times the second.
    """
    blur = float(shared[0])
    rise, bell, z = _blurred_step(u - offset[:, None], blur)
    step = (bright - dark)[:, None]
    columns = np.stack([1.0 - rise, rise, -step * bell], axis=-1)
    common = np.zeros((*rise.shape, len(shared)))
    common[..., 0] = -step * bell * z
    if len(covered):
        passes, groups = cover.transmission, cover.group[covered]
        rise_in, bell_in, z_in = _blurred_step(u - offset[covered, None] + shared[1:][groups, None], blur)
        rise, bell, z = rise[covered], bell[covered], z[covered]
        columns[covered, :, 0] = 1.0 - rise_in
        columns[covered, :, 1] = passes * rise_in + (1.0 - passes) * rise
        lower = (passes * bright - dark)[covered, None] * bell_in
        upper = (1.0 - passes) * bright[covered, None] * bell
        columns[covered, :, 2] = -lower - upper
        common[covered, :, 0] = -lower * z_in - upper * z
        common[covered, :, 1 + groups] = lower
    return columns, common


def _blurred_step(places: Array, blur: float) -> tuple[Array, Array, Array]:
    """A step from 0 to 1 at 0, its slope, and the places in units of the blur, all of the shape of ``places``."""
    z = places / blur
    return 0.5 * (1.0 + erf(z / np.sqrt(2.0))), np.exp(-0.5 * z**2) / (np.sqrt(2.0 * np.pi) * blur), z


def _inverse(normal: Array) -> Array:
    """Inverses of (n, 3, 3) normal matrices; a little on the diagonal keeps those of flat profiles finite."""
    size = np.trace(normal, axis1=1, axis2=2)[:, None, None]
    return np.linalg.inv(normal + (1e-9 * size + 1e-12) * np.eye(3))


def _solve(columns: Array, inverse: Array, target: Array) -> Array:
    return (inverse @ (np.swapaxes(columns, 1, 2) @ target[..., None]))[..., 0]


def _typical(left_over: Array, step: Array, group: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which profiles are left over no more than thrice the usual of their group: dirt on an edge must not set the blur.

    Group by group, for two steps that are not fitted yet are no dirt: without them the width would not be found.
    """
    size = np.sqrt((left_over**2).mean(axis=1)) / np.maximum(np.abs(step), 1e-9)
    typical = np.zeros(len(size), dtype=bool)
    for number in np.unique(group):
        members = group == number
        typical[members] = size[members] <= 3.0 * np.median(size[members])
    return typical

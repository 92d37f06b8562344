"""Read grey values along lines across an edge of the beam, and fit blurred steps to them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

AVERAGED_PX = 4  # lines averaged along the edge: fewer give more noise, more give a bias on a curved edge
_STEP_PX = 0.5  # distance of the stations
_ROUNDS = 8  # of Gauss-Newton iteration
_ROUNDS_WITH_COVER = 24  # two steps close together converge slowly
_SETTLED_PX = 1e-3  # largest last correction; the remaining error is of the order of its square
_BLUR_LIMITS_PX = (0.3, 8.0)


def sample(image: NDArray[Any], points_px: Array) -> Array:
    """Return the values of an image at points between its pixels, by bilinear interpolation.

    Parameters
    ----------
    image : ndarray, shape (rows, columns) or (rows, columns, channels)
        The image.
    points_px : ndarray, shape (..., 2)
        Coordinates x, y of the points.

    Returns
    -------
    ndarray, shape (...) or (..., channels)
        The value at each point; beyond the border, the value of the nearest border pixel.

    Examples
    --------
    >>> sample(np.array([[0.0, 10.0], [20.0, 30.0]]), np.array([[0.5, 0.5], [1.0, 0.25]])).tolist()
    [15.0, 15.0]
    """
    # cv2.remap is not used, because before OpenCV 5 it rounds coordinates to 1/32 px.
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
    values = np.take(flat, first, axis=0) * ((1.0 - x) * (1.0 - y))
    values += np.take(flat, first + right, axis=0) * (x * (1.0 - y))
    values += np.take(flat, first + below, axis=0) * ((1.0 - x) * y)
    values += np.take(flat, first + below + right, axis=0) * (x * y)
    return np.asarray(values, dtype=np.float64)


def normals_of(tangents: Array) -> Array:
    """Return unit normals: the unit tangents, turned by 90° clockwise in the image."""
    return np.asarray(np.stack([-tangents[..., 1], tangents[..., 0]], axis=-1), dtype=np.float64)


def stations(inner_px: float, outer_px: float) -> Array:
    """Return distances from -inner_px to outer_px in steps of half a pixel, with 0 among them."""
    first, last = -round(inner_px / _STEP_PX), round(outer_px / _STEP_PX)
    return np.arange(first, last + 1, dtype=np.float64) * _STEP_PX


def read_profiles(
    image: NDArray[Any], points_px: Array, normals: Array, stations_px: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """Read grey values along lines across an edge, averaged over k parallel lines.

    Parameters
    ----------
    image : ndarray, shape (rows, columns) or (rows, columns, channels)
        The image.
    points_px, normals : ndarray, shape (n, k, 2)
        Origins and unit directions of k lines at each of n places.
    stations_px : ndarray, shape (m,)
        Distances along the lines.

    Returns
    -------
    profiles : ndarray, shape (n, m) or (n, m, channels)
        Mean grey values of the k lines.
    inside : ndarray of bool, shape (n,)
        Whether all lines at a place lie entirely in the image.
    """
    # Interpolation blurs least at the centre of a pixel and most between two pixels. The lines are shifted against each
    # other by parts of a pixel, so that an edge along the rows of pixels is blurred like any other edge.
    lines = points_px.shape[1]
    shifted = stations_px + ((np.arange(lines) + 0.5) / lines - 0.5)[:, None]
    places = points_px[:, :, None, :] + shifted[..., None] * normals[:, :, None, :]
    high = np.array([image.shape[1] - 1.0, image.shape[0] - 1.0])
    inside = np.asarray(((places >= 0.0) & (places <= high)).all(axis=(1, 2, 3)))
    return sample(image, places).mean(axis=1), inside


@dataclass(frozen=True)
class Cover:
    """The silicone between a magnet and the edge of the beam, on each of k sides.

    Attributes
    ----------
    group : ndarray of int, shape (n,)
        For each of n lines across an edge, the side (0 to k - 1); -1 for a line that does not meet the magnet.
    width_px : ndarray, shape (k,)
        Prior mean of the silicone's width.
    tolerance_px : ndarray, shape (k,)
        Prior standard deviation of the silicone's width.
    transmission : float
        Share of the light that passes through the silicone.
    """

    group: NDArray[np.int64]
    width_px: Array
    tolerance_px: Array
    transmission: float


@dataclass(frozen=True)
class Steps:
    """Blurred steps that were fitted to the grey values along n lines across an edge."""

    # offset_px : ndarray, shape (n,)
    #     Distance along each line from its origin to the edge.
    # dark, bright : ndarray, shape (n,)
    #     Grey values on both sides of each step.
    # blur_px : float
    #     Standard deviation of the Gaussian blur of all steps.
    # residual : ndarray, shape (n,)
    #     RMS residual on each line, as a share of the height of its step.
    # sensitivity : ndarray, shape (n,)
    #     Standard deviation of the offset (px) for noise of one grey level.
    # common_px : ndarray, shape (n,)
    #     Standard deviation of a shift of all offsets together, such as beside a magnet.
    # sound : ndarray of bool, shape (n,)
    #     Whether a step was detected on each line.

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
    """Fit a blurred step to the grey values along each of n lines across an edge, with one common blur.

    The fitted function of the distance u along a line is

        g(u) = dark + (bright - dark) · Φ((u - o) / s),    Φ(z) = (1 + erf(z / √2)) / 2,

    with the grey values dark and bright, the offset o of the step, and the standard deviation s of the blur.

    Parameters
    ----------
    stations_px : ndarray, shape (m,)
        Distances along the lines.
    profiles : ndarray, shape (n, m)
        Grey values from the dark to the bright side of the edge.
    blur_px : float
        Initial value of s.
    usable : ndarray of bool, shape (n,), optional
        Which lines may contribute to the blur; by default all.
    cover : Cover, optional
        Silicone beside a magnet, which causes a second step.

    Returns
    -------
    Steps
        The fitted steps.

    Examples
    --------
    >>> from scipy.special import ndtr
    >>> u = stations(6.0, 6.0)
    >>> steps = fit_steps(u, np.stack([20.0 + 180.0 * ndtr((u - 0.3) / 1.5)] * 3))
    >>> steps.offset_px.round(3).tolist(), round(steps.blur_px, 3)
    ([0.3, 0.3, 0.3], 1.5)
    """
    u = stations_px
    cover = cover or Cover(np.full(len(profiles), -1), np.zeros(0), np.zeros(0), 0.0)
    covered = np.flatnonzero(cover.group >= 0)
    dark, bright, offset = _first_guess(u, profiles, cover, covered)
    rises = bright - dark > 1e-9
    informative = rises if usable is None else rises & usable
    shared = _SharedUnknowns(blur_px, cover, float(u[-1] - u[0]))

    for _ in range(_ROUNDS_WITH_COVER if len(covered) else _ROUNDS):
        columns, shared_columns = _derivatives(u, dark, bright, offset, shared.values, cover, covered)
        residuals = profiles - dark[:, None] * columns[..., 0] - bright[:, None] * columns[..., 1]
        inverse = _inverse(np.swapaxes(columns, 1, 2) @ columns)
        response = inverse @ (np.swapaxes(columns, 1, 2) @ shared_columns)
        typical = informative & _typical(residuals, bright - dark, cover.group)
        change = shared.step((shared_columns - columns @ response)[typical], residuals[typical])
        update = _solve(columns, inverse, residuals - shared_columns @ change)
        dark, bright = dark + update[:, 0], bright + update[:, 1]
        offset = np.clip(offset + np.clip(update[:, 2], -1.0, 1.0), u[0], u[-1])
        still = np.abs(change).max() < _SETTLED_PX
        if still and (not typical.any() or float(np.abs(update[typical, 2]).max()) < _SETTLED_PX):
            break

    blur, height = shared.blur_px, bright - dark
    sound = rises & (height > 1e-9) & (offset > u[0] + blur) & (offset < u[-1] - blur)
    height = np.where(sound, height, 1.0)
    residual = np.sqrt((residuals**2).mean(axis=1)) / height
    sensitivity = np.sqrt(np.maximum(inverse[:, 2, 2], 0.0))
    common_px = np.sqrt(response[:, 2, 1:] ** 2 @ shared.cover_variances())
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
    """Return initial values for the fit of a step to each profile: dark value, bright value and offset."""
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
    """The unknowns that are common to all profiles of grey values across a beam: the blur and the silicone widths.

    A silicone width is the distance from the magnet inside the beam to one edge of the beam.
    """

    def __init__(self, blur_px: float, cover: Cover, span_px: float) -> None:
        # The widths start at half of their prior means: from too wide a cover the iteration may end at none.
        self.values = np.concatenate([[blur_px], 0.5 * cover.width_px])
        self._prior = np.concatenate([[0.0], cover.width_px])
        self._precision = np.concatenate([[0.0], cover.tolerance_px**-2.0])
        widest = np.full(len(cover.width_px), span_px)
        self._largest = np.concatenate([[min(_BLUR_LIMITS_PX[1], 0.4 * span_px)], widest])
        self._smallest = np.concatenate([[_BLUR_LIMITS_PX[0]], np.zeros(len(cover.width_px))])

    @property
    def blur_px(self) -> float:
        return float(self.values[0])

    def step(self, reduced: Array, residuals: Array) -> Array:
        """Improve the unknowns by one Gauss-Newton step, and return their changes, px.

        `reduced`: derivatives of m grey values on n lines by the u unknowns, shape (n, m, u). `residuals`: shape (n,
        m).
        """
        self._noise = float((residuals**2).mean()) if len(residuals) else 0.0
        jacobian = reduced.reshape(-1, len(self.values))
        normal = jacobian.T @ jacobian + self._noise * np.diag(self._precision)
        target = jacobian.T @ residuals.ravel() - self._noise * self._precision * (self.values - self._prior)
        self._normal = normal + np.diag(1e-12 * np.maximum(np.diag(normal), 1e-12) + 1e-12)
        most = 0.5 * self.blur_px
        change: Array = np.clip(np.linalg.solve(self._normal, target), -most, most)
        self.values = np.clip(self.values + change, self._smallest, self._largest)
        return change

    def cover_variances(self) -> Array:
        """Return the variance of the width of silicone from the magnet to each edge, px²; call `step` before."""
        return np.asarray(self._noise * np.diag(np.linalg.inv(self._normal))[1:])


def _derivatives(
    u: Array, dark: Array, bright: Array, offset: Array, shared: Array, cover: Cover, covered: NDArray[np.int64]
) -> tuple[Array, Array]:
    """Return derivatives of the grey values at m distances on n lines, by all unknowns of the fit."""
    # First result: by dark value, bright value and offset of a line, shape (n, m, 3). Second: by the unknowns that all
    # lines share (``shared``), shape (n, m, 1 + k): the blur, and the width of silicone from the magnet to each of k
    # edges of the beam.
    blur = float(shared[0])
    rise, bell, z = _blurred_step(u - offset[:, None], blur)
    step = (bright - dark)[:, None]
    columns = np.stack([1.0 - rise, rise, -step * bell], axis=-1)
    shared_columns = np.zeros((*rise.shape, len(shared)))
    shared_columns[..., 0] = -step * bell * z
    if len(covered):
        passes, groups = cover.transmission, cover.group[covered]
        rise_in, bell_in, z_in = _blurred_step(u - offset[covered, None] + shared[1:][groups, None], blur)
        rise, bell, z = rise[covered], bell[covered], z[covered]
        columns[covered, :, 0] = 1.0 - rise_in
        columns[covered, :, 1] = passes * rise_in + (1.0 - passes) * rise
        lower = (passes * bright - dark)[covered, None] * bell_in
        upper = (1.0 - passes) * bright[covered, None] * bell
        columns[covered, :, 2] = -lower - upper
        shared_columns[covered, :, 0] = -lower * z_in - upper * z
        shared_columns[covered, :, 1 + groups] = lower
    return columns, shared_columns


def _blurred_step(distances: Array, blur: float) -> tuple[Array, Array, Array]:
    """Return the values and slopes of a blurred unit step at given distances, and the distances divided by the blur."""
    z = distances / blur
    return 0.5 * (1.0 + scipy.special.erf(z / np.sqrt(2.0))), np.exp(-0.5 * z**2) / (np.sqrt(2.0 * np.pi) * blur), z


def _inverse(normal: Array) -> Array:
    size = np.trace(normal, axis1=1, axis2=2)[:, None, None]
    return np.linalg.inv(normal + (1e-9 * size + 1e-12) * np.eye(3))


def _solve(columns: Array, inverse: Array, target: Array) -> Array:
    return (inverse @ (np.swapaxes(columns, 1, 2) @ target[..., None]))[..., 0]


def _typical(residuals: Array, step: Array, group: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which of n lines across an edge have a fit without disturbance, for example by dirt."""
    relative = np.sqrt((residuals**2).mean(axis=1)) / np.maximum(np.abs(step), 1e-9)
    typical = np.zeros(len(relative), dtype=bool)
    for number in np.unique(group):
        members = group == number
        typical[members] = relative[members] <= 3.0 * np.median(relative[members])
    return typical

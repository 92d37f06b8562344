"""The perspective of a camera with an ordinary lens, for points of the beam that are not at mid-depth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class View:
    """The view of a camera whose lens is in front of the plane of the beam.

    Examples
    --------
    The beam is tilted by 3 degrees toward the camera in the direction of +x. A point at x = 40 mm appears farther from
    the clamp than it is:

    >>> view = View(np.zeros(2), stand_off_mm=200.0, tilt_deg=(3.0, 0.0))
    >>> view.seen(np.array([[0.0, 0.0, 0.0], [40.0, 0.0, 0.0]])).round(2).tolist()
    [[0.0, 0.0], [40.37, 0.0]]
    """

    # (2,): the point (x, y) at mid-depth on the axis of the lens.
    centre_mm: Array
    # Distance from the pupil of the lens to ``centre_mm``.
    stand_off_mm: float
    # Angles by which the plane of the beam is tilted toward the camera, in the direction of +x and of +y.
    tilt_deg: tuple[float, float] = (0.0, 0.0)
    # (2, 2): two points (x, y) at mid-depth. The image is scaled and rotated so that the vector between them appears
    # in its real length and direction.
    ruler_mm: Array | None = None

    def seen(self, places_mm: Array) -> Array:
        """Return where points (x, y, z) of the beam appear in the camera image, (x, y) in mm from the clamp."""
        # ``places_mm`` (..., 3): coordinates (x, y, z); z points away from the camera, with z = 0 at mid-depth. The
        # result is (..., 2).
        if not any(self.tilt_deg):
            scale = self.stand_off_mm / (self.stand_off_mm + places_mm[..., 2:])
            return self.centre_mm + scale * (places_mm[..., :2] - self.centre_mm)
        clamp = self._tilted(np.zeros(3))
        appear = self._tilted(places_mm) - clamp
        if self.ruler_mm is None:
            return appear
        ends = self._tilted(np.column_stack([self.ruler_mm, np.zeros(2)]))
        (along, across), (seen_along, seen_across) = self.ruler_mm[1] - self.ruler_mm[0], ends[1] - ends[0]
        similar = complex(along, across) / complex(seen_along, seen_across)
        turned = np.array([[similar.real, similar.imag], [-similar.imag, similar.real]])
        return np.asarray(appear @ turned)

    def _tilted(self, places_mm: Array) -> Array:
        """Project points (x, y, z) of a tilted beam into the image."""
        # The result (..., 2) is in mm from the axis of the lens.
        slope = np.radians(self.tilt_deg)
        angle = float(np.hypot(*slope))
        toward = slope / angle
        from_centre = places_mm[..., :2] - self.centre_mm
        along, away = from_centre @ toward, places_mm[..., 2]
        moved = np.cos(angle) * along + np.sin(angle) * away - along
        distance = self.stand_off_mm - np.sin(angle) * along + np.cos(angle) * away
        return np.asarray((self.stand_off_mm / distance)[..., None] * (from_centre + moved[..., None] * toward))

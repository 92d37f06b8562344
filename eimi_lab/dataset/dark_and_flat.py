"""The dark frame (taken without light) and the flat field (back-light without the beam) of a dataset."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from eimi_lab.dataset.layout import group, to_stored
from eimi_lab.dataset.rewriting import rewritten
from eimi_lab.dataset.stored_edges import drop_edges
from eimi_lab.process.errors import InputError
from eimi_lab.vision.intensity import FieldCorrection, in_channels

GROUP = "correction"
BRIGHTEST_DARK = 0.5  # a dark frame that is brighter than this fraction of the back-light was taken with light

Images = Mapping[str, NDArray[Any]]
"""A dark frame (key "dark") and a flat field (key "flat") of H rows and W columns; each key may be absent.

The shape of an image is (H, W), or (H, W, 3) for an image with colours.
"""


def read_correction_images(dark: Path | None, flat: Path | None) -> dict[str, NDArray[Any]]:
    """Read a dark frame (taken without light) and a flat field (back-light without the beam) from image files.

    The result has the keys "dark" and "flat"; the key of a file that is None is absent. Raises InputError for an
    unreadable or unsuitable image.
    """
    from eimi_lab.vision.image_files import (
        read_image,
    )  # OpenCV loads slowly, and a fit of stored edges does not need it

    images = {name: read_image(path) for name, path in (("dark", dark), ("flat", flat)) if path is not None}
    try:
        correction_by(images)
    except ValueError as error:
        raise InputError(f"{flat or dark}: {error}") from error
    return images


def correction_by(images: Images) -> FieldCorrection | None:
    """Return the correction of frames by a dark frame and a flat field; None if both images are absent.

    A dark frame is taken without light, a flat field without the beam. Raises ValueError for unsuitable images.
    """
    return FieldCorrection(images.get("dark"), images.get("flat")) if images else None


def check_like(images: Images, frame: NDArray[Any]) -> None:
    """Raise InputError if the dark frame or the flat field in ``images`` does not fit the camera image ``frame``.

    A dark frame is taken without light, a flat field without the beam. Size and bit depth must be those of ``frame``.
    """
    from eimi_lab.vision.image_files import describe_image  # imports OpenCV, which loads slowly

    for name, image in images.items():
        if (image.shape, image.dtype) != (frame.shape, frame.dtype):
            raise InputError(
                f"--{name}: is {describe_image(image)}; the frames are {describe_image(frame)}, and the image should "
                "have the same size and bit depth"
            )
    if "dark" in images:
        dark, lit = float(np.median(images["dark"])), float(np.percentile(frame, 99))
        if dark > BRIGHTEST_DARK * lit:
            raise InputError(
                f"--dark: the image has a median of {dark:g} grey levels, but the back-light in the frames has {lit:g} "
                "grey levels; take the dark frame with the light off or the lens covered"
            )


def store_correction(path: str | Path, images: Images) -> None:
    """Store a dark frame (taken without light) and a flat field (back-light without the beam) in a dataset.

    The edges of the beam are removed from the dataset, because the correction changes the frames.

    Raises
    ------
    InputError
        If the dataset contains tracked points or no load step, or if the images differ from the frames in size or bit
        depth.
    """
    path = Path(path)
    with rewritten(path, 2 * sum(image.nbytes for image in images.values())) as entry:
        if "frames" not in entry["data"]:
            raise InputError(f"{path}: holds tracked points, so there are no frames to correct")
        if not len(entry["data/frames"]):
            raise InputError(f"{path}: holds no state; repeat the run")
        frame = to_stored(entry["data/frames"][0])
        images = {name: in_channels(image, frame.ndim == 3) for name, image in images.items()}
        check_like(images, frame)
        kept = {**stored_correction(entry), **images}
        try:
            correction_by(kept)
        except ValueError as error:
            raise InputError(f"{path}: {error}") from error
        _remove(entry)
        store = group(entry, GROUP, "NXcollection")
        for name, image in kept.items():
            store.create_dataset(name, data=to_stored(image), compression="gzip", shuffle=True, fletcher32=True)
            store[name].attrs["units"] = "counts"


def forget_correction(path: str | Path) -> None:
    """Remove the dark frame, the flat field and the edges of the beam from a dataset."""
    with rewritten(Path(path)) as entry:
        _remove(entry)


def stored_correction(entry: h5py.Group) -> dict[str, NDArray[Any]]:
    """Return the dark frame (key "dark") and the flat field (key "flat") in a dataset; an absent image has no key."""
    return {name: to_stored(image[()]) for name, image in entry[GROUP].items()} if GROUP in entry else {}


def _remove(entry: h5py.Group) -> None:
    drop_edges(entry)
    if GROUP in entry:
        del entry[GROUP]

"""Read a dataset for the live web page, also while a run writes the dataset."""

from __future__ import annotations

import time
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.planning.modulus_so_far import ModulusSoFar, modulus_so_far
from eimi_fitting.inference.searching.modulus_range import NothingActs, NothingConverged
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.toml import parse
from eimi_lab.dataset.reading import Dataset, open_dataset
from eimi_lab.dataset.segmentation import edges_of_state
from eimi_lab.fits.evidence import experiment_so_far
from eimi_lab.process.errors import InputError
from eimi_lab.process.writer_lock import is_being_written
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edges.edge_set import EdgeSet, tip_angle_deg, tip_angle_sigma_deg
from eimi_lab.vision.edges.overlay import in_colour
from eimi_lab.vision.flags import Flag
from eimi_lab.vision.intensity import state_mean

JPEG_QUALITY = 85
Edges = dict[str, Any]


def described(path: Path) -> dict[str, Any]:
    """Return the specimen, the instruments and the load steps of a dataset as a JSON object, without the edges.

    Raises
    ------
    InputError
        If the dataset cannot be read.
    """
    with open_dataset(path) as dataset:
        beam = dataset.specimen.specimen
        protocol = dataset.text("protocol")
        asked = len(parse(Protocol, protocol, str(path)).currents_A) if protocol else len(dataset.states)
        return {
            "kind": dataset.kind,
            "specimen": beam.name,
            "material": beam.material,
            "begun": dataset.start_time().isoformat(timespec="seconds"),
            "instruments": dataset.instruments(),
            "states_asked": asked,
            "being_written": not dataset.finished and is_being_written(path),
            "size_px": list(dataset.frame_format()[0][1::-1]) if dataset.kind == "frames" else None,
            "virtual": dataset.truth() is not None,
            "segmented": dataset.kind == "frames" and dataset.edges() is not None,
            "states": [
                {
                    "index": state.index,
                    "current_A": state.current_A,
                    "measured_A": state.measured_A,
                    "field_mT": state.field_mT,
                    "flags": shown_flags(state.flags),
                }
                for state in dataset.states
            ],
        }


def picture(path: Path, index: int) -> bytes:
    """Return the mean of the frames of a load step as JPEG.

    Raises
    ------
    InputError
        If the dataset cannot be read or does not have the load step.
    """
    with open_dataset(path) as dataset:
        _check_state(dataset, index)
        return jpeg(state_mean(dataset.each_image(index)))


def edges(path: Path, index: int) -> Edges:
    """Return the edges of the beam at a load step in pixels, stored or found in the frames.

    Raises
    ------
    InputError
        If the dataset cannot be read or does not have the load step.
    """
    with open_dataset(path) as dataset:
        _check_state(dataset, index)
        edge_set = _edges(path, _identity(dataset), index)
        assert dataset.calibration is not None
        shown = in_pixels(edge_set, BeamFrame(dataset.calibration))
        shown["tip_angle_deg"] = finite(tip_angle_deg(edge_set))
        shown["tip_angle_sigma_deg"] = finite(tip_angle_sigma_deg(edge_set))
        return shown


Identity = tuple[int, int, str, str | None, str | None, int]


def _identity(dataset: Dataset) -> Identity:
    """Return a key that identifies a dataset with its specimen and calibration, also while a run still appends to it.

    The key consists of the device, the inode number, the start time, the texts of specimen and calibration, and, for an
    import, the time of the last change.
    """
    about = dataset.path.stat()
    # A new file can get the inode number of a deleted file. Two imports of the same pictures have the same start time.
    is_import = dataset.text("protocol") is None
    return (
        about.st_dev,
        about.st_ino,
        dataset.start_time().isoformat(),
        dataset.text("specimen"),
        dataset.text("calibration"),
        about.st_mtime_ns if is_import else 0,
    )


@lru_cache(maxsize=1024)
def _edges(path: Path, identity: Identity, index: int) -> EdgeSet:
    with open_dataset(path) as dataset:
        return edges_of_state(dataset, index)


_last_estimate: dict[Identity, ModulusSoFar] = {}


def modulus(path: Path, states: int) -> dict[str, Any] | None:
    """Return an estimate of the initial shear modulus from the first load steps of a dataset.

    Parameters
    ----------
    path : Path
        The dataset.
    states : int
        Number of load steps to use.

    Returns
    -------
    dict or None
        The modulus with its 95 % interval (kPa), the main source of its uncertainty, and the distance between the
        measured and the simulated edges (mm). None if there are too few load steps.

    Raises
    ------
    InputError
        If no load acts on the beam, or if the search does not converge.
    """
    with open_dataset(path) as dataset:
        identity = _identity(dataset)
        edges = [_edges(path, identity, index) for index in range(min(states, len(dataset.states)))]
        experiment = experiment_so_far(dataset, edges)
    if experiment is None:
        return None
    began = time.process_time()
    try:
        estimate = modulus_so_far(experiment, _last_estimate.get(identity))
    except (NothingActs, NothingConverged) as error:
        raise InputError(f"no modulus yet: {error}") from error
    _last_estimate[identity] = estimate
    return {
        "states": states,
        "used": estimate.states,
        "modulus_kPa": estimate.value_Pa / 1e3,
        "interval_95_kPa": [end / 1e3 for end in estimate.interval_95_Pa],
        "limited_by": estimate.limited_by,
        "error_mm": estimate.error_mm,
        "seconds": time.process_time() - began,
    }


def in_pixels(edge_set: EdgeSet, frame: BeamFrame) -> Edges:
    """Return the two edges of a beam in pixels and the flags (names of defects) of the edges, as a JSON object.

    An edge is a list of points (x, y). `frame` converts from mm on the beam to pixels.
    """
    return {
        "left": rounded(frame.to_px(edge_set.left.points_mm)),
        "right": rounded(frame.to_px(edge_set.right.points_mm)),
        "flags": shown_flags(edge_set.flags),
    }


def shown_flags(flags: tuple[Flag, ...]) -> list[dict[str, Any]]:
    """Return flags as JSON objects with name, measured value, limit, severity and remedy.

    A flag is a defect of a picture or of its edges.
    """
    return [{**asdict(flag), "value": finite(flag.value), "limit": finite(flag.limit)} for flag in flags]


def rounded(points: NDArray[Any]) -> list[list[float]]:
    """Return n points in pixels, shape (n, 2), as n lists [x, y], rounded to a hundredth of a pixel."""
    return np.round(points, 2).tolist()


def finite(value: float) -> float | None:
    """Return a number for JSON: None for NaN and infinity, otherwise the number itself."""
    return float(value) if np.isfinite(value) else None


def jpeg(image: NDArray[Any], widest_px: int | None = None) -> bytes:
    """Return an image as JPEG, reduced to a width of at most `widest_px` pixels (None: not reduced).

    The image of H by W pixels has the shape (H, W), or (H, W, 3) with three colours, and any bit depth.
    """
    shown = in_colour(image) if image.ndim == 3 else in_colour(image)[..., 0]
    if widest_px and shown.shape[1] > widest_px:
        share = widest_px / shown.shape[1]
        shown = np.asarray(cv2.resize(shown, None, fx=share, fy=share, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    return cv2.imencode(".jpg", shown, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes()


def _check_state(dataset: Dataset, index: int) -> None:
    if dataset.kind != "frames":
        raise InputError(f"{dataset.path}: contains tracked points, which have no pictures")
    if not 0 <= index < len(dataset.states):
        raise InputError(f"{dataset.path}: has no state {index}; it has {len(dataset.states)} states, counted from 0")

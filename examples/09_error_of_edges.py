"""Measure the error of detected edges: compare the edges in a picture of a virtual beam with the simulated outline."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import eimi_lab as eimi

PROTOCOL = "dragon_skin_10_quick"


def main() -> float:
    """Return the root mean square distance (px) between detected and simulated edges in the last state."""
    with (
        TemporaryDirectory() as folder,
        eimi.segment(eimi.acquire(PROTOCOL, "type1", "virtual", Path(folder) / "run.h5")) as run,
    ):
        edge_set, truth, calibration = (run.edges() or ())[-1], run.truth(), run.calibration
        current_A = run.states[-1].current_A
    assert truth is not None
    assert calibration is not None
    (true_edges,) = eimi.simulate([current_A], "type1", truth["model"], parameter=truth["parameters"]).edges_mm
    distances = []
    for edge, curve in zip((edge_set.left.points_mm, edge_set.right.points_mm), true_edges, strict=True):
        start, side = curve[:-1], np.diff(curve, axis=0)
        along = ((edge[:, None] - start) * side).sum(axis=-1) / (side**2).sum(axis=-1)
        nearest = start + np.clip(along, 0, 1)[..., None] * side
        distances.append(np.linalg.norm(edge[:, None] - nearest, axis=-1).min(axis=1))
    error_px = calibration.pixels_per_mm * float(np.sqrt(np.mean(np.concatenate(distances) ** 2)))
    print(f"error of {sum(map(len, distances))} edge points: {error_px:.3f} px (root mean square)")
    return error_px


if __name__ == "__main__":
    main()

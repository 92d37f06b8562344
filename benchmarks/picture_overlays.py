"""Draw pictures of edges for the documentation: ``python -m benchmarks.picture_overlays docs/pictures``.

``real_pictures.png`` shows traced and detected edges of other people's photographs without the photographs, which may
not be distributed. ``benches.jpg`` shows rendered photographs with detected edges.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import cv2
import matplotlib
import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.check import leaves_out
from eimi_lab.vision.edges.finding import find_edges
from eimi_lab.vision.edges.overlay import contact_sheet, draw_overlay
from tests.shared.lab_difficulties import KINDS
from tests.shared.lab_photographs import lab_photograph, stated
from tests.shared.real_pictures import Picture, pictures

_COLUMNS = 4
_TRACED, _LEFT, _RIGHT = "0.75", "tab:blue", "tab:orange"
_SEED = 1


def draw_real(axes: Axes, picture: Picture) -> None:
    """Draw the reference edges (grey), the detected left edge (blue) and right edge (orange), and the clamp."""
    reference = json.loads((picture.folder / "reference.json").read_text())
    edges = picture.edges()
    scored = picture.score(edges, picture.calibration)
    frame = BeamFrame(picture.calibration)
    for side in ("side_a", "side_b"):
        axes.plot(*np.array(reference[side]).T, color=_TRACED, linewidth=4.0, solid_capstyle="butt")
    for edge, colour in ((edges.left, _LEFT), (edges.right, _RIGHT)):
        axes.plot(*frame.to_px(edge.points_mm).T, ".", color=colour, markersize=2.0)
    half = picture.specimen.specimen.width_mm
    axes.plot(*frame.to_px([[0.0, -half], [0.0, half]]).T, color="black", linewidth=1.5)
    refused = leaves_out(edges.flags) or not len(edges.left.points_mm)
    words = "refused" if refused else f"median {scored.median:.2f} px, 95 % {scored.p95:.2f} px"
    axes.set_title(f"{picture.name}\n{words}", fontsize=8)
    axes.set_aspect("equal", adjustable="datalim")
    axes.invert_yaxis()
    axes.set_xticks([])
    axes.set_yticks([])


def real_sheet(shown: list[Picture], file: Path) -> None:
    """Draw the traced and the detected edges of all photographs on one sheet, and write it to a file."""
    rows = -(-len(shown) // _COLUMNS)
    figure, places = plt.subplots(rows, _COLUMNS, figsize=(11.0, 2.5 * rows), layout="constrained")
    for axes, picture in zip(places.ravel(), shown, strict=False):
        draw_real(axes, picture)
    for axes in places.ravel()[len(shown) :]:
        axes.axis("off")
    figure.savefig(file, dpi=100)
    plt.close(figure)


def bench_sheet(file: Path) -> None:
    """Draw one rendered photograph of each kind with its detected edges on one sheet, and write it to a file."""
    drawn = []
    for index, name in enumerate(KINDS):
        rng = np.random.default_rng([_SEED, index, 0])
        image, scene = lab_photograph(name, rng)
        calibration, specimen = stated(scene, rng)
        edges = find_edges(image, calibration, specimen)
        overlay = draw_overlay(image, edges, calibration)[: image.shape[0]]
        drawn.append(overlay)
    sheet = contact_sheet(drawn, list(KINDS), (220, 185))
    cv2.imwrite(str(file), sheet, [cv2.IMWRITE_JPEG_QUALITY, 80])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    matplotlib.use("Agg")
    cv2.setNumThreads(1)
    shown = list(pictures("development"))
    if shown:
        real_sheet(shown, folder / "real_pictures.png")
    bench_sheet(folder / "benches.jpg")


if __name__ == "__main__":
    main()

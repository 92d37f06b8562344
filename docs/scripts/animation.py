"""Make the animation of a virtual run on the home page: ``python docs/scripts/animation.py DATASET FITS``.

``eimi demo -o DEMO`` writes both files, ``DEMO/dataset.h5`` and ``DEMO/fits.json``. Each frame of the animation shows
one state of the run. The left part is the picture of the beam with its edges. The right part is a plot of the
deflection against the field, where the deflection is the mean over the last points of both edges. Look at the animation
before you commit it.
"""

from __future__ import annotations

import io
import sys
from pathlib import Path

import matplotlib

matplotlib.use("agg")
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from eimi_fitting.inference.evidence.measurements import EdgeObservation
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.fits.prediction import predict_on_each
from eimi_lab.reporting.contents import DatasetContents
from eimi_lab.reporting.frames import crop_of, frame_of, measured_mm
from eimi_lab.reporting.sections import evidence_for_fits
from eimi_lab.reporting.shown import ShownFit, read_shown
from eimi_lab.showing.palette import PALETTE

PAGE = Path(__file__).parents[1] / "pictures" / "run.gif"
STATE_MS, LAST_MS = 350, 3000
COLOURS = 64
_FINE = 4000  # points on a simulated edge

Array = NDArray[np.float64]


def _beside(measured: list[Array], simulated: Array) -> float:
    """Return the simulated deflection (mm) at the place of the last measured points, for a comparison with them.

    On each simulated edge, the point nearest to the last measured point is taken. The result is the mean y of both
    points.

    Parameters
    ----------
    measured : list of ndarray, shape (m, 2)
        The m measured points (x, y) of the left and of the right edge, mm.
    simulated : ndarray, shape (2, n, 2)
        The n points (x, y) of the simulated left and right edges, mm.
    """
    along = np.linspace(0, simulated.shape[1] - 1, _FINE)
    at = np.arange(simulated.shape[1])
    fine = [np.column_stack([np.interp(along, at, part) for part in edge.T]) for edge in simulated]
    nearest = [((edge - points[-1]) ** 2).sum(axis=1).argmin() for edge, points in zip(fine, measured, strict=True)]
    return float(np.mean([edge[row, 1] for edge, row in zip(fine, nearest, strict=True)]))


def frame(contents: DatasetContents, shown: ShownFit, last: int, fitted: bool) -> Image.Image:
    """Return the frame of the animation for the state with the index `last`.

    `fitted` adds the simulated edges and the result of the fit.
    """
    simulated = contents.predictions[0]
    crop, to_px = crop_of(contents), frame_of(contents).to_px
    states = contents.evidence.states
    figure = Figure(figsize=(6.4, 3.6), dpi=100, layout="constrained")
    picture, plot = figure.subplots(1, 2, width_ratios=[1, 1.45])
    picture.imshow(crop.of(contents.dataset.images(states[last].index, 1)[0]), cmap="gray", vmin=0, vmax=1)
    for side, edge in enumerate(measured_mm(contents, last)):
        picture.plot(*crop.places(to_px(edge)).T, ".", color=PALETTE[0], markersize=2.5)
        if fitted:
            picture.plot(*crop.places(to_px(simulated.edges_mm[last, side])).T, color=PALETTE[1], linewidth=1.5)
    picture.set_title(f"{states[last].field_mT:.2f} mT", fontsize=10)
    picture.axis("off")
    fields = np.array([state.field_mT for state in states])
    tips = np.array([[edge[-1, 1] for edge in measured_mm(contents, k)] for k in range(len(states))]).mean(axis=1)
    plot.plot(fields[: last + 1], tips[: last + 1] - tips[0], "o", color=PALETTE[0], label="measured")
    if fitted:
        ends = np.array([_beside(measured_mm(contents, k), simulated.edges_mm[k]) for k in range(len(states))])
        plot.plot(fields, ends - tips[0], color=PALETTE[1], label=f"simulated, {shown.fit.model}", zorder=0)
        low, high = shown.fit.initial_shear_modulus.interval_95
        modulus = 1e-3 * shown.fit.initial_shear_modulus.value
        words = f"shear modulus {modulus:.2f} kPa\n95 % interval {1e-3 * low:.2f} to {1e-3 * high:.2f} kPa"
        plot.set_title(words, fontsize=10)
    else:
        plot.set_title("measuring\n", fontsize=10)
    plot.set(xlim=(-0.2, fields.max() * 1.05), ylim=(-0.5, (tips - tips[0]).max() * 1.12))
    plot.set_xlabel("field, mT")
    plot.set_ylabel("deflection of the last edge points, mm")
    plot.legend(loc="upper left", frameon=False, fontsize=8)
    plot.spines[["top", "right"]].set_visible(False)
    content = io.BytesIO()
    figure.savefig(content, format="png")
    return Image.open(content).convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)


def main(dataset: Path, fits: Path) -> None:
    """Write the animation to docs/pictures/run.gif."""
    shown = read_shown([fits])[:1]
    evidence, on = evidence_for_fits(dataset, shown, flagged=False)
    assert isinstance(evidence.experiment.observed, EdgeObservation)
    (_, predictions), *_ = predict_on_each([on])
    with open_dataset(dataset) as opened:
        contents = DatasetContents(opened, evidence, predictions, dataset.name, shown[0])
        count = len(evidence.states)
        frames = [frame(contents, shown[0], k, False) for k in range(count)] + [
            frame(contents, shown[0], count - 1, True)
        ]
    times = [STATE_MS] * count + [LAST_MS]
    frames[0].save(PAGE, save_all=True, append_images=frames[1:], duration=times, loop=0, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))

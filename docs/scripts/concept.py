"""Draw the sketch of docs/concept.md: ``python docs/scripts/concept.py``. Look at the picture before you commit it."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Arc, Polygon, Rectangle
from sketches import BLUE, GREEN, GREY, ORANGE, RED, SILICONE, STEEL, arrow, bare, strip

PAGE = Path(__file__).parents[1] / "pictures" / "concept.svg"
CURVATURE = 0.030
SIZE_IN = (8.6, 5.2)


def measured_beam(axes: Axes) -> None:
    """Draw a camera picture of the beam, with the axes, the angle at the tip, the edges and the loads."""
    axes.add_patch(Rectangle((-12, -38.5), 41, 45.5, facecolor="#F4F4F4", edgecolor=GREY))
    axes.text(-11.3, 5.3, "frame of the camera", fontsize=9, color=GREY)
    _, rest_left, rest_right = strip(0.0, 30, 3)
    axes.add_patch(Polygon(np.vstack([rest_left, rest_right[::-1]]), fill=False, edgecolor=GREY, linestyle="--"))
    middle, left, right = strip(CURVATURE, 30, 3)
    axes.add_patch(Polygon(np.vstack([left, right[::-1]]), facecolor=SILICONE, edgecolor="none"))
    axes.add_patch(Polygon(np.vstack([left[52:], right[52:][::-1]]), facecolor=STEEL, edgecolor="none"))
    axes.add_patch(Rectangle((-6, 0), 12, 3, facecolor="#BBBBBB", edgecolor="black", hatch="///"))
    axes.text(6.6, 1.0, "clamp: origin at its middle", fontsize=9)
    for edge in (left, right):
        axes.plot(*edge[3::4].T, "o", color=BLUE, markersize=3.5, zorder=4)
        axes.plot(*(edge + np.array([0.25, 0.1])).T, color=ORANGE, linewidth=1.6, zorder=3)
    axes.annotate("left edge", left[24], (-11, -17), fontsize=9, arrowprops={"arrowstyle": "-", "color": GREY})
    axes.annotate("right edge", right[20], (9, -7), fontsize=9, arrowprops={"arrowstyle": "-", "color": GREY})
    axes.annotate("at rest", (-1.5, -27), (-11, -29), fontsize=9, arrowprops={"arrowstyle": "-", "color": GREY})
    axes.annotate("magnet", middle[56], (4.2, -31.5), fontsize=9, arrowprops={"arrowstyle": "-", "color": GREY})
    arrow(axes, (0, 0), (0, -34.5), "black")
    axes.text(0.6, -34.9, "x", fontsize=11)
    arrow(axes, (0, 0), (25, 0), "black")
    axes.text(25.6, -0.7, "y", fontsize=11)
    arrow(axes, (-10.5, -4.5), (-4, -4.5), BLUE)
    axes.text(-10.8, -7.6, "field B of\na positive\ncurrent", fontsize=9, color=BLUE, va="top")
    arrow(axes, (25.5, -5), (25.5, -12), GREEN)
    axes.text(24.6, -8.5, "gravity", fontsize=9, color=GREEN, ha="right")
    along = middle[-1] - middle[-6]
    along = along / np.linalg.norm(along)
    arrow(axes, tuple(middle[56]), tuple(middle[56] + 9 * along), RED)
    axes.text(*(middle[56] + 9.4 * along + (-3.5, 1.9)), "moment m", fontsize=9, color=RED)
    tip = middle[-1]
    axes.plot([tip[0], tip[0]], [tip[1], tip[1] - 6], color=GREY, linestyle=":", linewidth=1)
    angle = float(np.degrees(np.arctan2(along[1], along[0])))
    axes.add_patch(Arc(tuple(tip), 9, 9, theta1=-90, theta2=angle, color="black"))
    axes.text(tip[0] - 2.6, tip[1] - 6.6, "angle of the tip", fontsize=9, va="top")
    bare(axes, (-13, 30), (-39.5, 8))


def what_is_fitted(axes: Axes) -> None:
    """Draw how a law is fitted: one magnified edge with its measured points, and below it the steps of the search.

    The thin lines between the measured points and the simulated edge are the distances of which the error consists.
    """
    bare(axes, (0, 30), (-37, 8))
    x = np.linspace(1.5, 27, 60)
    simulated = -3 - 0.012 * (x - 1.5) ** 2
    axes.plot(x, simulated, color=ORANGE, linewidth=2)
    rng = np.random.default_rng(4)
    for place in range(4, 58, 6):
        height = simulated[place] + 1.4 * np.sin(0.11 * x[place]) + rng.normal(0, 0.25)
        axes.plot([x[place], x[place]], [simulated[place], height], color=BLUE, linewidth=1)
        axes.plot(x[place], height, "o", color=BLUE, markersize=4)
    axes.text(1.5, 5.3, "an edge, magnified", fontsize=9, color=GREY)
    axes.text(1.5, 1.4, "measured points", fontsize=9, color=BLUE)
    axes.text(12.5, -12.6, "simulated edge", fontsize=9, color=ORANGE)
    axes.text(1.5, -14.6, "error = root mean square length of thin lines", fontsize=9)
    steps = (
        ("law with parameters, such as C10", "what is fitted"),
        ("finite elements: beam, magnet, field, weight", "stated, with uncertainty"),
        ("simulated edges in each field", ""),
        ("error against the measured edges", ""),
    )
    for row, (words, remark) in enumerate(steps):
        y = -19.2 - 4.4 * row
        axes.add_patch(Rectangle((1.5, y - 1.35), 26, 2.7, facecolor="#FFFFFF", edgecolor="black"))
        axes.text(14.5, y, words, fontsize=8.5, ha="center", va="center")
        if remark:
            axes.text(28, y + 1.45, remark, fontsize=7.5, color=GREY, ha="right", va="bottom")
        if row:
            arrow(axes, (14.5, y + 3.05), (14.5, y + 1.35), "black")
    axes.plot([1.5, 0.4, 0.4, 1.5], [-32.4, -32.4, -19.2, -19.2], color="black", linewidth=1.3)
    arrow(axes, (0.4, -19.2), (1.5, -19.2), "black")
    axes.text(0.0, -25.8, "search", fontsize=9, rotation=90, ha="right", va="center")


def main() -> None:
    """Write the sketch to docs/pictures/concept.svg."""
    plt.rcParams.update({"svg.hashsalt": "eimi-lab", "font.size": 9})
    figure, (left, right) = plt.subplots(1, 2, figsize=SIZE_IN, layout="constrained", width_ratios=[43, 31])
    measured_beam(left)
    what_is_fitted(right)
    figure.savefig(PAGE, metadata={"Date": None})
    plt.close(figure)


if __name__ == "__main__":
    main()

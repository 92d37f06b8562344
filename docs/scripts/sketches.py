"""Draw the sketches at the top of the pages under docs/why: ``python docs/scripts/sketches.py [FOLDER]``.

Each sketch is an SVG file. Its letters are outlines, so that the sketch looks the same on every computer. The sketches
explain a principle and contain no results, with two exceptions: `paper` computes its curves, and `planning` shows the
values of a table on its page. Look at every sketch before you commit it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import FancyBboxPatch, Polygon, Rectangle
from scipy.special import ndtr

from eimi_fitting.laws import LAWS
from eimi_fitting.laws.tensile import engineering_stress, fit_tensile
from eimi_lab.showing.palette import PALETTE

FOLDER = Path(__file__).parents[1] / "why" / "sketches"
BLUE, ORANGE, PINK, GREEN, RED = PALETTE[:5]
SKY = "#56B4E9"
SILICONE, STEEL, GREY = "#E9D8C0", "#666666", "#888888"
ECOFLEX_PA = np.array([8737.0, 4511.0, -3313.0])  # protocols/rigs/virtual_materials.toml
BLOCK = np.array([[0, 0], [1, 0], [3, -2], [3, -3], [2, -3], [0, -1]])  # a band of one candidate

Drawing = Callable[[Axes], None]


def arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float], colour: str, style: str = "-|>") -> None:
    """Draw an arrow from `start` to `end`."""
    axes.annotate(
        "", end, start, arrowprops={"arrowstyle": style, "color": colour, "lw": 1.6, "shrinkA": 0, "shrinkB": 0}
    )


def box(axes: Axes, place: tuple[float, float], size: tuple[float, float], words: str, colour: str) -> None:
    """Draw a box with a text. `place` is the lower left corner of the box."""
    shape = FancyBboxPatch(place, *size, boxstyle="round,pad=0.04", facecolor=colour, edgecolor="black", alpha=0.85)
    axes.add_patch(shape)
    axes.text(place[0] + size[0] / 2, place[1] + size[1] / 2, words, ha="center", va="center", fontsize=9)


def bare(axes: Axes, x: tuple[float, float], y: tuple[float, float]) -> None:
    """Set the limits of both axes, make their scales equal, and hide the axes."""
    axes.set(xlim=x, ylim=y, aspect="equal")
    axes.axis("off")


def strip(curvature: float, length: float, width: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the middle line, the left edge and the right edge of a hanging beam that is bent to an arc.

    Each curve consists of n points, shape (n, 2), with x to the right and y up. The units are the units of `length` and
    `width`. `curvature` is the inverse of the radius of the arc.
    """
    s = np.linspace(0, length, 60)
    turn = curvature * s
    step = s[1] - s[0]
    middle = np.column_stack([np.cumsum(np.sin(turn)), -np.cumsum(np.cos(turn))]) * step
    normal = np.column_stack([np.cos(turn), np.sin(turn)])
    return middle, middle - width / 2 * normal, middle + width / 2 * normal


def physics(axes: Axes) -> None:
    """Draw a beam that hangs in a coil, both straight and bent, with its loads and the axes of the beam frame."""
    for curvature, alpha in ((0.0, 0.35), (0.032, 1.0)):
        _, left, right = strip(curvature, 30, 3)
        axes.add_patch(Polygon(np.vstack([left, right[::-1]]), facecolor=SILICONE, edgecolor="black", alpha=alpha))
        magnet = np.vstack([left[52:], right[52:][::-1]])
        axes.add_patch(Polygon(magnet, facecolor=STEEL, edgecolor="black", alpha=alpha))
    axes.add_patch(Rectangle((-6, 0), 12, 3, facecolor="#BBBBBB", edgecolor="black", hatch="///"))
    for height in (-8, -16, -24):
        arrow(axes, (-17, height), (-9, height), BLUE)
    axes.text(-17, -6, "coil field B", color=BLUE, fontsize=9)
    middle, *_ = strip(0.032, 30, 3)
    tip, along = middle[-4], middle[-1] - middle[-8]
    along = along / np.linalg.norm(along)
    arrow(axes, tuple(tip), tuple(tip + 8 * along), RED)
    axes.text(*(tip + 8.5 * along + (0, -1)), "magnetic moment m", color=RED, fontsize=9)
    arrow(axes, (31, -2), (31, -9), GREEN)
    axes.text(32, -7, "gravity", color=GREEN, fontsize=9)
    arrow(axes, (0, 0), (0, -37), "black")
    axes.text(1, -37, "x", fontsize=10)
    arrow(axes, (0, 0), (12, 0), "black")
    axes.text(12.5, -0.6, "y", fontsize=10)
    axes.text(7, 1.2, "clamp", fontsize=9)
    bare(axes, (-18, 42), (-39, 4))


def section(axes: Axes) -> None:
    """Draw the cross section of a bent beam in plane strain, in plane stress and as a solid."""
    names = ("plane strain", "plane stress", "solid")
    errors = ("depth held; type 1: −21.4 %", "depth free; type 1: +5.0 %", "bows; the reference")
    z = np.linspace(-1, 1, 30)
    for column, (name, error) in enumerate(zip(names, errors, strict=True)):
        x = 4.4 * column
        axes.add_patch(Rectangle((x - 1.5, -0.8), 3, 1.6, fill=False, ls="--", ec=GREY))
        taper = (0.0, 0.22, 0.22)[column]
        bow = (0.0, 0.0, 0.16)[column]
        high = np.column_stack([x + z * (1.5 - taper), 0.8 + bow * (z**2 - 0.4)])
        low = np.column_stack([x + z * (1.5 + taper), -0.8 + bow * (z**2 - 0.4)])
        axes.add_patch(Polygon(np.vstack([high, low[::-1]]), facecolor=SILICONE, edgecolor="black", alpha=0.85))
        axes.text(x, 1.25, name, ha="center", fontsize=10)
        axes.text(x, -1.3, error, ha="center", fontsize=8)
    axes.text(0, -0.05, "depth", ha="center", fontsize=8)
    arrow(axes, (-1.4, -0.3), (1.4, -0.3), "black", "<|-|>")
    axes.text(-1.75, 0, "width", rotation=90, va="center", ha="center", fontsize=8)
    bare(axes, (-2.2, 11), (-1.6, 1.7))


def metric(axes: Axes) -> None:
    """Draw measured points, the simulated edge, and the distances of the points from the edge."""
    random = np.random.default_rng(4)
    _, left, right = strip(0.03, 30, 5)
    for edge, colour in ((left, BLUE), (right, ORANGE)):
        axes.plot(*edge.T, color=colour, lw=1.8)
        tangent = np.gradient(edge, axis=0)
        normal = np.column_stack([-tangent[:, 1], tangent[:, 0]]) / np.linalg.norm(tangent, axis=1)[:, None]
        chosen = np.arange(4, 58, 6)
        points = edge[chosen] + normal[chosen] * random.normal(0.5, 0.7, (len(chosen), 1))
        for foot, point in zip(edge[chosen], points, strict=True):
            axes.plot(*zip(foot, point, strict=True), color=RED, lw=1.2)
        axes.plot(*points.T, "k.", ms=6)
    axes.plot([], [], "k.", label="observed edge points")
    axes.plot([], [], color=BLUE, label="simulated left edge")
    axes.plot([], [], color=ORANGE, label="simulated right edge")
    axes.plot([], [], color=RED, label="distances d, to the edge of the same side")
    axes.add_patch(Rectangle((-6, 0), 12, 2, facecolor="#BBBBBB", edgecolor="black", hatch="///"))
    axes.legend(loc="upper right", fontsize=8, frameon=False)
    bare(axes, (-8, 48), (-31, 3))


def statistics(axes: Axes) -> None:
    """Draw two probability densities of the modulus, with their intervals and the true modulus.

    The narrow density comes from noise and mesh only, and its interval does not contain the true modulus. The wide
    density comes from all stated sources of uncertainty, and its interval contains it.
    """
    x = np.linspace(-4, 4, 400)
    for width, offset, height, colour, words in (
        (0.25, 0.0, -0.12, BLUE, "noise and mesh alone: interval_95_fit"),
        (1.2, 0.0, -0.3, ORANGE, "with all stated sources: interval_95"),
    ):
        density = np.exp(-((x - offset) ** 2) / (2 * width**2)) / width**0.5
        axes.plot(x, density, color=colour, lw=1.8, label=words)
        arrow(axes, (-1.96 * width, height), (1.96 * width, height), colour, "<|-|>")
    axes.axvline(0.9, color="black", ls="--", lw=1.2)
    axes.text(0.98, 1.45, "truth", fontsize=9)
    axes.plot([0, 0], [-0.45, 0], color="black", lw=0.8)
    axes.text(0, -0.66, "best value", ha="center", fontsize=9)
    axes.legend(loc="upper left", fontsize=8, frameon=False)
    axes.set(xlim=(-4.6, 4), ylim=(-0.8, 2.6), xlabel="initial shear modulus", yticks=[], xticks=[])
    axes.set_ylabel("probability density")


def edges(axes: Axes) -> None:
    """Draw the grey values along a normal of the edge, and the blurred step that is fitted to these values."""
    random = np.random.default_rng(2)
    s = np.arange(-8.0, 8.5, 0.5)
    fine = np.linspace(-8, 8, 300)
    grey, fitted = (0.1 + 0.8 * ndtr((places - 0.6) / 1.4) for places in (s, fine))
    axes.plot(s, grey + random.normal(0, 0.02, len(s)), "k.", label="grey values along the normal")
    axes.plot(fine, fitted, color=BLUE, lw=1.8, label="fitted blurred step")
    axes.axvline(0.6, color=RED, ls="--")
    axes.text(0.8, 0.2, "edge: middle of the step", color=RED, fontsize=9)
    arrow(axes, (0.6, 0.5), (2.0, 0.5), GREEN, "<|-|>")
    axes.text(2.2, 0.46, "blur σ", color=GREEN, fontsize=9)
    axes.text(-7.8, 0.17, "beam", fontsize=9)
    axes.text(6.0, 0.95, "back-light", fontsize=9)
    axes.legend(loc="upper left", fontsize=8, frameon=False)
    axes.set(xlabel="distance along the normal, px", ylabel="grey value / full scale", ylim=(0, 1.05))


def planning(axes: Axes) -> None:
    """Draw three choices of six fields as points on a line, each with the interval of the modulus that it gives.

    The page has the same values in a table.
    """
    rows = (
        ("hanging, equal steps: ± 1.27 %", np.linspace(0, 7.05, 6), GREY),
        ("hanging, planned: ± 0.78 %", np.array([2.58, 2.82, 3.06, 3.29, 3.52, 3.76]), BLUE),
        ("upright, planned: ± 0.22 %", np.array([0.0, 0.23, 0.47, 0.70, 0.94, 1.17]), ORANGE),
    )
    for height, (words, field_mT, colour) in enumerate(reversed(rows)):
        axes.plot([0, 7.05], [height, height], color="#CCCCCC", lw=1, zorder=0)
        axes.plot(field_mT, np.full(6, height), "o", color=colour, ms=8)
        axes.text(0, height + 0.22, words, fontsize=9)
    axes.set(xlabel="field of the chosen states, mT", yticks=[], ylim=(-0.4, 2.6))


def verification(axes: Axes) -> None:
    """Draw the stable and the unstable equilibria of a straight beam in a field opposite to its magnet."""
    axes.plot([0, 1], [0, 0], color=BLUE, lw=2.2, label="stable: a beam stays there")
    axes.plot([1, 2], [0, 0], color=RED, lw=2.2, ls="--", label="unstable: status BUCKLED")
    field = np.linspace(1, 2, 200)
    bent = 90 * np.sqrt(1 - 1 / field**2)
    axes.plot(field, bent, color=BLUE, lw=2.2)
    axes.plot(field, -bent, color=BLUE, lw=2.2)
    axes.axvline(1, color=GREY, lw=0.8, ls=":")
    axes.text(0.97, -60, "m B = EI / l", ha="right", fontsize=9)
    axes.legend(loc="upper left", fontsize=8, frameon=False)
    axes.set(xlabel="field against the magnet / buckling field", ylabel="rotation of the tip, degrees (sketch)")


def speed(axes: Axes) -> None:
    """Draw how a batch of candidates (sets of parameters) is solved at once.

    The tangent stiffness matrices of the candidates are blocks on the diagonal of one band matrix.
    """
    for block in range(4):
        start = 3.2 * block
        corners = BLOCK + np.array([start, -start])
        axes.add_patch(Polygon(corners, facecolor=PALETTE[block], edgecolor="black", alpha=0.8))
        beside, side = (start + 3.3, "left") if block < 2 else (start - 0.4, "right")
        axes.text(beside, -start - 1.6, f"candidate {block + 1}", fontsize=9, ha=side)
    axes.add_patch(Rectangle((-0.2, -12.8), 13, 13, fill=False, ec="black"))
    axes.text(13.6, -5, "one band matrix\nof the whole batch,\none LAPACK call;\nblocks do not couple", fontsize=9)
    bare(axes, (-1, 26), (-13.5, 0.8))


def paper(axes: Axes) -> None:
    """Draw a tensile curve, Neo-Hookean fits to three parts of the curve, and the strains in a bending beam."""
    strain = np.linspace(0.005, 1.0, 200)
    law = LAWS["yeoh"]
    stress = engineering_stress(law, ECOFLEX_PA, strain)
    inside = strain <= 0.5
    axes.plot(strain[inside] * 100, stress[inside] / 1e3, "k", lw=2.5, label="material (Yeoh)")
    for window, colour in ((0.1, GREEN), (0.2, BLUE), (0.5, ORANGE)):
        part = strain <= window
        fit = fit_tensile(LAWS["neo-hookean"], strain[part], stress[part])
        fitted = engineering_stress(LAWS["neo-hookean"], fit.parameters, strain[inside])
        modulus_kPa = fit.initial_shear_modulus_Pa / 1e3
        words = f"Neo-Hookean to {window * 100:.0f} %: {modulus_kPa:.1f} kPa"
        axes.plot(strain[inside] * 100, fitted / 1e3, color=colour, lw=1.4, ls="--", label=words)
    axes.axvspan(0, 10, color=SKY, alpha=0.25)
    axes.text(0.6, 16, "strains of\na bending\nbeam", fontsize=8, va="top")
    axes.legend(loc="lower right", fontsize=8, frameon=False)
    axes.set(xlabel="engineering strain, %", ylabel="engineering stress, kPa", xlim=(0, 50), ylim=(0, None))


def safety(axes: Axes) -> None:
    """Draw the three parts that can switch the coil off: the run, its guardian (a separate process) and the supply."""
    box(axes, (0, 2.2), (2.2, 1), "run", SKY)
    box(axes, (0, 0), (2.2, 1), "guardian,\na process of its own", ORANGE)
    box(axes, (4.6, 1.1), (2.0, 1), "supply\n(watchdog)", SILICONE)
    box(axes, (8.4, 1.1), (1.4, 1), "coil", "#BBBBBB")
    arrow(axes, (2.3, 2.6), (4.5, 1.85), "black")
    axes.text(3.3, 2.5, "set-points, read back", fontsize=8)
    arrow(axes, (2.3, 0.5), (4.5, 1.3), RED)
    axes.text(3.5, 0.5, "off, if the run ends\nor stands still", fontsize=8, color=RED, va="center")
    arrow(axes, (6.7, 1.6), (8.3, 1.6), "black")
    arrow(axes, (0.6, 2.1), (0.6, 1.1), "black")
    arrow(axes, (1.6, 1.1), (1.6, 2.1), "black")
    axes.text(0.5, 1.6, "alive", fontsize=8, ha="right", va="center")
    axes.text(1.7, 1.6, "alive", fontsize=8, va="center")
    bare(axes, (-0.6, 10), (-0.2, 3.4))


def file_format(axes: Axes) -> None:
    """Draw a list of the contents of a dataset."""
    box(axes, (0, 1.9), (1.7, 0.9), "run.h5", SKY)
    rows = (
        "specimen, protocol, rig, calibration: the text of the files",
        "what supply and camera report of themselves",
        "states: current, field, time, acknowledged or not",
        "every frame, with a checksum",
        "edges with their flags, once they are found",
    )
    for number, words in enumerate(rows):
        height = 4.2 - number
        axes.plot([1.75, 2.3, 2.3, 2.8], [2.35, 2.35, height, height], color="black", lw=1)
        axes.text(2.9, height, words, va="center", fontsize=9)
    bare(axes, (-0.2, 12), (-0.3, 4.7))


def decisions(axes: Axes) -> None:
    """Draw the three packages and the imports between them."""
    box(axes, (1.6, 2), (3.4, 0.9), "eimi_lab\nfiles, runs, pictures, report", SKY)
    box(axes, (0, 0), (3.0, 0.9), "eimi_fitting\nnumpy, scipy, cma", SILICONE)
    box(axes, (3.6, 0), (3.0, 0.9), "eimi_drivers\npyserial, pyvisa, opencv", ORANGE)
    arrow(axes, (2.6, 1.95), (1.6, 1.0), "black")
    arrow(axes, (4.0, 1.95), (5.0, 1.0), "black")
    axes.text(3.3, 1.4, "imports", ha="center", fontsize=8)
    bare(axes, (-0.2, 6.8), (-0.2, 3.1))


def time(axes: Axes) -> None:
    """Draw the position of the tip of a beam that is released, against the logarithm of the time.

    A field holds the beam bent until the release. Then the tip swings, and afterwards it creeps back to rest.
    """
    before, after = np.linspace(-2.6, -2.0, 2), np.linspace(-2.0, 1.8, 4000)
    since = 10**after - 10**-2.0
    creep = 0.28 * np.exp(-since / 0.4) + 0.16 * np.exp(-since / 9.0)
    ring = 0.9 * np.exp(-4.0 * since) * np.cos(2 * np.pi * 5.0 * since)
    axes.plot(before, [1.34, 1.34], color="black", lw=1.6)
    axes.plot(after, creep + ring, color="black", lw=1.2)
    axes.plot(after, creep, color=BLUE, lw=1.6, ls="--")
    axes.plot(after, creep + 0.9 * np.exp(-4.0 * since), color=RED, lw=1.0, ls=":")
    axes.text(-2.58, 1.42, "held by the field", fontsize=8)
    axes.text(-1.05, 1.02, "rings: frequency and decay give\nthe modulus at 1/(2πf)", color=RED, fontsize=8)
    axes.text(0.35, 0.36, "creeps: the law between\n1 s and the end", color=BLUE, fontsize=8)
    axes.set(xlim=(-2.6, 1.8), ylim=(-0.75, 1.6), xlabel="time after the release (logarithm)", ylabel="tip")
    axes.set_xticks([])
    axes.set_yticks([0.0], ["rest"])


def causes(axes: Axes) -> None:
    """Draw residuals along the beam as points, and three lines: the residuals that three possible causes would give.

    One of the lines has the shape of the residuals.
    """
    random = np.random.default_rng(2)
    place = np.linspace(0, 1, 41)
    axes.plot(place, place + random.normal(0, 0.07, place.size), "k.", label="residuals")
    for signature, colour, words in (
        (place, BLUE, "clamp turned: has the shape of the residuals"),
        (place**2, ORANGE, "wrong scale: grows with the deflection"),
        (np.full_like(place, 0.5), GREEN, "clamp shifted: the same everywhere"),
    ):
        axes.plot(place, signature, color=colour, lw=1.8, label=words)
    axes.set(xlabel="place along the beam, from the clamp", ylabel="residual", xticks=[], yticks=[0], ylim=(-0.2, 1.8))
    axes.legend(loc="upper left", fontsize=8, frameon=False)


SKETCHES: dict[str, tuple[Drawing, tuple[float, float]]] = {
    "physics": (physics, (5.4, 3.9)),
    "section": (section, (7.4, 2.0)),
    "metric": (metric, (5.6, 3.3)),
    "statistics": (statistics, (5.4, 2.8)),
    "edges": (edges, (5.4, 2.9)),
    "causes": (causes, (5.4, 2.8)),
    "time": (time, (5.4, 2.6)),
    "planning": (planning, (5.4, 2.4)),
    "verification": (verification, (5.0, 3.0)),
    "speed": (speed, (5.6, 3.0)),
    "paper": (paper, (5.4, 3.2)),
    "safety": (safety, (6.6, 2.3)),
    "format": (file_format, (6.6, 2.6)),
    "decisions": (decisions, (5.6, 2.7)),
}


def main(folder: Path = FOLDER, kind: str = "svg") -> None:
    """Write all sketches to a folder, as files of the given kind: "svg" or "png"."""
    folder.mkdir(exist_ok=True)
    plt.rcParams.update({"svg.hashsalt": "eimi-lab", "font.size": 9, "path.simplify_threshold": 0.5})
    for name, (draw, size_in) in SKETCHES.items():
        figure, axes = plt.subplots(figsize=size_in, layout="constrained")
        draw(axes)
        for side in ("top", "right"):
            axes.spines[side].set_visible(False)
        metadata = {"Date": None} if kind == "svg" else None
        figure.savefig(folder / f"{name}.{kind}", dpi=100, metadata=metadata)
        plt.close(figure)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))

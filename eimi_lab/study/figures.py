"""Draw the figures of a study, in the form of figures 1, 7, 8 and 9 of Di Lecce et al. 2022."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from eimi_fitting.laws import LAWS, engineering_stress
from eimi_lab.showing.drawing import Drawing, label, saved, styled
from eimi_lab.showing.palette import MEASURED, PALETTE
from eimi_lab.study.errors_by_route import mean_error_um
from eimi_lab.study.extent import LAWS_STUDIED, SECTIONS
from eimi_lab.study.hidden_materials import MATERIALS
from eimi_lab.study.paper_tables import untwisted
from eimi_lab.study.routes import BENDING, Route
from eimi_lab.study.whole_study import Findings

Array = NDArray[np.float64]

_OF_LAW = dict(zip(LAWS_STUDIED, PALETTE, strict=False))
_TENSION = PALETTE[len(_OF_LAW)]


@styled
def all_figures(findings: Findings) -> dict[str, bytes]:
    """Return the contents of the PNG files of a study, by file name."""
    return {
        "stress_strain.png": _png(_stress_strain(findings)),
        "errors.png": _png(_boxes(findings)),
        "overlays.png": _png(_overlays(findings)),
        "error_by_field.png": _png(_by_field(findings)),
    }


def _best_tension(findings: Findings, key: str, section: str) -> int:
    """Return the index of the law with the smallest errors among the laws fitted to tension.

    `key` is the material, and `section` the model of the cross-section.
    """
    kinds = untwisted(findings)
    routes = findings.routes(key, section)
    errors = findings.errors
    return min(
        (i for i, route in enumerate(routes) if route.source == "own"),
        key=lambda i: sum(mean_error_um(errors[key, section, kind][i]) for kind in kinds),
    )


def _grid(rows: int, columns: int, width: float, height: float) -> tuple[Figure, NDArray[np.object_]]:
    figure = Drawing(height * rows + 0.6, width * columns)
    return figure, figure.subplots(rows, columns, squeeze=False)


def _png(figure: Figure) -> bytes:
    return saved(figure, "png", dpi=90)


def _legend(figure: Figure) -> None:
    named = {
        name: handle for axes in figure.axes for handle, name in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.legend(list(named.values()), list(named), loc="outside lower center", ncols=3)


def _stress_strain(findings: Findings) -> Figure:
    """Draw figure 1: stress against strain of the true material and of identified laws."""
    keys = findings.inputs.extent.materials
    figure, grid = _grid(len(keys), 2, 4.6, 3.0)
    for row, key in zip(grid, keys, strict=True):
        routes = findings.routes(key, "solid")
        reached = max(fit["max_stretch"] for fit in findings.bending[key, "solid"]) - 1
        for axes, most in zip(row, (0.3, 1.5), strict=True):
            strain = np.linspace(0, most, 200)
            _curves_by_route(axes, routes, strain)
            material = MATERIALS[key]
            truth = engineering_stress(material.law, material.parameters[0], strain)
            axes.plot(100 * strain, 1e-3 * truth, color=MEASURED, linewidth=1.0, linestyle=(0, (4, 3)), label="hidden")
            axes.axvspan(0, 100 * reached, color="#e8e8e8", zorder=0)
            axes.set_ylim(0, 1.6e-3 * truth[-1])
            label(axes, "engineering strain, %", "engineering stress, kPa")
        row[0].set_title(MATERIALS[key].name, fontsize=9)
    _legend(figure)
    return figure


_DASHES = {"20 %": (0, (1, 1)), "50 %": (0, (3, 1, 1, 1)), "100 %": (0, (5, 1)), "full": "-"}


def _curves_by_route(axes: Axes, routes: list[Route], strain: Array) -> None:
    for route in routes:
        if route.source == "published":
            continue
        stress = 1e-3 * engineering_stress(LAWS[route.law], np.array(route.values), strain)
        if route.source == BENDING:
            axes.plot(100 * strain, stress, color=_OF_LAW[route.law], linewidth=2.0, label=f"{route.law}, bending")
        elif route.law == "yeoh":
            axes.plot(
                100 * strain,
                stress,
                color=_TENSION,
                linewidth=1.0,
                linestyle=_DASHES[route.window],
                label=f"yeoh, {route.name}",
            )


def _boxes(findings: Findings) -> Figure:
    """Draw figure 7: box plots of the errors of identified laws in all states, for each type of specimen."""
    keys, types = findings.inputs.extent.materials, findings.inputs.extent.types
    figure, grid = _grid(len(keys), len(SECTIONS), 5.2, 2.8)
    for row, key in zip(grid, keys, strict=True):
        for axes, section in zip(row, SECTIONS, strict=True):
            routes = findings.routes(key, section)
            shown = [i for i, route in enumerate(routes) if route.source == BENDING]
            shown.append(_best_tension(findings, key, section))
            for place, i in enumerate(shown):
                errors = [findings.errors[key, section, kind][i]["error_mm"] for kind in types]
                by_tension = routes[i].source != BENDING
                colour = _TENSION if by_tension else _OF_LAW[routes[i].law]
                axes.boxplot(
                    [1e3 * np.array(of_type or [np.nan]) for of_type in errors],
                    positions=np.arange(len(types)) + 0.16 * (place - 0.5 * (len(shown) - 1)),
                    widths=0.12,
                    patch_artist=True,
                    boxprops={"facecolor": colour, "edgecolor": colour, "alpha": 0.6},
                    medianprops={"color": "black"},
                    whiskerprops={"color": colour},
                    capprops={"color": colour},
                    flierprops={"markersize": 2, "markeredgecolor": colour},
                    manage_ticks=False,
                )
                axes.plot(
                    [], [], "s", color=colour, label="best by tension" if by_tension else f"{routes[i].law}, bending"
                )
            axes.set_yscale("log")
            axes.set_xticks(range(len(types)), types)
            axes.set_title(f"{MATERIALS[key].name}, {section}", fontsize=9)
            label(axes, "", "error of a state, µm")
    _legend(figure)
    return figure


def _overlays(findings: Findings) -> Figure:
    """Draw figure 8: measured and simulated edges in the strongest field for each type of specimen."""
    keys, types = findings.inputs.extent.materials, findings.inputs.extent.types
    figure, grid = _grid(len(keys), len(types), max(3.0, 10.0 / len(types)), 3.2)
    for row, key in zip(grid, keys, strict=True):
        for axes, kind in zip(row, types, strict=True):
            measured = findings.edges[key, kind][-1]
            near = axes.inset_axes((0.5, 0.5, 0.5, 0.5))
            tip = measured[0, -1]
            near.set(xlim=tip[1] + _NEAR, ylim=-tip[0] + _NEAR, xticks=[], yticks=[])
            near.set_aspect("equal")
            for side in measured:
                axes.plot(side[:, 1], -side[:, 0], color="#999999", linewidth=4.0, label="measured")
            near.plot(measured[0, :, 1], -measured[0, :, 0], color="#999999", linewidth=4.0)
            for section, dashes in zip(SECTIONS, ("-", (0, (3, 2))), strict=True):
                tension = _best_tension(findings, key, section)
                for i, colour, words in (
                    (0, _OF_LAW["neo-hookean"], f"{findings.inputs.extent.laws[0]}, bending"),
                    (tension, _TENSION, "best by tension"),
                ):
                    edges = findings.errors[key, section, kind][i]["edges_mm"]
                    for side in np.array(edges or []):
                        for view in (axes, near):
                            line = {"color": colour, "linewidth": 1.0, "linestyle": dashes}
                            view.plot(side[:, 1], -side[:, 0], label=f"{words}, {section}", **line)
            axes.set_aspect("equal")
            axes.set_title(f"{MATERIALS[key].name}, {kind}", fontsize=8)
            label(axes, "across, mm", "along, mm")
    _legend(figure)
    return figure


_NEAR = np.array([-0.5, 0.5])  # mm from the tip


def _by_field(findings: Findings) -> Figure:
    """Draw figure 9: the mean error of each law against the field."""
    keys, kinds = findings.inputs.extent.materials, untwisted(findings)
    figure, grid = _grid(len(keys), len(SECTIONS), 4.6, 2.8)
    for row, key in zip(grid, keys, strict=True):
        for axes, section in zip(row, SECTIONS, strict=True):
            routes = findings.routes(key, section)
            best = _best_tension(findings, key, section)
            for i, route in enumerate(routes):
                if route.source != BENDING and i != best:
                    continue
                errors = [findings.errors[key, section, kind][i]["error_mm"] for kind in kinds]
                if None in errors:
                    continue
                by_tension = route.source != BENDING
                axes.plot(
                    findings.fields[key],
                    1e3 * np.mean(errors, axis=0),
                    "o-",
                    markersize=3,
                    color=_TENSION if by_tension else _OF_LAW[route.law],
                    label="best by tension" if by_tension else f"{route.law}, bending",
                )
            axes.set_yscale("log")
            axes.set_title(f"{MATERIALS[key].name}, {section}", fontsize=9)
            label(axes, "field, mT", "mean error, µm")
    _legend(figure)
    return figure

"""Measure the error of the modulus if one property of a simulated bench differs from its files.

python -m benchmarks.imperfect_rigs [--seeds N] [--short] [--both] [--measured] [--rendered] [--planar] [CAUSE...]
    [--first SEED] [--keep FOLDER] [--record FILE]

Such a property is an imperfection, for example a tilted camera; CAUSE selects imperfections by name. Two lines are
printed for each fit: the error of the modulus with its 95 % intervals, and the place of the true cause among the
causes that the fit compares, the most probable first. The last lines count these places.

--seeds     The number of seeds of the noise (by default 5); --short uses one seed.
--first     The first seed.
--both      Use 13 fields of both polarities, increasing and decreasing.
--measured  Make only the fits with the measured shape at rest, and none with the straight shape of the file.
--rendered  Find the edges in rendered pictures.
--planar    Use plane stress for the true beam and the fit, which takes a fifth of the time.
--keep      Keep the shapes of the true beams in a folder for later runs.
--record    Append a line of JSON for each fit to a file for `benchmarks.ranked_causes`.
"""

from __future__ import annotations

import argparse
import hashlib
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.ranked_causes import Ranked, summary
from benchmarks.rendered_rigs import clean_pictures, edges_in
from eimi_fitting.beam.beside import SolidBeside
from eimi_fitting.beam.coil_field import CoilShape, FieldTable
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.outline import outline, points_on
from eimi_fitting.beam.rest_modes import with_modes
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation
from eimi_fitting.inference.identification.whole_fit import identify
from eimi_fitting.inference.searching.measured_rest_shape import measured_rest_shape
from eimi_fitting.laws import LAWS
from eimi_lab.config.specimen import load_specimen

Array = NDArray[np.float64]

MODULUS_PA = 46390.0
MESH = (26, 3, 1)  # elements of the true solid along, across, and additional elements in each part of the depth
FIELD_MT = np.linspace(0.0, 7.05, 8)
BOTH_MT = 7.05 / 3 * np.array([0.0, 1.0, 2.0, 3.0, 2.0, 1.0, 0.0, -1.0, -2.0, -3.0, -2.0, -1.0, 0.0])
NOISE_MM = 0.002
STATED = load_specimen("bench_example")


@dataclass(frozen=True)
class Imperfection:
    """One property of a bench that differs from its files.

    Attributes
    ----------
    cause : str
        Name, as in `fits.json`; "none" for a perfect bench.
    words : str
        Size of the imperfection, in words.
    specimen : callable
        Returns the true specimen for the specimen in the file.
    loads : callable
        Returns the true loads for the loads in the files.
    picture : callable
        Maps true positions (..., 2), mm, to the positions that the camera shows, mm.
    is_clamp_seen : bool
        Whether `picture` also moves the clamp.
    """

    cause: str
    words: str
    specimen: Callable[[Specimen], Specimen] = lambda stated: stated
    loads: Callable[[Loads], Loads] = lambda stated: stated
    picture: Callable[[Array], Array] = lambda places: places
    is_clamp_seen: bool = True


def _tilted(stated: Specimen) -> Specimen:
    magnet = stated.magnet
    return stated if magnet is None else replace(stated, magnet=replace(magnet, magnetisation_angle_deg=3.0))


def _loop(loads: Loads) -> Loads:
    """Return the loads with the field of one current loop, which is strongest at one place of the beam."""
    table = FieldTable.of_loops(129.0, 0.0, (STATED.mechanics().field_place_mm, 0.0), (0.0, 1.0), 50.0)
    return replace(loads, coil=CoilShape((0.0, 1.0), table=table))


def _softer(loads: Loads, stiffness: Array) -> Loads:
    """Return the loads that bend the unchanged beam as far as ``loads`` bend a softer beam.

    ``stiffness``, shape (K,): stiffness of the softer beam in K states, divided by that of the unchanged beam.
    """
    field_T, gravity = (load / stiffness[:, None] for load in (loads.field_T, loads.gravity))
    return replace(loads, field_T=field_T, gravity=gravity)


def _back(loads: Loads) -> NDArray[np.bool_]:
    return np.diff(np.linalg.norm(loads.field_T, axis=1), prepend=-1.0) < 0


def _turned(degrees: float) -> Callable[[Array], Array]:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return lambda places: places @ np.array([[c, s], [-s, c]])


def _distorted(places: Array) -> Array:
    from_centre = places - _CENTRE_MM
    square = (from_centre**2).sum(axis=-1, keepdims=True)
    return _CENTRE_MM + from_centre * (1 + 0.01 * square / 20.0**2)


def _pitched(places: Array) -> Array:
    from_centre = places - _CENTRE_MM
    depth = from_centre[..., :1] * np.sin(np.radians(1.0))
    return _CENTRE_MM + from_centre * _STAND_OFF_MM / (_STAND_OFF_MM + depth)


_CENTRE_MM, _STAND_OFF_MM = np.array([15.0, 5.0]), 400.0
IMPERFECTIONS = (
    Imperfection("none", "perfect rig"),
    Imperfection("rest_shape", "cast with 1 mm of sag at the magnet", lambda stated: with_modes(stated, (1.0,))),
    Imperfection("taper", "2 % wider at the clamp than at the magnet", lambda stated: with_modes(stated, (), (-0.03,))),
    Imperfection("width", "0.05 mm narrower", lambda stated: replace(stated, width_mm=stated.width_mm - 0.05)),
    Imperfection("magnetisation_angle", "moment tilted by 3 deg", _tilted),
    Imperfection("moment", "moment 3 % weaker", loads=lambda loads: replace(loads, field_T=0.97 * loads.field_T)),
    Imperfection("field_gradient", "field 2 % lower at 15 mm from the middle of the coil", loads=_loop),
    Imperfection(
        "background_field",
        "0.05 mT across the beam",
        loads=lambda loads: replace(loads, field_T=loads.field_T + np.array([0.0, 5e-5])),
    ),
    Imperfection(
        "creep", "10 % softer at the end", loads=lambda loads: _softer(loads, 1 - 0.1 * np.linspace(0, 1, len(loads)))
    ),
    Imperfection(
        "hysteresis", "5 % softer on the way back", loads=lambda loads: _softer(loads, 1 - 0.05 * _back(loads))
    ),
    Imperfection("roll", "camera rolled by 1 deg", picture=_turned(1.0)),
    Imperfection(
        "clamp_angle",
        "clamp turned by 0.5 deg",
        loads=lambda loads: replace(loads, field_T=_turned(-0.5)(loads.field_T), gravity=_turned(-0.5)(loads.gravity)),
        picture=_turned(0.5),
    ),
    Imperfection("clamp_offset", "clamp beside its place by 0.1 mm", picture=lambda places: places + 0.1),
    Imperfection(
        "clamp_softness",
        "0.3 mm of further length in the clamp",
        lambda stated: replace(stated, length_mm=stated.length_mm + 0.3),
        picture=lambda places: places - np.array([0.3, 0.0]),
        is_clamp_seen=False,
    ),
    Imperfection("scale", "scale 1 % too large", picture=lambda places: 1.01 * places),
    Imperfection("distance", "5 mm nearer", picture=lambda places: places * _STAND_OFF_MM / (_STAND_OFF_MM - 5.0)),
    Imperfection("distortion", "1 % of radial distortion at 20 mm", picture=_distorted),
    Imperfection("camera_pitch", "camera pitched by 1 deg", picture=_pitched),
)


def together(first: Imperfection, second: Imperfection) -> Imperfection:
    """Return an imperfection that combines two imperfections."""
    return Imperfection(
        f"{first.cause}+{second.cause}",
        f"{first.words}; {second.words}",
        lambda stated: second.specimen(first.specimen(stated)),
        lambda loads: second.loads(first.loads(loads)),
        lambda places: second.picture(first.picture(places)),
        first.is_clamp_seen and second.is_clamp_seen,
    )


_BY_NAME = {imperfection.cause: imperfection for imperfection in IMPERFECTIONS}
PAIRS = tuple(
    together(_BY_NAME[first], _BY_NAME[second])
    for first, second in (
        ("magnetisation_angle", "creep"),
        ("rest_shape", "clamp_angle"),
        ("moment", "background_field"),
        ("width", "hysteresis"),
        ("field_gradient", "clamp_softness"),
        ("scale", "magnetisation_angle"),
    )
)


def bent(imperfection: Imperfection, field_mT: Array, planar: bool = False) -> tuple[Array, Array]:
    """Return the edges of the true beam and the corners of its magnet, as the camera shows them.

    field_mT: K fields, mT. planar: plane stress if true, else a solid.

    Returns
    -------
    edges : ndarray, shape (K, 2, m, 2)
        x and y (mm) of m points on the left and the right edge.
    corners : ndarray, shape (K, 4, 2)
        x and y (mm) of the corners.
    """
    specimen = imperfection.specimen(stated_specimen(planar))
    model = BeamModel(specimen, *MESH[:2]) if planar else SolidBeside(specimen, *MESH)
    loads = imperfection.loads(Loads.along(field_mT))
    curves = outline(model, model.solve(LAWS["neo-hookean"], np.array([[MODULUS_PA]]), loads, tolerance_mm=1e-3))[0]
    # The side of the magnet is the last segment of each edge.
    magnet = np.concatenate([curves[:, 0, -1, ::2], curves[:, 1, -1, ::-2]], axis=1)
    return imperfection.picture(points_on(curves, 4)), imperfection.picture(magnet)


def stated_specimen(planar: bool) -> Specimen:
    """Return the example specimen "bench_example", in plane stress if `planar` is true, else as a solid."""
    specimen = STATED.mechanics()
    return replace(specimen, section="plane-stress") if planar else specimen


def outlines(imperfection: Imperfection, field_mT: Array) -> Array:
    """Return the edges (mm) that the camera shows in K fields, without the points next to the clamp and the tip.

    The shape (K, 2, m, 2) means: K fields, left and right edge, m points, x and y.
    """
    return bent(imperfection, field_mT)[0][:, :, 8:-2]


def measured(edges: Array, field_mT: Array, seed: int, planar: bool = False) -> Experiment:
    """Add noise to simulated edges (mm), shape (K, 2, m, 2), in K fields (mT); return all inputs of a fit.

    The fit assumes plane stress if `planar` is true, else a solid.
    """
    noisy = edges + NOISE_MM * np.random.default_rng(seed).normal(size=edges.shape)
    sigma = np.full(edges.shape[2], NOISE_MM)
    observed = EdgeObservation.from_edges([(left, sigma, right, sigma) for left, right in noisy])
    return _experiment(observed, field_mT, planar)


def _experiment(observed: EdgeObservation, field_mT: Array, planar: bool) -> Experiment:
    specimen = stated_specimen(planar)
    flat = BeamModel(specimen, plane=specimen.planar_section).refined()
    return Experiment(flat, Loads.along(field_mT), observed, stated=STATED.stated_sources())


def kept(imperfection: Imperfection, field_mT: Array, planar: bool, folder: Path | None) -> tuple[Array, Array]:
    # Return the edges and corners of the beam with an imperfection, from a file if an earlier run wrote it.
    if folder is None:
        return bent(imperfection, field_mT, planar)
    key = hashlib.sha256(repr((imperfection.words, MESH, MODULUS_PA, field_mT.tolist(), planar)).encode()).hexdigest()
    path = folder / f"{imperfection.cause}-{key[:12]}.npz"
    if not path.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        edges, corners = bent(imperfection, field_mT, planar)
        np.savez(path, edges=edges, corners=corners)
    with np.load(path) as stored:
        return stored["edges"], stored["corners"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("causes", nargs="*", metavar="CAUSE", help="rows to compute; default: all")
    parser.add_argument("--seeds", type=int, default=5, help="number of seeds of the noise")
    parser.add_argument("--first", type=int, default=1, help="the first seed")
    parser.add_argument("--short", action="store_true", help="use only one seed")
    parser.add_argument("--both", action="store_true", help="use both polarities, and increase and decrease")
    parser.add_argument("--measured", action="store_true", help="fit only with the measured rest shape")
    parser.add_argument("--rendered", action="store_true", help="find the edges in rendered pictures")
    parser.add_argument("--planar", action="store_true", help="simulate and fit beams in plane stress")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="keep the shapes of the true beams in a folder")
    parser.add_argument("--record", type=Path, metavar="FILE", help="append one line of JSON for each fit to a file")
    asked = parser.parse_args()
    field_mT, results = BOTH_MT if asked.both else FIELD_MT, []
    for imperfection in (*IMPERFECTIONS, *PAIRS):
        if asked.causes and imperfection.cause not in asked.causes:
            continue
        shown = kept(imperfection, field_mT, asked.planar, asked.keep)
        clamp = imperfection.picture if imperfection.is_clamp_seen else lambda places: places
        pictures = clean_pictures(*shown, clamp) if asked.rendered else []
        for seed in range(asked.first, asked.first + (1 if asked.short else asked.seeds)):
            if asked.rendered:
                observed, used = edges_in(pictures, STATED, seed)
                straight = _experiment(observed, field_mT[used], asked.planar)
            else:
                straight = measured(shown[0][:, :, 8:-2], field_mT, seed, asked.planar)
            shape = measured_rest_shape(straight)
            cases = {"straight": straight, "measured": shape.applied(straight) if shape else straight}
            for words, experiment in cases.items():
                if words == "straight" and asked.measured:
                    continue
                start_s = time.perf_counter()
                fit = identify("neo-hookean", [experiment])
                results.append(Ranked.of(fit, imperfection.cause, seed, words, MODULUS_PA))
                print(f"{results[-1].in_words()}  ({time.perf_counter() - start_s:.0f} s)", flush=True)
                if asked.record:
                    with asked.record.open("a", encoding="utf-8") as file:
                        file.write(results[-1].as_json() + "\n")
    print(summary(results))


if __name__ == "__main__":
    main()

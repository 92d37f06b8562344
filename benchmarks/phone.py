"""Measure the error of the modulus from rendered phone photographs of a beam that is bent by weights.

    python -m benchmarks.phone [--scenes 20] [--share SHARE] [-o FOLDER]

A scene is one beam in several photographs, with random errors of the typed sizes and of the clicks. The table shows the
error of the modulus, the half-width of its 95 % interval, and whether the interval contains the true modulus. The goals
are errors below 5 %, and 19 of 20 intervals that contain the true modulus. With --share 1 the
photographs have 4032 x 3024 px; --share 0.5 halves their width and height.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import eimi_lab as eimi
from eimi_lab.page import by_weights
from tests.shared.phone_photographs import RULER_MM, bent_bodies, clicks, drawn_scene, measured_sizes, photograph

LARGEST_ERROR_PERCENT = 5.0


@dataclass(frozen=True)
class Outcome:
    """The fit of one scene.

    Attributes
    ----------
    hidden_Pa, fitted_Pa : float
        True and fitted initial shear modulus, Pa.
    interval_95 : tuple of float
        95 % interval of the fitted modulus, Pa.
    typed : int
        Number of values that a person would type.
    edges_s, rest_s : float
        Processor times of the edges in the first photograph and of all later steps, s.
    flags : tuple of str
        Names of the warnings about the edges.
    doubts : int
        Number of warnings of the fit.
    """

    hidden_Pa: float
    fitted_Pa: float
    interval_95: tuple[float, float]
    typed: int
    edges_s: float
    rest_s: float
    flags: tuple[str, ...]
    doubts: int

    @property
    def error_percent(self) -> float:
        return 100.0 * (self.fitted_Pa / self.hidden_Pa - 1.0)

    @property
    def in_words(self) -> str:
        half = 50.0 * (self.interval_95[1] - self.interval_95[0]) / self.fitted_Pa
        times = f"{self.edges_s:7.2f}  {self.rest_s:6.1f}  {' '.join(self.flags)}"
        moduli = f"{self.hidden_Pa / 1e3:10.2f}  {self.fitted_Pa / 1e3:10.2f}  {self.error_percent:7.2f}"
        return f"{moduli}  {half:12.2f}  {'yes' if self.holds else 'NO':5}  {times}"

    @property
    def holds(self) -> bool:
        return self.interval_95[0] <= self.hidden_Pa <= self.interval_95[1]


def outcome(seed: int, share: float, folder: Path) -> Outcome:
    """Render the photographs of one scene into a folder, and fit the beam; `share` scales the photographs."""
    scene = drawn_scene(seed, share)
    bodies = bent_bodies(scene)
    folder.mkdir(parents=True, exist_ok=True)
    grams = {}
    for number, (body, weight) in enumerate(zip(bodies, scene.grams, strict=True)):
        name = f"IMG_{1000 + number}.jpg"
        (folder / name).write_bytes(photograph(scene, body, weight, number))
        grams[name] = f"{weight:g}"
    rng = np.random.default_rng([seed, 5])
    sizes = {key: f"{value:g}" for key, value in measured_sizes(scene, rng).items()}
    sigmas = {"length_mm_sigma": "0.2", "width_mm_sigma": "0.02", "depth_mm_sigma": "0.03"}
    clicked = clicks(scene, bodies[0].tip, RULER_MM, rng, 0.5 + share)
    began = time.process_time()
    shown = by_weights.edges(folder / "IMG_1000.jpg", clicked, sizes | sigmas)
    edges_s = time.process_time() - began
    began = time.process_time()
    saved = by_weights.saved(folder, clicked, sizes | sigmas, grams, replace=True)
    fit = eimi.fit(folder / saved["dataset"], model="neo-hookean", free=list(by_weights.FREED))
    with eimi.open(folder / saved["dataset"]) as dataset:
        names = {flag.name for state in dataset.edges() or () for flag in state.flags}
    names |= {flag["name"] for flag in shown["flags"]}
    modulus = fit.initial_shear_modulus
    assert modulus.interval_95 is not None
    return Outcome(
        scene.modulus_Pa,
        modulus.value,
        modulus.interval_95,
        len(sizes) + len(grams) + 1,
        edges_s,
        time.process_time() - began,
        tuple(sorted(names)),
        len(fit.doubts_in_words()),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="seed of the first scene")
    parser.add_argument(
        "--share", type=float, default=0.5, help="size of the photographs, as a share of 4032 x 3024 px"
    )
    parser.add_argument("-o", "--output", type=Path, help="folder that keeps photographs and files")
    options = parser.parse_args()
    print("scene  hidden kPa  fitted kPa  error %  half-width %  holds  edges s  rest s  flags")
    outcomes = []
    with tempfile.TemporaryDirectory() as temporary:
        for seed in range(options.first, options.first + options.scenes):
            try:
                result = outcome(seed, options.share, (options.output or Path(temporary)) / f"scene_{seed}")
            except eimi.InputError as error:
                print(f"{seed:5d}  refused: {error}", flush=True)
                continue
            outcomes.append(result)
            print(f"{seed:5d}  {result.in_words}", flush=True)
    if not outcomes:
        raise SystemExit("no scene was fitted")
    errors = np.abs([one.error_percent for one in outcomes])
    print(
        f"{len(outcomes)} of {options.scenes} scenes fitted, {options.scenes - len(outcomes)} refused; "
        "a refused scene counts as not below the limit, and its interval as one that does not hold"
    )
    print(
        f"errors: median {np.median(errors):.2f} %, largest {errors.max():.2f} %, "
        f"{int((errors < LARGEST_ERROR_PERCENT).sum())} of {options.scenes} below {LARGEST_ERROR_PERCENT:g} %; "
        f"{sum(one.holds for one in outcomes)} of {options.scenes} intervals hold the hidden modulus; "
        f"{outcomes[0].typed} typed values each"
    )


if __name__ == "__main__":
    main()

"""Measure the edges found in rendered photographs with one difficulty each: ``python -m benchmarks.lab_photographs``.

The difficulties are glare, a ruler, a second beam, a hand, a hard shadow, and motion. A picture is

refused  if no edges are returned or a warning marks the edges as unusable,
good     if the edges have an error (root mean square) of at most 0.07 beam widths,
doubted  if the error is larger and a warning marks the edges as doubtful,
silent   if the error is larger and there is no warning. The goal is that no picture is silent.

A picture of the kind ``lookalike`` shows no beam, and must be refused or doubted. ``--pictures N`` sets the number of
pictures of each kind (by default 6), ``--seed`` the seed, and ``--kind NAME`` the kinds. ``--draw FOLDER`` draws the
detected edges.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.edges.finding import find_edges
from eimi_lab.vision.edges.overlay import draw_overlay
from tests.shared.lab_difficulties import KINDS
from tests.shared.lab_photographs import lab_photograph, stated, verdict

Array = NDArray[np.float64]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pictures", type=int, default=6)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kind", nargs="*", default=list(KINDS), choices=list(KINDS))
    parser.add_argument("--draw", type=Path)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    print("| kind | good | doubted | refused | silent | median error px | ms | silent ones |\n|" + " --- |" * 8)
    for name in options.kind:
        counts: Counter[str] = Counter()
        errors, seconds, silent = [], [], []
        for number in range(options.pictures):
            rng = np.random.default_rng([options.seed, list(KINDS).index(name), number])
            image, scene = lab_photograph(name, rng)
            calibration, specimen = stated(scene, rng)
            begin = time.process_time()
            edges = find_edges(image, calibration, specimen)
            seconds.append(time.process_time() - begin)
            judgement, error = verdict(name, scene, edges, calibration)
            counts[judgement] += 1
            if judgement == "good":
                errors.append(error * scene.width_px)
            if judgement == "silent":
                silent.append(f"{number} ({error:.2f})")
            if options.draw:
                options.draw.mkdir(parents=True, exist_ok=True)
                drawn = draw_overlay(image, edges, calibration)
                cv2.imwrite(str(options.draw / f"{name.replace(' ', '_')}_{number}_{judgement}.jpg"), drawn)
        figures = " | ".join(str(counts[key]) for key in ("good", "doubted", "refused", "silent"))
        median = float(np.median(errors)) if errors else np.nan
        print(
            f"| {name} | {figures} | {median:.2f} | {1e3 * np.median(seconds):.0f} | {' '.join(silent)} |", flush=True
        )


if __name__ == "__main__":
    main()

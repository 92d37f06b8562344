"""Measure edges in rendered photographs with one difficulty each: ``python -m benchmarks.lab_photographs``.

The beams have a known shape, a random colour and a random bend. Each picture has one difficulty of real photographs:
glare, a ruler beside the beam, a second beam, a hand, a hard shadow, motion. ``--pictures N`` sets the number of
pictures of each kind (by default 6), ``--seed`` the seed. ``--kind NAME`` selects one or more kinds. ``--draw FOLDER``
writes each picture with the detected edges.

A flag is a warning about the edges, either "unusable" or "doubtful". A picture is *refused* if no edges are returned or
a flag marks the edges as unusable. Otherwise the picture is *good* if the error of the edges is at most 0.07 of the
beam's width (root mean square). If the error is larger, the picture is *doubted* if a flag marks the edges as doubtful,
and *silent* if no flag does. No picture may be silent. The kind ``lookalike`` shows no beam. A picture of this kind is
silent if edges are returned without a doubtful flag.
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

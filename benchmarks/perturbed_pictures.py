"""Measure how well edges are found in real photographs that were changed: ``python -m benchmarks.perturbed_pictures``.

The changes are scale, brightness, noise, a gradient of the light, hue, mirror, JPEG compression and blur. The result is
compared with edges that a person traced. A picture gets the first verdict that applies:

refused  no edges are returned, or a warning marks the edges as unusable
silent   there is no warning, but the distance (root mean square) from the traced edges is more than three uncertainties
         of the traced edges; no picture may be silent
right    the edges are good by the rules of `benchmarks.real_pictures`
doubted  a warning marks the edges as doubtful
poor     no warning; not silent, but there are too few edge points, or the distances are too large to be right

--change NAME     Make only the change NAME (may be given several times).
--overlay FOLDER  Draw the detected edges of all pictures that are not right.
"""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path

import cv2

from eimi_lab.vision.check import Severity
from eimi_lab.vision.edges.edge_set import EdgeSet
from eimi_lab.vision.edges.overlay import draw_overlay
from tests.shared.perturbed_pictures import CHANGES, perturbed
from tests.shared.real_pictures import PICTURES, PictureScore, pictures

_VERDICTS = ("right", "doubted", "refused", "poor", "silent")


def verdict(edges: EdgeSet, scored: PictureScore) -> str:
    """Return the verdict (see the module) on the edges that were found in a changed photograph, such as ``right``."""
    severities = {flag.severity for flag in edges.flags}
    if not len(edges.left.points_mm) or Severity.UNUSABLE in severities:
        return "refused"
    if scored.silent(edges):
        return "silent"
    if scored.good:
        return "right"
    return "doubted" if Severity.DOUBTFUL in severities else "poor"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--change", action="append", choices=list(CHANGES))
    parser.add_argument("--overlay", type=Path)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    if not PICTURES.is_dir():
        print(f"{PICTURES} is not there: nothing to measure")
        return
    print(f"| change | {' | '.join(_VERDICTS)} | not right |\n|" + " --- |" * (len(_VERDICTS) + 2))
    total: Counter[str] = Counter()
    originals = list(pictures("development"))
    for name in options.change or CHANGES:
        counts: Counter[str] = Counter()
        others = []
        for picture in originals:
            changed = perturbed(picture, name)
            edges = changed.edges()
            scored = picture.score(edges, picture.calibration)
            judgement = verdict(edges, scored)
            counts[judgement] += 1
            if judgement == "right":
                continue
            figures = f"{scored.coverage:.2f}, {scored.median:.2f} px, {scored.p95:.2f} px"
            others.append(f"{picture.name} {judgement}" + (f" ({figures})" if judgement != "refused" else ""))
            if options.overlay:
                options.overlay.mkdir(parents=True, exist_ok=True)
                drawn = draw_overlay(changed.image, edges, changed.calibration)
                cv2.imwrite(str(options.overlay / f"{picture.name}_{name.replace(' ', '_')}.png"), drawn)
        total += counts
        figures = " | ".join(str(counts[key]) for key in _VERDICTS)
        print(f"| {name} | {figures} | {'; '.join(others)} |", flush=True)
    print(f"| all | {' | '.join(str(total[key]) for key in _VERDICTS)} | |")


if __name__ == "__main__":
    main()

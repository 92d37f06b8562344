"""Detect edges in other people's photographs that were changed: ``python -m benchmarks.perturbed_pictures``.

The changes are those of a camera, a lamp or a program for pictures: scale, brightness, noise, a gradient of the light,
hue, mirror, JPEG compression and blur (`tests.shared.perturbed_pictures`). The detected edges are compared with the
edges that a person traced in the original photograph (see `benchmarks.real_pictures`). Distances between them are in px
of the original photograph.

The first verdict of this list that applies is the verdict of a picture:

refused  no edges are returned, or a flag marks them as unusable
silent   no flag marks the edges as doubtful, but their distance from the traced edges is more than three uncertainties
         of the traced edges (root mean square); no picture may be silent
right    the edges are good by the rules of `benchmarks.real_pictures`
doubted  a flag marks the edges as doubtful
thin     the rules are not met: there are too few points, or the distances are too large

--change NAME     Make only the change NAME; the option may be given several times.
--overlay FOLDER  Draw the detected edges of the pictures that are not right into pictures in a folder.
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

_VERDICTS = ("right", "doubted", "refused", "thin", "silent")


def verdict(edges: EdgeSet, scored: PictureScore) -> str:
    """Return whether the detected edges of a changed photograph are good enough, as one of five words.

    The words are "refused" (no usable edges), "silent" (wrong edges without a warning), "right", "doubted" (a warning)
    and "thin" (too few points or too large distances).
    """
    severities = {flag.severity for flag in edges.flags}
    if not len(edges.left.points_mm) or Severity.UNUSABLE in severities:
        return "refused"
    if scored.silent(edges):
        return "silent"
    if scored.good:
        return "right"
    return "doubted" if Severity.DOUBTFUL in severities else "thin"


def main() -> None:
    """Detect the edges in the changed photographs; print for each change how many are right, and how many are not."""
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

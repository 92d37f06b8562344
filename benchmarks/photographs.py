"""Measure the error of edges in rendered photographs of coloured beams: ``python -m benchmarks.photographs``.

The background is cluttered, and the light is uneven. ``--pictures N`` sets the number of pictures (by default 200).
``--kind`` selects the kinds of pictures (by default all five in turn).
"""

from __future__ import annotations

import argparse

import cv2
import numpy as np

from tests.shared.photographs import KINDS, WRONG_PX, run

# Error of the edges (px, root mean square) that the table counts. Pictures without a shadow, a reflection or clipped
# light have smaller errors.
_OFF_PX = 0.5


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pictures", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kind", nargs="*", default=list(KINDS), choices=list(KINDS))
    options = parser.parse_args()
    cv2.setNumThreads(1)
    outcomes = run(options.pictures, options.seed, options.kind)
    print(f"| kind | pictures | used | wrong | silent | beyond {_OFF_PX} px, no doubt | RMS px | worst | pull | ms |")
    print("| --- " * 10 + "|")
    for kind in (*options.kind, "all"):
        group = [outcome for outcome in outcomes if kind in (outcome.kind, "all")]
        used = [outcome for outcome in group if outcome.usable]
        wrong = sum(outcome.rms_px > WRONG_PX for outcome in used)
        silent = sum(outcome.rms_px > WRONG_PX and not outcome.doubtful for outcome in used)
        right = [outcome for outcome in used if outcome.rms_px <= WRONG_PX]
        rms = np.sqrt(np.mean([outcome.rms_px**2 for outcome in right])) if right else np.nan
        pull = np.sqrt(np.mean([outcome.pull**2 for outcome in right])) if right else np.nan
        worst = max((outcome.rms_px for outcome in right), default=np.nan)
        ms = 1e3 * np.median([outcome.seconds for outcome in group])
        off = sum(outcome.rms_px > _OFF_PX and not outcome.doubtful for outcome in used)
        counts = f"{len(group)} | {len(used)} | {wrong} | {silent} | {off}"
        print(f"| {kind} | {counts} | {rms:.3f} | {worst:.2f} | {pull:.2f} | {ms:.0f} |")


if __name__ == "__main__":
    main()

"""Draw one rendered picture for each warning (flag) about edges: ``python -m benchmarks.flag_pictures FILE.jpg``.

The script also prints the table of flags in docs/why/edges.md.
"""

from __future__ import annotations

import sys

import cv2

from eimi_lab.vision.edges.overlay import contact_sheet, draw_overlay
from eimi_lab.vision.flags import CHECKS
from tests.shared.flag_pictures import CASES, table

_SHEET_PX = (520, 440)


def main() -> None:
    print(table())
    shown = [check for check in CHECKS if check.picture]
    cases = [CASES[check.name]() for check in shown]
    pictures = [draw_overlay(case.image, case.edges(), case.calibration) for case in cases]
    sheet = contact_sheet(pictures, [f"{check.name}: {check.picture}" for check in shown], _SHEET_PX)
    cv2.imwrite(sys.argv[1], sheet, [cv2.IMWRITE_JPEG_QUALITY, 60])


if __name__ == "__main__":
    main()

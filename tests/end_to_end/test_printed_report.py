"""A printed report has no page with much empty space, except the last page."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks import report_pictures

Done = Callable[..., list[str]]

MARGIN = 15 / 297  # height of the margin at the top and at the bottom of an A4 page, relative to the page


def used_share(sheet: Path) -> float:
    # Return the used share of the height of a page, from the upper margin to the lowest text or line.
    dark = cv2.imread(str(sheet), cv2.IMREAD_GRAYSCALE) < 250
    lowest = float(np.flatnonzero(dark.any(axis=1)).max(initial=0)) / len(dark)
    return (lowest - MARGIN) / (1 - 2 * MARGIN)


@pytest.mark.skipif(not shutil.which("pdftoppm"), reason="needs pdftoppm: install poppler-utils")
@pytest.mark.skipif(
    not any(map(shutil.which, report_pictures.BROWSERS)), reason="needs a browser: install Debian's chromium"
)
def test_every_printed_page_but_the_last_is_used_to_more_than_60_per_cent(
    done: Done, folder: Path, tmp_path: Path
) -> None:
    laws = [word for law in ("neo-hookean", "mooney-rivlin", "yeoh") for word in ("--model", law)]
    done("fit", "train.h5", *laws, "-o", "three.json", folder=folder)
    done("report", "train.h5", "unseen.h5", "--fit", "three.json", "-o", "printed.html", folder=folder)
    _, *sheets = report_pictures.printed(folder / "printed.html", tmp_path)
    assert len(sheets) > 2
    shares = [used_share(sheet) for sheet in sheets]
    assert min(shares[:-1]) > 0.6, [round(share, 2) for share in shares]

"""Draw pictures of a report for inspection: ``python -m benchmarks.report_pictures report.html -o FOLDER``.

Chromium draws the whole page 1400 and 800 px wide, and prints it on A4. With `pdftoppm` (poppler), each printed sheet
becomes a picture.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image, ImageChops

WIDTHS_PX = (1400, 800)
_TALL_PX = 16000  # height of the window, more than the height of any report; the empty part is cut off
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
_TIMEOUT_S = 300


def browser() -> str:
    """Return the path of Chromium; exit with a message if no browser is installed."""
    path_of_browser = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if path_of_browser is None:
        sys.exit(f"needs one of {', '.join(BROWSERS)}")
    return path_of_browser


def chromium(page: Path, *how: str) -> None:
    # Start Chromium with a page and the options `how`, which say whether the page is drawn or printed.
    with tempfile.TemporaryDirectory() as profile:
        plain = ("--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", f"--user-data-dir={profile}")
        line = [browser(), *plain, *how, page.resolve().as_uri()]
        subprocess.run(line, check=True, capture_output=True, timeout=_TIMEOUT_S)


def screen(page: Path, folder: Path, width: int) -> Path:
    """Draw the whole page `width` px wide, cut the empty bottom off, and return the path of the picture."""
    path = folder / f"{page.stem}_{width}.png"
    chromium(page, f"--window-size={width},{_TALL_PX}", f"--screenshot={path}")
    with Image.open(path) as whole:
        shown = whole.convert("RGB")
    box = ImageChops.difference(shown, Image.new("RGB", shown.size, "white")).getbbox()
    shown.crop((0, 0, width, box[3] + 20 if box else shown.height)).save(path)
    return path


def printed(page: Path, folder: Path) -> list[Path]:
    """Print the page on A4; return the PDF file and, with `pdftoppm`, a picture of every sheet."""
    pdf = folder / f"{page.stem}.pdf"
    chromium(page, "--no-pdf-header-footer", f"--print-to-pdf={pdf}")
    if not shutil.which("pdftoppm"):
        print("pdftoppm is not installed: no pictures of the sheets", file=sys.stderr)
        return [pdf]
    subprocess.run(["pdftoppm", "-r", "80", "-png", pdf, folder / f"{page.stem}_sheet"], check=True, timeout=_TIMEOUT_S)
    return [pdf, *sorted(folder.glob(f"{page.stem}_sheet*.png"))]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("page", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder; it is created if missing")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    for width in WIDTHS_PX:
        print(screen(options.page, options.output, width))
    print(*printed(options.page, options.output), sep="\n")


if __name__ == "__main__":
    main()

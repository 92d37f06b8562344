"""Pictures of a report, to be looked at: ``python -m benchmarks.report_pictures report.html -o FOLDER``.

Headless Chromium takes the whole page 1400 and 800 px wide and prints it on A4; `pdftoppm` (poppler) makes a picture of
every printed page. Look for: a heading without its figure, a table or figure that is cut, text that is too small at 800
px, colours that mean something by themselves.
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
_TALL_PX = 16000  # more than any report; what is below the page is cut off
_BROWSERS = ("chromium", "chromium-browser", "google-chrome")
_TIMEOUT_S = 300


def browser() -> str:
    """The path of a Chromium. Exits with a line where there is none."""
    found = next((path for name in _BROWSERS if (path := shutil.which(name))), None)
    if found is None:
        sys.exit(f"needs one of {', '.join(_BROWSERS)}")
    return found


def chromium(page: Path, *how: str) -> None:
    """One run of the browser on a page, with a profile of its own."""
    with tempfile.TemporaryDirectory() as profile:
        plain = ("--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", f"--user-data-dir={profile}")
        line = [browser(), *plain, *how, page.resolve().as_uri()]
        subprocess.run(line, check=True, capture_output=True, timeout=_TIMEOUT_S)


def screen(page: Path, folder: Path, width: int) -> Path:
    """The whole page as wide as a window, without the empty part below."""
    path = folder / f"{page.stem}_{width}.png"
    chromium(page, f"--window-size={width},{_TALL_PX}", f"--screenshot={path}")
    with Image.open(path) as whole:
        shown = whole.convert("RGB")
    box = ImageChops.difference(shown, Image.new("RGB", shown.size, "white")).getbbox()
    shown.crop((0, 0, width, box[3] + 20 if box else shown.height)).save(path)
    return path


def printed(page: Path, folder: Path) -> list[Path]:
    """The page on A4, and a picture of every sheet where `pdftoppm` is installed."""
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
    parser.add_argument("-o", "--output", type=Path, required=True, help="a folder, made where it is missing")
    given = parser.parse_args()
    given.output.mkdir(parents=True, exist_ok=True)
    for width in WIDTHS_PX:
        print(screen(given.page, given.output, width))
    print(*printed(given.page, given.output), sep="\n")


if __name__ == "__main__":
    main()

"""Write docs/gallery.md, which shows the docstring, the picture and the code of each numbered script in examples/.

python docs/scripts/gallery.py
"""

from __future__ import annotations

import ast
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "gallery.md"
TITLES = {
    "06_try_a_protocol_dry": "Test a protocol without instruments",
    "10_what_the_data_fix": "What the data determine",
}
"""Titles of scripts whose names are not clear enough as titles."""

INTRODUCTION = """# Gallery

These are ten short scripts. Each runs on its own, needs no instrument and prints a few numbers. For example, run
`python examples/01_bend_a_beam.py`. `docs/scripts/gallery_pictures.py` draws the pictures.

There are also two notebooks: [Bend a beam](notebooks/bend_a_beam.ipynb) and
[Fit tracked points](notebooks/fit_tracked_points.ipynb).
"""


def page() -> str:
    """Return the text of the page."""
    return INTRODUCTION + "".join(map(_entry, sorted((ROOT / "examples").glob("[0-9]*.py"))))


def _entry(script: Path) -> str:
    """Return the section of the page about one script."""
    text = script.read_text(encoding="utf-8")
    words = ast.get_docstring(ast.parse(text)) or ""
    title = TITLES.get(script.stem) or script.stem[3:].replace("_", " ").capitalize()
    code = text.split('"""', 2)[2].strip()
    return (
        f"\n## {title}\n\n{words}\n\n![{title}](gallery/{script.stem}.png)\n\n"
        f"`examples/{script.name}`\n\n```python\n{code}\n```\n"
    )


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")

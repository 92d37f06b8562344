"""Draw the equations in the pages of the documentation: a hook of MkDocs, listed in mkdocs.yml.

An equation is a fenced block of the kind ``math`` that contains TeX. GitHub draws the equation when it shows the
Markdown file. For the web site, this hook draws the equation with matplotlib as SVG inside the page. A page therefore
loads nothing from another host.
"""

from __future__ import annotations

import html
from typing import Any

from matplotlib import rc_context
from matplotlib.path import Path
from matplotlib.textpath import TextPath

FONT_SIZE_PT = 12.0
PIXELS_PER_PT = 1.45
MARGIN_PT = 2.0
COMMANDS = {Path.MOVETO: "M", Path.LINETO: "L", Path.CURVE3: "Q", Path.CURVE4: "C", Path.CLOSEPOLY: "Z"}


def on_config(config: Any) -> Any:
    """Add the drawing of ``math`` blocks to the configuration of MkDocs, and return the configuration."""
    fences = config["mdx_configs"].setdefault("pymdownx.superfences", {}).setdefault("custom_fences", [])
    fences.append({"name": "math", "class": "math", "format": block})
    return config


def block(source: str, *_: object, **__: object) -> str:
    """Return the HTML of a ``math`` block. All lines of the block are joined to one equation."""
    return f'<div class="math">{equation(" ".join(source.split()))}</div>'


def equation(tex: str) -> str:
    """Return an equation in TeX as the text of an SVG picture, with the TeX as its description for screen readers."""
    with rc_context({"mathtext.fontset": "stix"}):
        outline = TextPath((0.0, 0.0), f"${tex}$", size=FONT_SIZE_PT)
    box = outline.get_extents().padded(MARGIN_PT)
    drawing = "".join(
        COMMANDS[code] + ("" if code == Path.CLOSEPOLY else " ".join(f"{number:.2f}" for number in points))
        for points, code in outline.iter_segments(simplify=False)
    )
    return (
        f'<svg role="img" aria-label="{html.escape(tex)}" fill="currentColor" '
        f'width="{box.width * PIXELS_PER_PT:.0f}" height="{box.height * PIXELS_PER_PT:.0f}" '
        f'viewBox="{box.x0:.2f} {-box.y1:.2f} {box.width:.2f} {box.height:.2f}" '
        f'style="display:block;margin:0.6em 1.5em;max-width:94%;height:auto">'
        f'<path transform="scale(1,-1)" d="{drawing}"/></svg>'
    )

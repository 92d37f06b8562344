"""Draw the equations of the site: a hook of MkDocs, named in mkdocs.yml.

An equation is a fenced block of the kind ``math`` and holds TeX. GitHub draws such blocks when it shows a Markdown
file. On the site matplotlib draws them as SVG inside the page, so that a page loads nothing from another host.
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
    """Register the drawing of blocks of the kind ``math`` with the Markdown of the site."""
    fences = config["mdx_configs"].setdefault("pymdownx.superfences", {}).setdefault("custom_fences", [])
    fences.append({"name": "math", "class": "math", "format": block})
    return config


def block(source: str, *_: object, **__: object) -> str:
    """Return the HTML of one block; its lines are one equation."""
    return f'<div class="math">{equation(" ".join(source.split()))}</div>'


def equation(tex: str) -> str:
    """Return one equation as an SVG picture in the colour of the text, with its TeX for those who cannot see it."""
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

"""Colours, markers and lines of every picture of results; without what draws, which is slow to import."""

from __future__ import annotations

from typing import Any

# Okabe and Ito's palette, told apart by readers with any colour vision (jfly.uni-koeln.de/color, 2008); the pair that
# looks like red and green comes last. Black is for what was measured.
PALETTE = ("#0072B2", "#E69F00", "#CC79A7", "#56B4E9", "#D55E00", "#009E73", "#F0E442")
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
LINES: tuple[Any, ...] = ("-", "--", ":", "-.", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 3)))
MEASURED = "#000000"
IN_ORDER = "cividis"  # colours of an ordered quantity (Nunez, Anderton, Renslow 2018, PLoS ONE 13:e0199239)
OF_TWO_SIGNS = "PuOr"  # and of one that may be negative (colorbrewer2.org, safe for colour vision)

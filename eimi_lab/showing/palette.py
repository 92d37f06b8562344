"""Colours, markers and line styles of all figures of results."""

# This module does not import matplotlib, which loads slowly.

from __future__ import annotations

from typing import Any

# The palette of Okabe and Ito, which readers with any colour vision can distinguish (jfly.uni-koeln.de/color, 2008),
# without its second blue. Measured data are black.
PALETTE = ("#0072B2", "#E69F00", "#CC79A7", "#009E73", "#D55E00", "#F0E442")
MARKERS = ("o", "s", "^", "D", "v", "P")
LINES: tuple[Any, ...] = ("-", "--", ":", "-.", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 3)))
MEASURED = "#000000"
IN_ORDER = "cividis"  # colours of an ordered quantity (Nunez, Anderton, Renslow 2018, PLoS ONE 13:e0199239)
OF_TWO_SIGNS = "PuOr"  # colours of a quantity with either sign (colorbrewer2.org, safe for any colour vision)

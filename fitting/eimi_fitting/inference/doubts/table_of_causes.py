"""List all systematic errors that may explain the residuals of a fit."""

from __future__ import annotations

from eimi_fitting.inference.doubts.causes_in_loads import CAUSES_IN_LOADS
from eimi_fitting.inference.doubts.causes_in_pictures import CAUSES_IN_PICTURES
from eimi_fitting.inference.doubts.causes_in_specimens import CAUSES_IN_SPECIMENS
from eimi_fitting.inference.doubts.possible_causes import PossibleCause

POSSIBLE_CAUSES: tuple[PossibleCause, ...] = (*CAUSES_IN_PICTURES, *CAUSES_IN_SPECIMENS, *CAUSES_IN_LOADS)

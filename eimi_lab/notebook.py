"""The suite in a notebook: the functions behind the commands, under one name to import from.

Fits and validations show themselves as tables and turn into pandas.DataFrame by `to_pandas()`; an open dataset turns
into xarray.Dataset by `to_xarray()`.
"""

from eimi_lab.dataset.reading import open_dataset
from eimi_lab.identification.experiments import load_evidence
from eimi_lab.identification.fits import read_any_fits, write_fits
from eimi_lab.identification.fitting import fit_evidence
from eimi_lab.identification.tensile import fit_window, read_tensile
from eimi_lab.identification.validation import validate

__all__ = [
    "fit_evidence",
    "fit_window",
    "load_evidence",
    "open_dataset",
    "read_any_fits",
    "read_tensile",
    "validate",
    "write_fits",
]

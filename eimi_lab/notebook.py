"""The suite in a notebook: the functions behind the commands, under one name to import from.

Datasets, evidence, fits and validations show themselves as tables, and draw themselves by `plot()`, a matplotlib figure
that a notebook shows as it is. Fits and validations turn into pandas.DataFrame by `to_pandas()`, an open dataset into
xarray.Dataset by `to_xarray()`.
"""

from eimi_lab.dataset.reading import open_dataset
from eimi_lab.fits.evidence import load_evidence
from eimi_lab.fits.fits_file import read_any_fits, write_fits
from eimi_lab.fits.fitting import fit_evidence
from eimi_lab.fits.prediction import validate
from eimi_lab.fits.tensile_files import read_tensile
from eimi_lab.fits.tensile_fits import fit_window

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

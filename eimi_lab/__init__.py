"""Identify a soft material from pictures of a bent beam: `import eimi_lab as eimi`, or `eimi` on the command line.

`open`, `acquire`, `import_pictures`, `import_points`, `import_motion` and `segment` make or open a dataset. `fit`,
`open_fits`, `tensile`, `discover` and `Prior` lead from datasets to laws. `simulate`, `validate`, `plan`, `report` and
`export` use a law, and `publish` archives it. `LAWS`, `SUPPLIES` and `CAMERAS` are tables of all laws, supply drivers
and camera drivers by name. The other names are the classes of the results and of the errors.

process         tools of the process: errors, signals, workers, files
showing         the style of figures and tables
config          the files that a person edits
vision          the edges of the beam in its frames
dataset         the HDF5 file of a run
virtual         a rig that needs no hardware
acquisition     a run on the bench
fits            identify laws from datasets
reporting       the report of a fit as one HTML file
page            the live page on this computer
publishing      an archive of runs and results for other people's programs
study           the evaluation on virtual specimens and tensile data
face            the public functions
commands        the commands of `eimi`
cli             the command line with all commands
"""

from __future__ import annotations

import logging
from importlib import import_module
from typing import TYPE_CHECKING, Any

logging.getLogger(__name__).addHandler(logging.NullHandler())

if TYPE_CHECKING:
    from eimi_drivers.cameras.camera_names import CAMERAS as CAMERAS
    from eimi_drivers.interfaces import InstrumentError as InstrumentError
    from eimi_drivers.supplies.supply_names import SUPPLIES as SUPPLIES
    from eimi_fitting.inference.evidence.parameter_priors import Prior as Prior
    from eimi_fitting.inference.evidence.quantity import Quantity as Quantity
    from eimi_fitting.laws import LAWS as LAWS
    from eimi_lab.acquisition.events import Event as Event
    from eimi_lab.dataset.reading import Dataset as Dataset
    from eimi_lab.face.acquiring import DryRun as DryRun
    from eimi_lab.face.acquiring import acquire as acquire
    from eimi_lab.face.acquiring import open as open
    from eimi_lab.face.discovering import discover as discover
    from eimi_lab.face.identifying import fit as fit
    from eimi_lab.face.identifying import open_fits as open_fits
    from eimi_lab.face.identifying import tensile as tensile
    from eimi_lab.face.moving import import_motion as import_motion
    from eimi_lab.face.results import Discovered as Discovered
    from eimi_lab.face.results import Plan as Plan
    from eimi_lab.face.results import Report as Report
    from eimi_lab.face.results import Validations as Validations
    from eimi_lab.face.segmenting import import_pictures as import_pictures
    from eimi_lab.face.segmenting import import_points as import_points
    from eimi_lab.face.segmenting import segment as segment
    from eimi_lab.face.using import export as export
    from eimi_lab.face.using import plan as plan
    from eimi_lab.face.using import publish as publish
    from eimi_lab.face.using import report as report
    from eimi_lab.face.using import simulate as simulate
    from eimi_lab.face.using import validate as validate
    from eimi_lab.fits.fits_file import Fits as Fits
    from eimi_lab.fits.records import FitRecord as FitRecord
    from eimi_lab.fits.residuals import Residuals as Residuals
    from eimi_lab.fits.simulated_fit import Prediction as Prediction
    from eimi_lab.fits.tensile_record import TensileRecord as TensileRecord
    from eimi_lab.fits.time_records import RingDownRecord as RingDownRecord
    from eimi_lab.fits.validation import Validation as Validation
    from eimi_lab.process.errors import InputError as InputError
    from eimi_lab.publishing.archive import Publication as Publication
    from eimi_lab.virtual.simulation import Simulation as Simulation

    __version__: str

_HOMES = {
    "CAMERAS": "eimi_drivers.cameras.camera_names",
    "Dataset": "eimi_lab.dataset.reading",
    "Discovered": "eimi_lab.face.results",
    "DryRun": "eimi_lab.face.acquiring",
    "Event": "eimi_lab.acquisition.events",
    "FitRecord": "eimi_lab.fits.records",
    "Fits": "eimi_lab.fits.fits_file",
    "InputError": "eimi_lab.process.errors",
    "InstrumentError": "eimi_drivers.interfaces",
    "LAWS": "eimi_fitting.laws",
    "Plan": "eimi_lab.face.results",
    "Prediction": "eimi_lab.fits.simulated_fit",
    "Prior": "eimi_fitting.inference.evidence.parameter_priors",
    "Publication": "eimi_lab.publishing.archive",
    "Quantity": "eimi_fitting.inference.evidence.quantity",
    "Report": "eimi_lab.face.results",
    "Residuals": "eimi_lab.fits.residuals",
    "RingDownRecord": "eimi_lab.fits.time_records",
    "SUPPLIES": "eimi_drivers.supplies.supply_names",
    "Simulation": "eimi_lab.virtual.simulation",
    "TensileRecord": "eimi_lab.fits.tensile_record",
    "Validation": "eimi_lab.fits.validation",
    "Validations": "eimi_lab.face.results",
    "acquire": "eimi_lab.face.acquiring",
    "discover": "eimi_lab.face.discovering",
    "export": "eimi_lab.face.using",
    "fit": "eimi_lab.face.identifying",
    "import_motion": "eimi_lab.face.moving",
    "import_pictures": "eimi_lab.face.segmenting",
    "import_points": "eimi_lab.face.segmenting",
    "open": "eimi_lab.face.acquiring",
    "open_fits": "eimi_lab.face.identifying",
    "plan": "eimi_lab.face.using",
    "publish": "eimi_lab.face.using",
    "report": "eimi_lab.face.using",
    "segment": "eimi_lab.face.segmenting",
    "simulate": "eimi_lab.face.using",
    "tensile": "eimi_lab.face.identifying",
    "validate": "eimi_lab.face.using",
}

__all__ = sorted([*_HOMES, "__version__"])


if not TYPE_CHECKING:  # a type checker must know only the names above

    def __getattr__(name: str) -> Any:
        """Return the public object with this name, and load its module if necessary (PEP 562)."""
        value: Any
        if name == "__version__":
            from importlib.metadata import version

            value = version("eimi-lab")
        elif name in _HOMES:
            value = getattr(import_module(_HOMES[name]), name)
        else:
            from eimi_fitting.suggestion import suggestion

            raise AttributeError(f"module {__name__!r} has no attribute {name!r}; {suggestion(name, __all__)}")
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})

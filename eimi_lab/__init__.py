"""What a person runs: `eimi` on the command line, `eimi_lab.notebook` in a notebook.

config        the files that a person edits           acquisition   a run on the bench
dataset       the HDF5 file of a run                   vision        the beam's edges in its frames
fits          from datasets to materials               report        one HTML file that shows them
virtual       a rig that needs no hardware             commands      what each command of `eimi` takes and prints
"""

import logging
from typing import TYPE_CHECKING

logging.getLogger(__name__).addHandler(logging.NullHandler())

if TYPE_CHECKING:
    __version__: str
else:

    def __getattr__(name: str) -> str:
        """`__version__`, looked up when it is asked for: `eimi` is to start quickly."""
        if name != "__version__":
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from importlib.metadata import version

        return version("eimi-lab")

"""Send a supply driver that this program added to the guardian process.

The guardian process switches the coil off if the run dies. Its `SUPPLIES` contains only the drivers of this package and
of installed packages. cloudpickle sends other drivers: a class from a module is imported again in the guardian, and
the code of a class from a script or a notebook is sent.
"""

from __future__ import annotations

import base64
import json
import pickle
import sys

from eimi_drivers.interfaces import UnusableDriver
from eimi_drivers.supplies.supply_names import SUPPLIES
from eimi_lab.process.detached import LONGEST_ARGUMENT


def pack(name: str) -> str:
    """Return a text from which `unpack` adds the driver in another process; empty for an installed driver.

    Raises
    ------
    UnusableDriver
        If the driver cannot be pickled, for example because it holds an open port.
    """
    if name not in SUPPLIES.added():
        return ""
    import cloudpickle

    try:
        pickled = cloudpickle.dumps(SUPPLIES[name])
    except Exception as error:  # the driver's own code is called
        raise UnusableDriver(
            f"the supply driver {name!r} cannot be sent to the process that switches the coil off if the run dies: "
            f"{error}; write it as a class in a module of its own"
        ) from error
    packed = json.dumps({"path": sys.path, "driver": base64.b64encode(pickled).decode("ascii")})
    if LONGEST_ARGUMENT is not None and len(packed) > LONGEST_ARGUMENT:
        raise UnusableDriver(
            f"the supply driver {name!r} is too large to be carried over to the process that switches the coil off if "
            "the run dies; write it as a class in a module of its own"
        )
    return packed


def unpack(name: str, packed: str) -> None:
    """Add the driver in the text from `pack` to `SUPPLIES` of this process."""
    if packed:
        content = json.loads(packed)
        sys.path.extend(folder for folder in content["path"] if folder not in sys.path)
        SUPPLIES[name] = pickle.loads(base64.b64decode(content["driver"]))

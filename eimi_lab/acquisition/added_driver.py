"""Send a supply driver of the user's program to the guardian process, which switches the coil off if the run dies."""

from __future__ import annotations

import base64
import json
import pickle
import sys

from eimi_drivers.interfaces import UnusableDriver
from eimi_drivers.supplies.supply_names import SUPPLIES
from eimi_lab.process.detached import LONGEST_ARGUMENT


def pack(name: str) -> str:
    """Return a text that contains a supply driver of the user's program.

    The guardian process, which switches the coil off if the run dies, reads the text with `unpack`.

    Parameters
    ----------
    name : str
        Name of the driver in `SUPPLIES`, the table of all drivers.

    Returns
    -------
    str
        A JSON object with the pickled driver; empty for the driver of an installed package.

    Raises
    ------
    UnusableDriver
        If the driver cannot be pickled, or if the text is too long.
    """
    if name not in SUPPLIES.added():
        return ""
    import cloudpickle

    try:
        pickled = cloudpickle.dumps(SUPPLIES[name])
    except Exception as error:  # cloudpickle runs code of the driver, which may raise any error
        raise UnusableDriver(
            f"the supply driver {name!r} cannot be sent to the process that switches the coil off if the run dies: "
            f"{error}; write the driver as a class in a module of its own"
        ) from error
    packed = json.dumps({"path": sys.path, "driver": base64.b64encode(pickled).decode("ascii")})
    if len(packed) > LONGEST_ARGUMENT:
        raise UnusableDriver(
            f"the supply driver {name!r} is too large to be sent to the process that switches the coil off if the run "
            "dies; write the driver as a class in a module of its own"
        )
    return packed


def unpack(name: str, packed: str) -> None:
    """Add a supply driver to `SUPPLIES`, the table of all drivers.

    Parameters
    ----------
    name : str
        Name of the driver.
    packed : str
        Text that `pack` returned; an empty text adds nothing.
    """
    if packed:
        content = json.loads(packed)
        sys.path.extend(folder for folder in content["path"] if folder not in sys.path)
        SUPPLIES[name] = pickle.loads(base64.b64decode(content["driver"]))

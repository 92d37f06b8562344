"""Send to the guardian process a supply driver that the user's program added.

The guardian process switches the coil off if the run dies. It is a separate process, which knows only the drivers of
this package and of installed packages. A driver of the user's program is therefore sent with cloudpickle. If the class
of the driver comes from a module, the guardian process imports the module. If the class comes from a script or a
notebook, the code of the class is sent.
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
    """Return a text that contains a supply driver of the user's program, for the guardian process.

    The guardian process switches the coil off if the run dies, and needs the driver for this. There, `unpack` converts
    the text into the driver again.

    Parameters
    ----------
    name : str
        Name of the driver in the table of all drivers, `SUPPLIES`.

    Returns
    -------
    str
        A JSON object with the pickled class of the driver (as base64) and the module search path of this process. The
        text is empty for the driver of an installed package, because the guardian process finds this driver itself.

    Raises
    ------
    UnusableDriver
        If the driver cannot be pickled, for example because it holds an open port, or if the text is too long to be an
        argument of a process.
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
    if LONGEST_ARGUMENT is not None and len(packed) > LONGEST_ARGUMENT:
        raise UnusableDriver(
            f"the supply driver {name!r} is too large to be sent to the process that switches the coil off if the run "
            "dies; write the driver as a class in a module of its own"
        )
    return packed


def unpack(name: str, packed: str) -> None:
    """Add a supply driver to `SUPPLIES`, the table of all drivers by name, in this process.

    Parameters
    ----------
    name : str
        Name of the driver.
    packed : str
        Text that `pack` returned in another process. An empty text adds nothing.
    """
    if packed:
        content = json.loads(packed)
        sys.path.extend(folder for folder in content["path"] if folder not in sys.path)
        SUPPLIES[name] = pickle.loads(base64.b64decode(content["driver"]))

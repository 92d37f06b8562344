"""A supply driver that this program added, taken along to the guardian process.

The guardian switches the coil off if the run dies, in a process of its own: there `SUPPLIES` has the drivers of this
package and of installed packages alone. A class of a module is imported there; one of a script or a notebook is
carried over with its code (cloudpickle).
"""

from __future__ import annotations

import base64
import json
import pickle
import sys

from eimi_drivers.interfaces import UnusableDriver
from eimi_drivers.supplies.supply_names import SUPPLIES


def pack(name: str) -> str:
    """Return a text from which `unpack` adds the driver in another process; empty for an installed driver.

    Raises
    ------
    UnusableDriver
        The driver cannot be carried over, since it holds an open port, for example.
    """
    if name not in SUPPLIES.added():
        return ""
    import cloudpickle

    try:
        pickled = cloudpickle.dumps(SUPPLIES[name])
    except (pickle.PicklingError, TypeError, AttributeError, ValueError) as error:
        raise UnusableDriver(
            f"the supply driver {name!r} cannot be carried over to the process that switches the coil off if the run "
            f"dies: {error}; write it as a class in a module of its own"
        ) from error
    return json.dumps({"path": sys.path, "driver": base64.b64encode(pickled).decode("ascii")})


def unpack(name: str, packed: str) -> None:
    """Add the driver that `pack` made a text of to `SUPPLIES` of this process."""
    if packed:
        carried = json.loads(packed)
        sys.path.extend(folder for folder in carried["path"] if folder not in sys.path)
        SUPPLIES[name] = pickle.loads(base64.b64decode(carried["driver"]))

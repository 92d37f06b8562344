"""A coil supply with no hardware: a model of the supply and its coil, and command languages on top of it.

`supply` is the model: set-points, output, protection, and a coil whose current follows with a time constant.
`korad`, `scpi`, `scpi_families` and `genesys` are the dialects. `faults` spoils any of them on purpose. `serve`
puts one where the ordinary drivers find it: in the same process, on a pseudo-terminal, or on a TCP port.
"""

from eimi_drivers.emulators.serve import DIALECTS, emulate, open_in_process, serve_pty, serve_tcp
from eimi_drivers.emulators.supply import CoilSupply

__all__ = ["DIALECTS", "CoilSupply", "emulate", "open_in_process", "serve_pty", "serve_tcp"]

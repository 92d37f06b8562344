"""Power supplies and cameras: what they are, how to reach them, and emulators that stand in for them.

`interfaces` says what a supply and a camera are and what they raise; `supplies.open_supply` and
`cameras.open_camera` open one by the name of its driver; `discovery` lists what is attached; `emulators`
serve a coil supply with no hardware. This package knows currents, volts and pixels: no physics of the
specimen, no files of the laboratory, and nothing of the packages that use it.
"""

import logging

logging.getLogger(__name__).addHandler(logging.NullHandler())

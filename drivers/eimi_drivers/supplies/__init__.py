"""Drivers of power supplies, and the one way to open one by name.

`base` holds what every driver shares: limits, read-back, switching off stage by stage. `korad`, `scpi`,
`genesys` and `kepco` each hold one command language; `scpi_profiles` what tells SCPI families apart.
`transport` carries bytes over a serial line, over VISA or to an emulator in the same process. `opening` knows
the drivers by name.
"""

from eimi_drivers.supplies.supply_names import SUPPLIES, open_supply

__all__ = ["SUPPLIES", "open_supply"]

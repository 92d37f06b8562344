"""Drivers of power supplies, and `open_supply`, which opens one by name.

supply_names    the drivers by name
base            what every driver shares: limits, read-back, protection, switching off in stages
values          set-points as text, and the numbers and lines in answers
recognised      the driver that fits an identification
identity        the serial number in an identification
off             measure the current until the coil is off
korad           Korad supplies and their relabelled versions
genesys         TDK-Lambda Genesys over a serial line
kepco           Kepco BOP bipolar supplies
aim_tti         Aim-TTi supplies of the QL, MX, QPX and CPX series
scpi            supplies that speak SCPI
xln             BK Precision XLN supplies
owon            Owon SPE supplies
profile         the commands and queries of a SCPI family
scpi_profiles   the command strings of each SCPI family
transport       bytes over a serial line, over VISA or to an emulator in the same process
interruptible   a line that can be left between two messages
foreign         the errors of other packages' drivers in one line
logged          a line whose messages go into the log
transcript      a line whose messages are written to a file, or read from one
"""

from eimi_drivers.supplies.supply_names import SUPPLIES, open_supply

__all__ = ["SUPPLIES", "open_supply"]

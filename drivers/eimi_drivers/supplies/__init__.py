"""Drivers of power supplies, and `open_supply`, which opens a supply by the name of its driver.

supply_names    the drivers by name
base            the functions of every driver: limits, read-back, protection, switching off
conversation    queries over the line, the form of the answers, and the identity of the supply
values          convert set-points to text, and answers to numbers or lines of text
recognised      find the driver of a supply from its identification text
identity        find the serial number in an identification text
protections     the trip levels of the protections inside a supply, and what they do if the connection is lost
off             switch off in stages, and measure the current until the coil is off
korad           Korad supplies and their relabelled versions
genesys         TDK-Lambda Genesys over a serial line
kepco           Kepco BOP bipolar supplies
aim_tti         Aim-TTi supplies of the QL, MX, QPX and CPX series
scpi            supplies that speak SCPI
xln             BK Precision XLN supplies
owon            Owon SPE supplies
profile         the commands and queries of a SCPI family
scpi_profiles   the command strings of each SCPI family
address         the address of an instrument: a serial port, a VISA resource or a URL, and the channel at its end
transport       bytes over a serial line, or to an emulator in the same process
visa            bytes over VISA
interruptible   a line on which the exchange of messages can be interrupted between two messages
foreign         report every error of another package's driver in one line
logged          a line whose messages are written to the log
transcript      a line whose messages are recorded in a file or played back from a file
"""

from eimi_drivers.supplies.supply_names import SUPPLIES, open_supply

__all__ = ["SUPPLIES", "open_supply"]

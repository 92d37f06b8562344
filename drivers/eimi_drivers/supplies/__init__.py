"""Drivers of power supplies; `open_supply` opens a supply by the name of its driver.

supply_names    the drivers by name
base            the functions of every driver: limits, read-back, protections, switching off
conversation    queries, the form of the answers, and the identity of the supply
values          convert set-points to text, and answers to numbers
recognised      find the driver of a supply from its identification text
identity        find the serial number in an identification text
protections     check the trip levels of the protections inside a supply
off             switch off in stages, and measure the current until the coil is off
korad           Korad supplies and their relabelled versions
genesys         TDK-Lambda Genesys supplies on a serial line
kepco           Kepco BOP bipolar supplies
aim_tti         Aim-TTi supplies of the QL, MX, QPX and CPX series
scpi            supplies that use SCPI, the standard command language of instruments
xln             BK Precision XLN supplies
owon            Owon SPE supplies
profile         the fields of a description of one family of SCPI supplies
scpi_profiles   the messages of all families of SCPI supplies
address         the address of an instrument: a serial port, a VISA resource or a URL, and the channel
transport       send and receive bytes over a serial line
visa            send and receive bytes over VISA
interruptible   call a function before each message, which may stop the exchange
foreign         report every error of another package's driver in one line
logged          write all messages to the log
transcript      record all messages in a file, or play the file back
"""

from eimi_drivers.supplies.supply_names import SUPPLIES, open_supply

__all__ = ["SUPPLIES", "open_supply"]

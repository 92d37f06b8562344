"""Emulated supplies with a coil, emulated sensors and an emulated camera.

A dialect answers the messages of one family of supplies.

supply             the model: set-points, output, protection, and a coil with a time constant
trip_level         a protection with a trip level (V or A) and a switch
korad              the language of Korad supplies
genesys            the language of TDK-Lambda Genesys supplies
aim_tti            the language of Aim-TTi supplies
scpi               the commands that all SCPI families share
scpi_families      SCPI families with one channel, or with the channel in each message
keysight_systems   Keysight N6700, N6900 and RP7900, which have a watchdog
keithley           Keithley 2200 with its output timer, and 2260B
delta              Delta Elektronika SM15K and PSC-ETH with their watchdog
xln                the language of BK Precision XLN supplies
owon               the language of Owon SPE supplies
output_watchdog    a timer that switches the output off
channel_selected   SCPI families in which one channel is selected at a time
hislip             the HiSLIP protocol for an emulated SCPI supply
sensors            emulated gaussmeters and thermometers
faults             the faults of emulated instruments and of their lines
spoiling           begin and end a fault of an emulated supply, its coil or its line
serial_port        a serial port that can be unplugged and plugged in again
session            serve a supply whose fault begins after its output was switched on
sensor_session     serve a sensor in the field of an emulated coil
coil_line          send the true current of an emulated coil to a virtual beam
gige_camera        serve pictures over GigE Vision with the fake camera of Aravis
gige_stream        send the frames of the emulated camera, as fast as the receiver reads them
gige_features      the GenICam description of the emulated camera
gige_process       serve an emulated camera from a separate process
serve              serve an emulator in the same process, on a pseudo-terminal or on a TCP port
"""

from eimi_drivers.emulators.serve import DIALECTS, emulate, open_in_process, serve_pty, serve_tcp
from eimi_drivers.emulators.supply import CoilSupply

__all__ = ["DIALECTS", "CoilSupply", "emulate", "open_in_process", "serve_pty", "serve_tcp"]

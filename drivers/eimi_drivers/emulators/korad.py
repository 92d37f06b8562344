"""Emulate the command language of Korad supplies."""

from __future__ import annotations

import re

from eimi_drivers.emulators.supply import CoilSupply

_MESSAGE = re.compile(rb"\*IDN\?|STATUS\?|[VI](?:SET|OUT)1\?|[VI]SET1:\d{1,4}(?:\.\d{1,4})?|O(?:UT|CP|VP)[01]")


class KoradDialect:
    """Emulated one-channel Korad supply.

    Parameters
    ----------
    supply : CoilSupply
        The model of the supply and its coil.
    fuse_within_s : float
        The shortest time between two messages that the supply understands, s. If a message comes sooner, it has no
        effect, and the effect of the message before it is undone.
    protection_bit : int
        The bit of the status byte that reports a trip: 0x20 or 0x80, depending on the firmware.
    """

    identification = b"KORADKA3005PV2.0"

    def __init__(self, supply: CoilSupply, *, fuse_within_s: float = 0.0, protection_bit: int = 0x20) -> None:
        self.supply = supply
        self._fuse_within_s = fuse_within_s
        self._protection_bit = protection_bit
        self._last_s = -float("inf")
        self._state_before = supply.state

    def receive(self, data: bytes) -> bytes:
        """Receive bytes and return the answers."""
        now_s = self.supply.clock.now()
        too_soon, self._last_s = now_s - self._last_s < self._fuse_within_s, now_s
        if too_soon:
            self.supply.state = self._state_before
            return b""
        self._state_before = self.supply.state
        messages = _MESSAGE.findall(data)
        if self._fuse_within_s > 0 and messages != [data]:
            return b""
        return b"".join(self._answer(message) for message in messages)

    def _answer(self, message: bytes) -> bytes:
        supply = self.supply
        match message:
            case b"*IDN?":
                return self.identification
            case b"STATUS?":
                return bytes([self._status()])
            case b"VSET1?":
                return b"%05.2f" % supply.state.set_voltage_V
            case b"ISET1?":
                return b"%05.3f" % supply.state.set_current_A + b"K"
            case b"VOUT1?":
                return b"%05.2f" % max(supply.read().voltage_V, 0.0)
            case b"IOUT1?":
                return b"%05.3f" % max(supply.read().current_A, 0.0)
            case b"OUT0" | b"OUT1":
                supply.switch(message == b"OUT1")
            case b"OCP0" | b"OCP1":
                supply.arm(message == b"OCP1")
            case _ if message.startswith(b"VSET1:"):
                supply.set_voltage(float(message[6:]))
            case _ if message.startswith(b"ISET1:"):
                supply.set_current(float(message[6:]))
        return b""

    def _status(self) -> int:
        supply = self.supply
        output = 0x40 if supply.output_on() else 0  # evaluated first, because a protection may act in this call
        return output | int(supply.constant_voltage()) | (self._protection_bit if supply.state.tripped else 0)

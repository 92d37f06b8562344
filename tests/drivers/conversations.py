"""Send the messages of a prepared conversation to an emulated supply, and compare every answer."""

from __future__ import annotations

from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.supplies.transport import Responder

SETTLE = "(settle)"
"""In place of a message: wait until the current of the coil is constant."""

TRIP = "(trip)"
"""In place of a message: a protection switches the output off."""

Conversation = list[tuple[str, str]]
"""Messages and their answers without the ends of the lines. An empty answer means that the supply does not answer."""

LINE_ENDS = {
    "korad": ("", ""),
    "genesys": ("\r", "\r"),
    "bk-xln": ("\r\n", "\r\n"),
    "aim-tti": ("\n", "\r\n"),
}
"""The ends of messages and answers, by driver; a line feed for all other drivers."""


def hold(conversation: Conversation, dialect: str, instrument: Responder, coil: CoilSupply) -> None:
    # Send messages to an emulated supply one after the other, and assert that every answer is the expected one.
    # conversation : messages with answers, and events: SETTLE (wait for 5 s) or TRIP (a protection acts)
    # dialect : name of the driver
    # coil : model of the supply and its coil
    end, answer_end = LINE_ENDS.get(dialect, ("\n", "\n"))
    for place, (message, answer) in enumerate(conversation):
        if message == SETTLE:
            coil.clock.sleep(5.0)
        elif message == TRIP:
            coil.trip()
        else:
            received = instrument.receive((message + end).encode("latin-1")).decode("latin-1")
            assert received == (answer + answer_end if answer else ""), (place, message)


class InPieces:
    # An emulated supply that receives every message byte by byte, as a slow line delivers it.

    def __init__(self, instrument: Responder) -> None:
        self._instrument = instrument

    def receive(self, data: bytes) -> bytes:
        return b"".join(self._instrument.receive(bytes([byte])) for byte in data)

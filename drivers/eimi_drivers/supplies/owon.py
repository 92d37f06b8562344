"""Drive Owon SPE supplies (also sold as Kiprim DC) on a USB serial port, 115200 bit/s."""

# Sources: the driver owon-psu, version 0.0.6, and the list of commands of another project for the Multicomp Pro
# MP711135, which is the same supply. The manual was not available. VOLT:LIM and CURR:LIM are the trip levels of the
# protections. The supply has no error queue.

from __future__ import annotations

from eimi_drivers.interfaces import InstrumentError, InstrumentTimeout
from eimi_drivers.supplies.conversation import REPLY_TIMEOUT_S
from eimi_drivers.supplies.profile import Profile
from eimi_drivers.supplies.protections import STAYS_ON, armed_in_words
from eimi_drivers.supplies.scpi import LONGEST_LINE, ScpiSupply
from eimi_drivers.supplies.scpi_profiles import OVER_BOTH, OVER_CURRENT_TRIPPED, OVER_VOLTAGE_TRIPPED, TOO_HOT

STATE = "MEAS:ALL:INFO?"
"""The query whose answer contains voltage, current, power, three protections (ON if tripped) and the mode."""

TRIPS = {3: OVER_VOLTAGE_TRIPPED, 4: OVER_CURRENT_TRIPPED, 5: TOO_HOT}
"""For the index of a field of the answer to `STATE`: the protection that has tripped if this field is ON."""

FIELDS = 7

REFUSED = b"ERR"
"""The answer to a message that the supply does not accept."""

MOST_REFUSALS = 3
"""Number of ERR answers after which the query itself counts as refused.

At most two ERR answers can belong to the commands before the query.
"""


class OwonSpeSupply(ScpiSupply):
    """Driver of an Owon SPE supply."""

    name = "owon-spe"
    profile = Profile(
        name,
        baud_rate=115200,
        protect=("VOLT:LIM {voltage}", "CURR:LIM {current}"),
        armed=(("VOLT:LIM?", "{voltage}"), ("CURR:LIM?", "{current}")),
        protections=OVER_BOTH,
        on=("OUTP ON",),
        off=("OUTP OFF",),
        errors="",
    )
    protections = profile.protections
    without_contact = STAYS_ON + armed_in_words(protections)

    def _ask(self, question: str) -> bytes:
        """Send a query and return the first answer other than ERR; raise InstrumentError if only ERR arrives."""
        reply = super()._ask(question)
        for _ in range(MOST_REFUSALS):
            if reply.strip() != REFUSED:
                return reply
            try:
                reply = self._link.read(LONGEST_LINE, REPLY_TIMEOUT_S, b"\n")
            except InstrumentTimeout:
                break
        raise InstrumentError(f"{self._link.address}: the supply answers ERR to {question}")

    def _trip(self) -> str:
        reply = self._ask(STATE)
        fields = [field.strip().upper() for field in reply.decode("latin-1").split(",")]
        flags = [fields[place] for place in TRIPS] if len(fields) == FIELDS else []
        if not flags or not set(flags) <= {"ON", "OFF", "1", "0"}:
            raise self._not_understood(STATE, reply, "seven fields such as 2.80,0.700,1.96,OFF,OFF,OFF,2")
        return ", ".join(words for place, words in TRIPS.items() if fields[place] in {"ON", "1"})

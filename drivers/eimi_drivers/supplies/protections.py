"""The protections inside a supply: check their trip levels, and describe them."""

from eimi_drivers.interfaces import SetPointNotTaken

PROTECTION_MARGIN = 1.1
"""Level at which a protection inside the supply switches the output off, divided by the limit of the driver.

The level is above the limit, because this protection is needed only if the regulator of the supply fails.
"""

STAYS_ON = "nothing switches the output off, it stays as it was set"
"""The text of `without_contact` for a supply without a watchdog."""


def armed_in_words(protections: str) -> str:
    """Return a text for the user that names the protections which are switched on; empty if there are none."""
    return f"; switched on in the supply: {protections}" if protections else ""


def check_level(address: str, question: str, level: float, limit: float, answer: float) -> None:
    """Raise SetPointNotTaken if the trip level of a protection differs from the level that was sent.

    A difference of (`PROTECTION_MARGIN` - 1) · `limit` is permitted.

    Parameters
    ----------
    address : str
        Address of the supply, for the message.
    question : str
        Query for the trip level, for the message.
    level : float
        Level that was sent, A or V.
    limit : float
        Limit of the driver for this quantity, A or V.
    answer : float
        Level that the supply reports, A or V.
    """
    if abs(answer - level) > (PROTECTION_MARGIN - 1) * limit:
        raise SetPointNotTaken(
            f"{address}: the protection level of the supply was set to {level:g}, but the answer to "
            f"{question} is {answer:g}"
        )

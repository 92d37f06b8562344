"""The protections inside a supply: their trip levels, and what they do without contact to this program."""

from eimi_drivers.interfaces import SetPointNotTaken

PROTECTION_MARGIN = 1.1
"""Level at which a protection inside the supply switches the output off, divided by the limit of the driver.

The level is above the limit, because this protection is needed only if the regulator of the supply fails.
"""

STAYS_ON = "nothing switches the output off, it stays as it was set"
"""The text of `without_contact` for a supply without a watchdog."""


def armed_in_words(protections: str) -> str:
    """Return the end of the text `without_contact` of a supply: which protections are switched on inside the supply.

    `without_contact` describes what the output does if the cable is pulled or the computer fails. `protections`
    describes the protections that the driver has switched on. If it is empty, the result is empty.
    """
    return f"; switched on in the supply: {protections}" if protections else ""


def check_level(address: str, question: str, level: float, limit: float, answer: float) -> None:
    """Raise SetPointNotTaken if the trip level of a protection differs too much from the level that was sent.

    The trip level is the current or voltage above which the protection switches the output off. A supply may round it,
    so that a difference of 0.1 · `limit` is allowed. The level that was sent is usually 1.1 · `limit` (see
    `PROTECTION_MARGIN`). The level in the supply is then between 1 and 1.2 times `limit`.

    Parameters
    ----------
    address : str
        The address of the supply, for the message.
    question : str
        The query for the level, for the message.
    level : float
        The level that was sent, A or V.
    limit : float
        The limit of the driver for the same quantity, A or V.
    answer : float
        The level that the supply reports, A or V.
    """
    if abs(answer - level) > (PROTECTION_MARGIN - 1) * limit:
        raise SetPointNotTaken(
            f"{address}: the protection level of the supply was set to {level:g}, but the answer to "
            f"{question} is {answer:g}"
        )

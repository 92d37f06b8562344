"""What a person has to do at the page, in place of the instructions that a run gives to a user of a terminal.

The page is the live web page of `eimi dashboard`.
"""

from __future__ import annotations

from eimi_lab.acquisition.event_words import CONTINUE_ENDED, CONTINUE_PAUSED
from eimi_lab.acquisition.open_coil import WITHOUT_INSTRUMENT
from eimi_lab.acquisition.output_off import SWITCH_OFF_FIRST
from eimi_lab.acquisition.resuming import BEGIN_ANEW
from eimi_lab.dataset.storage_failure import CONTINUE_STORED

AT_THE_PAGE = {
    CONTINUE_PAUSED: "Resume continues the run, STOP ends it",
    CONTINUE_ENDED: "to continue the run, tick “continue this dataset” and press Start",
    CONTINUE_STORED: "the run can be continued: tick “continue this dataset” and press Start",
    BEGIN_ANEW: "to begin a run, untick “continue this dataset”",
    SWITCH_OFF_FIRST: "; switch it off at the supply, then press Start",
    WITHOUT_INSTRUMENT: "to measure without an instrument, choose “virtual” under Rig; in a terminal, `eimi "
    "instruments` shows more",
}
"""What a user of the page has to do, by the instruction that a run gives to a user of a terminal."""


def at_the_page(words: str) -> str:
    """Return the message of a run as the page shows it.

    The message may tell a user of a terminal what to do, such as to give an option. Each such instruction is replaced
    by what a user of the page has to do, such as to press a button.
    """
    for at_a_terminal, for_the_page in AT_THE_PAGE.items():
        words = words.replace(at_a_terminal, for_the_page)
    return words

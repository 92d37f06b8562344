"""Replace instructions for a terminal, in a message of a run, by instructions for the live web page."""

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
    """Return a message of a run with instructions for the web page in place of instructions for a terminal."""
    for at_a_terminal, for_the_page in AT_THE_PAGE.items():
        words = words.replace(at_a_terminal, for_the_page)
    return words

"""Find the driver of a supply from its identification text."""

from __future__ import annotations

import re
from dataclasses import dataclass


@dataclass(frozen=True)
class Recognised:
    """The driver of a supply whose family was recognised.

    Parameters
    ----------
    driver : str
        Name of the driver.
    port : int
        TCP port for commands; 0 if not known.
    """

    driver: str
    port: int = 0


MODELS: tuple[tuple[str, Recognised], ...] = (
    (r"\b(QL|MX|QPX|CPX)\d{3}", Recognised("aim-tti", 9221)),
    (r"\b2260B-", Recognised("keithley-2260b", 2268)),
    (r"\b2200-\d\d-", Recognised("keithley-2200")),
    (r"\bE3631[123]A", Recognised("keysight-e36312a", 5025)),
    (r"\bN670\d", Recognised("keysight-n6700", 5025)),
    (r"\bN[67]9\d\d", Recognised("keysight-n6900", 5025)),
    (r"\bRP79\d\d", Recognised("keysight-rp7900", 5025)),
    (r"\bE3631A", Recognised("keysight-e3631a")),
    (r"\bE363[234]A", Recognised("keysight-e3632a")),
    (r"\bE364[0-5]A", Recognised("keysight-e364x")),
    (r"\bDP8\d\d", Recognised("rigol-dp800", 5555)),
    (r"\bSPD\d{4}", Recognised("siglent-spd", 5025)),
    (r"\bHMP\d{4}", Recognised("rs-hmp", 5025)),
    (r"\bSM ?\d+-CP-", Recognised("delta-sm15k", 8462)),
    (r"\bDELTA.*\bSM ?\d+-", Recognised("delta-psc-eth", 8462)),
    (r"\bBIT ?4886", Recognised("kepco-bit4886")),
    (r"\bKEPCO.*\bBOP", Recognised("kepco-bop")),
    (r"\bXLN\d", Recognised("bk-xln")),
    (r"\b(OWON.*\bSP[EM]\d|KIPRIM)", Recognised("owon-spe")),
    (r"\bGENH?\d", Recognised("genesys")),
    (r"\b(KORAD|TENMA|VELLEMAN|RND)", Recognised("korad")),
)
"""Regular expressions, each with the driver of the supplies whose identification texts contain a match.

The first expression that matches determines the driver.
"""


def recognise(text: str) -> Recognised | None:
    """Return the driver for an identification text, such as the answer to ``*IDN?``; None if no driver fits."""
    return next((recognised for pattern, recognised in MODELS if re.search(pattern, text.upper())), None)

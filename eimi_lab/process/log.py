"""The log of a maintainer: off unless it is asked for, then on standard error."""

from __future__ import annotations

import logging
import os
import sys

VARIABLE = "EIMI_LOG"
"""The environment variable that holds the level; processes that this one starts have it, too."""

LEVELS = ("info", "debug")
PACKAGES = ("eimi_lab", "eimi_drivers", "eimi_fitting")


def log_to_stderr(level: str) -> None:
    """Write what the packages log from this level on, one of `LEVELS`, to standard error; nothing for any other."""
    if level not in LEVELS:
        return
    os.environ[VARIABLE] = level
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(logging.Formatter("%(asctime)s %(process)d %(name)s: %(message)s"))
    for package in PACKAGES:
        logger = logging.getLogger(package)
        logger.setLevel(level.upper())
        logger.addHandler(handler)
        logger.propagate = False

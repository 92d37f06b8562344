"""Print the log for maintainers of the program on standard error."""

from __future__ import annotations

import logging
import os
import sys

VARIABLE = "EIMI_LOG"
"""Name of the environment variable for the level of the log. Processes that this process starts inherit it."""

LEVELS = ("info", "debug")
PACKAGES = ("eimi_lab", "eimi_drivers", "eimi_fitting")


def log_to_stderr(level: str) -> None:
    """Print the messages of the log on standard error, from ``level`` upward.

    Nothing is printed if ``level`` is neither "info" nor "debug".
    """
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

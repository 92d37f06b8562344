"""The entry point of `eimi` and of `python -m eimi_lab`."""

# The module imports little, so that Ctrl-C never prints a traceback, even while the program starts.

import sys

from eimi_lab.process.garbage import collect_seldom


def main() -> None:
    """Import the command line and run it."""
    collect_seldom()
    try:
        from eimi_lab.cli import main as command_line
    except KeyboardInterrupt:
        print("eimi: stopped by SIGINT", file=sys.stderr)
        sys.exit(130)
    command_line()


if __name__ == "__main__":
    main()

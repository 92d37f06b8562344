"""The entry point of `eimi` and of `python -m eimi_lab`.

It imports little, so that Ctrl-C gives one line instead of a traceback from the first moment.
"""

import sys

from eimi_lab.process.garbage import collect_seldom


def main() -> None:
    """Import the command line and run it; Ctrl-C during the import ends the program with one line, as it does later."""
    collect_seldom()
    try:
        from eimi_lab.cli import main as command_line
    except KeyboardInterrupt:
        print("eimi: stopped by SIGINT", file=sys.stderr)
        sys.exit(130)
    command_line()


if __name__ == "__main__":
    main()

"""Where `eimi` and `python -m eimi_lab` begin: as early as can be, so that Ctrl-C ends in one line from the start."""

import sys

from eimi_lab.process.garbage import collect_seldom


def main() -> None:
    """Import the command line and run it. Stopped while it is still imported, end as it would itself."""
    collect_seldom()
    try:
        from eimi_lab.cli import main as command_line
    except KeyboardInterrupt:
        print("eimi: stopped by SIGINT", file=sys.stderr)
        sys.exit(130)
    command_line()


if __name__ == "__main__":
    main()

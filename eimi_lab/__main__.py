"""Where `eimi` and `python -m eimi_lab` begin: as early as can be, so that Ctrl-C ends in one line from the start."""

import gc
import sys

# Of objects, between two searches for cycles of them: modules make many that stay, and looking through these again
# and again takes 0.08 s of a fit's 1.3.
_BETWEEN = 50_000


def main() -> None:
    """Import the command line and run it. Stopped while it is still imported, end as it would itself."""
    gc.set_threshold(_BETWEEN)
    try:
        from eimi_lab.cli import main as command_line
    except KeyboardInterrupt:
        print("eimi: stopped by SIGINT", file=sys.stderr)
        sys.exit(130)
    command_line()


if __name__ == "__main__":
    main()

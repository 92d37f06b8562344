"""The command line: reads arguments, calls the suite, prints. `eimi --help` lists the commands.

The commands themselves are in `eimi_lab.commands`.
"""

from __future__ import annotations

import sys

import typer

from eimi_lab.commands import bench, images, laws, showing
from eimi_lab.errors import InputError, tell
from eimi_lab.stopping import Stopped, unwind_on_termination

app = typer.Typer(
    name="eimi",
    help="Measure a soft material in the deformation in which the robot will use it.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for command in (
    showing.demo,
    bench.instruments,
    bench.emulate,
    bench.acquire,
    bench.recover,
    images.import_,
    images.calibrate,
    images.segment,
    laws.fit,
    laws.validate,
    laws.tensile,
    laws.simulate,
    laws.export,
    showing.report,
):
    app.command(command.__name__.rstrip("_"))(command)


def main() -> None:
    """Run the command line and exit: 0 done, 2 bad input, 1 another failure, 128 + n stopped by signal n."""
    unwind_on_termination()
    sys.exit(_status())


def _status() -> int:
    """The exit status; whatever went wrong has then been told in one line on stderr."""
    try:
        return app(sys.argv[1:] or ["--help"], standalone_mode=False) or 0
    except InputError as error:
        return _tell(str(error), 2)
    except (KeyboardInterrupt, typer.Abort):
        return _tell("stopped by SIGINT", 130)
    except Stopped as stopped:
        return _tell(str(stopped), 128 + stopped.number)
    except Exception as error:
        from eimi_drivers.interfaces import InstrumentError, SwitchOffFailed

        if isinstance(error, SwitchOffFailed):
            return _tell(f"THE COIL MAY STILL BE ON, switch it off by hand: {error}", 1)
        if isinstance(error, InstrumentError | OSError):
            return _tell(str(error), 1)
        if hasattr(error, "format_message"):  # an unknown option, a missing argument: whichever click typer brings
            said = error.format_message() + _left_out(error)
            return _tell(f"{said} (eimi --help lists commands, eimi COMMAND --help options)", 2)
        raise


def _left_out(error: Exception) -> str:
    """The value that was given, which a typer that checks it with pydantic does not name."""
    from pydantic import ValidationError

    return f", not {error.__cause__.errors()[0]['input']}" if isinstance(error.__cause__, ValidationError) else ""


def _tell(message: str, status: int) -> int:
    tell(message)
    return status

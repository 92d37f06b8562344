"""The command line: reads arguments, calls the suite, prints. `eimi --help` lists the commands.

The commands themselves are in `eimi_lab.commands`.
"""

from __future__ import annotations

import os
import sys
from typing import Annotated

import typer

from eimi_lab.commands import beginning, bench, images, material_laws, next_run, showing, studying, watching
from eimi_lab.commands.examples import EXAMPLES, in_help
from eimi_lab.commands.result import printing
from eimi_lab.process.errors import InputError, OwnFault, tell
from eimi_lab.process.log import LEVELS, VARIABLE, log_to_stderr
from eimi_lab.process.stderr import never_blocking, open_closed_streams
from eimi_lab.process.stopping import Stopped, leaving, unwind_on_termination
from eimi_lab.process.threads import one_thread_each

app = typer.Typer(
    name="eimi",
    help="Measure a soft material in the deformation in which the robot will use it.",
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for command in (
    showing.demo,
    beginning.init,
    bench.instruments,
    bench.acquire,
    bench.recover,
    images.import_,
    images.calibrate,
    images.segment,
    material_laws.fit,
    material_laws.validate,
    material_laws.tensile,
    material_laws.simulate,
    material_laws.export,
    next_run.plan,
    showing.report,
    studying.discover,
    studying.study,
):
    name = command.__name__.rstrip("_")
    app.command(name, epilog=in_help(EXAMPLES[name]))(printing(command))
for serving in (bench.emulate, watching.dashboard):  # which print before they serve
    app.command(epilog=in_help(EXAMPLES[serving.__name__]))(serving)


@app.callback()
def _before_any_command(
    version: Annotated[
        bool,
        typer.Option(
            "--version", help="print the versions and do no more", callback=showing.print_versions, is_eager=True
        ),
    ] = False,
    log: Annotated[
        str, typer.Option(envvar=VARIABLE, help="log on standard error for a maintainer: info, or debug for the wire")
    ] = "",
) -> None:
    if log not in ("", *LEVELS):
        raise InputError(f"--log {log} (or {VARIABLE}): should be one of {', '.join(LEVELS)}")
    log_to_stderr(log)


def main() -> None:
    """Run the command line and exit: 0 done, 2 bad input, 1 another failure, 128 + n stopped by signal n."""
    unwind_on_termination()
    one_thread_each()
    open_closed_streams()
    try:
        with never_blocking():
            status = _status()
    except Stopped as stopped:  # once more, before the first could be told of
        status = _told(stopped)
    timed = sys.modules.get("eimi_drivers.cameras.timed")
    if timed and timed.calls_under_way():  # its library may wait at the end for the call that never comes back
        sys.stdout.flush()
        os._exit(status)
    sys.exit(status)


def _status() -> int:
    """The exit status; whatever went wrong has then been told in one line on stderr."""
    try:
        return app(sys.argv[1:] or ["--help"], standalone_mode=False) or 0
    except InputError as error:
        return _tell(str(error), 2)
    except (KeyboardInterrupt, typer.Abort):
        return _tell("stopped by SIGINT", 130)
    except Stopped as stopped:
        return _told(stopped)
    except Exception as error:
        from eimi_drivers.interfaces import InstrumentError, SwitchOffFailed, UnusableDriver

        if isinstance(error, SwitchOffFailed):
            from eimi_lab.acquisition.event_words import in_words
            from eimi_lab.acquisition.events import OffNotConfirmed

            return _tell(in_words(OffNotConfirmed(by="run", reason=str(error))), 1)
        if isinstance(error, UnusableDriver):
            return _tell(str(error), 2)
        if isinstance(error, InstrumentError | OSError | OwnFault):
            return _tell(str(error), 1)
        if hasattr(error, "format_message"):  # an unknown option, a missing argument: whichever click typer brings
            said = error.format_message() + _left_out(error)
            return _tell(f"{said} (eimi --help lists commands, eimi COMMAND --help options)", 2)
        raise


def _left_out(error: Exception) -> str:
    """The value that was given, which a typer that checks it with pydantic does not name."""
    from pydantic import ValidationError

    return f", not {error.__cause__.errors()[0]['input']}" if isinstance(error.__cause__, ValidationError) else ""


def _told(stopped: Stopped) -> int:
    with leaving():
        return _tell(stopped.in_words(), 128 + stopped.number)


def _tell(message: str, status: int) -> int:
    tell(message)
    return status

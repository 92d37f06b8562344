"""The command line: read the arguments, run the command, print its result, and exit with a status."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from itertools import chain
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from eimi_lab.commands import (
    beginning,
    bench,
    calibrating,
    images,
    material_laws,
    next_run,
    publishing,
    showing,
    studying,
    watching,
)
from eimi_lab.commands.examples import EXAMPLES, in_help
from eimi_lab.commands.result import printing
from eimi_lab.process.errors import InputError, OwnFault, tell
from eimi_lab.process.log import LEVELS, VARIABLE, log_to_stderr
from eimi_lab.process.stderr import never_blocking, open_closed_streams, write_every_character
from eimi_lab.process.stopping import Stopped, leaving, unwind_on_termination
from eimi_lab.process.threads import one_thread_each

GROUPS: dict[str, tuple[Callable[..., Any], ...]] = {
    "Measure": (bench.instruments, bench.acquire, bench.recover, next_run.plan, bench.emulate),
    "Prepare": (
        *(beginning.init, calibrating.calibrate, bench.calibrate_coil, images.import_),
        images.segment,
    ),
    "Fit": (
        *(material_laws.fit, material_laws.tensile, studying.discover, material_laws.validate),
        *(material_laws.simulate, material_laws.export),
    ),
    "Other": (showing.report, watching.dashboard, watching.phone, publishing.publish, showing.demo, studying.study),
}
SERVERS = (bench.emulate, watching.dashboard, watching.phone)
"""Commands that serve a page or an instrument and print text themselves. All other commands return a `Result`."""

_LONGEST_SUMMARY = 200


def _name(command: Callable[..., Any]) -> str:
    return command.__name__.rstrip("_").replace("_", "-")  # `import` is a keyword of Python


class _CommandsInGroups(TyperGroup):
    """A group of commands whose --help lists the commands under titles, each command with its whole summary."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        width = max(map(len, self.commands))
        for title, group in GROUPS.items():
            names = [_name(command) for command in group]
            with formatter.section(title):
                formatter.write_dl(
                    [(f"{name:{width}}", self.commands[name].get_short_help_str(_LONGEST_SUMMARY)) for name in names]
                )


app = typer.Typer(
    name="eimi",
    cls=_CommandsInGroups,
    help="Identify the hyperelastic law of a soft material from a bending beam.",
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for command in chain.from_iterable(GROUPS.values()):
    add = app.command(_name(command), epilog=in_help(EXAMPLES[_name(command)]))
    add(command if command in SERVERS else printing(command))


@app.callback()
def _before_any_command(
    version: Annotated[
        bool,
        typer.Option(
            "--version",
            help="print the versions of eimi-lab and its packages, and exit",
            callback=showing.print_versions,
            is_eager=True,
        ),
    ] = False,
    log: Annotated[
        str,
        typer.Option(
            metavar="info|debug",
            envvar=VARIABLE,
            help="write a log for maintainers to standard error; debug includes every message to an instrument",
        ),
    ] = "",
) -> None:
    if log not in ("", *LEVELS):
        raise InputError(f"--log {log} (or {VARIABLE}): should be one of {', '.join(LEVELS)}")
    log_to_stderr(log)


def main() -> None:
    """Run the command line, and exit with a status.

    The status is 0 for success, 2 for wrong input, 1 for another failure, and 128 + n if the signal with the number n
    stopped the program.
    """
    unwind_on_termination()
    one_thread_each()
    open_closed_streams()
    write_every_character()
    try:
        with never_blocking():
            status = _status()
    except Stopped as stopped:  # a second signal came before the first was reported
        status = _report_stop(stopped)
    timed = sys.modules.get("eimi_drivers.cameras.timed")
    if timed and timed.calls_under_way():  # a normal exit could wait forever for this call of a camera's library
        sys.stdout.flush()
        os._exit(status)
    sys.exit(status)


def _status() -> int:
    """Run the command, and return the exit status. A failure is written to standard error in one line."""
    try:
        # None is sys.argv, in which typer replaces patterns such as *.h5 on Windows, whose shells do not.
        return app(None if sys.argv[1:] else ["--help"], standalone_mode=False) or 0
    except InputError as error:
        return _tell(str(error), 2)
    except (KeyboardInterrupt, typer.Abort):
        return _tell("stopped by SIGINT", 130)
    except Stopped as stopped:
        return _report_stop(stopped)
    except Exception as error:
        from eimi_drivers.interfaces import InstrumentError, SwitchOffFailed, UnusableDriver

        if isinstance(error, SwitchOffFailed):
            from eimi_lab.acquisition.event_words import in_words
            from eimi_lab.acquisition.events import OffNotConfirmed

            return _tell(
                in_words(
                    OffNotConfirmed(by="run", reason=str(error), current_A=error.current_A, limit_A=error.limit_A)
                ),
                1,
            )
        if isinstance(error, UnusableDriver):
            return _tell(str(error), 2)
        if isinstance(error, InstrumentError | OSError | OwnFault):
            return _tell(str(error), 1)
        if hasattr(
            error, "format_message"
        ):  # an error of typer's own copy of click: an unknown option, a missing argument
            message = error.format_message() + _rejected_value(error)
            return _tell(f"{message} ({_help_of_command(error)})", 2)
        raise


def _help_of_command(error: Exception) -> str:
    """Return the end of the message about a wrong command line: it tells the user which --help to read."""
    context = getattr(error, "ctx", None)
    if context is None or context.parent is None:
        return "eimi --help lists the commands, eimi COMMAND --help their options"
    return f"eimi {context.info_name} --help lists its arguments and options"


def _rejected_value(error: Exception) -> str:
    """Return ", not VALUE" with the value that pydantic rejected, for the end of a message; otherwise ""."""
    from pydantic import ValidationError

    # If typer itself checked the value, the message already contains it.
    return f", not {error.__cause__.errors()[0]['input']}" if isinstance(error.__cause__, ValidationError) else ""


def _report_stop(stopped: Stopped) -> int:
    """Write to standard error which signal stopped the program, and return the exit status."""
    with leaving():
        return _tell(stopped.in_words(), 128 + stopped.number)


def _tell(message: str, status: int) -> int:
    tell(message)
    return status

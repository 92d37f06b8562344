"""The result of a command, and how it is printed: as text or, with --json, as JSON."""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from eimi_lab.process.paths import reachable

_OPTIONS = {
    "as_json": Annotated[bool, typer.Option("--json", help="print the result as JSON")],
    "quiet": Annotated[bool, typer.Option("--quiet", help="print no progress; print the result only with --json")],
}


@dataclass(frozen=True)
class Result:
    """The result of a command, as text for the user and as data for a program.

    Parameters
    ----------
    lines : sequence of object
        Lines of text for the user.
    content : mapping
        The result for a program.
    """

    lines: Sequence[object]
    content: Mapping[str, Any]


def _reachable(argument: Any) -> Any:
    """Return an argument of a command; long paths, alone or in a list, are changed so that Windows can open them."""
    if isinstance(argument, Path):
        return reachable(argument)
    return [_reachable(item) for item in argument] if isinstance(argument, list) else argument


def printing(command: Callable[..., Result]) -> Callable[..., None]:
    """Return a function for typer that runs ``command``, prints its result, and has the options --json and --quiet."""
    parameters = inspect.signature(command, eval_str=True).parameters.values()
    keyword = inspect.Parameter.KEYWORD_ONLY
    printing_options = [
        inspect.Parameter(name, keyword, default=False, annotation=kind) for name, kind in _OPTIONS.items()
    ]

    def run(*, as_json: bool, quiet: bool, **arguments: Any) -> None:
        from eimi_lab.process.progress import unseen

        reached = {name: _reachable(argument) for name, argument in arguments.items()}
        if quiet:
            with unseen():
                result = command(**reached)
        else:
            result = command(**reached)
        if as_json:
            print(json.dumps(result.content, indent=1, default=str, ensure_ascii=False))
        elif result.lines and not quiet:
            print(*result.lines, sep="\n")

    run.__name__, run.__doc__ = command.__name__, command.__doc__
    run.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        [*(parameter.replace(kind=keyword) for parameter in parameters), *printing_options]
    )
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in [*parameters, *printing_options]}
    return run

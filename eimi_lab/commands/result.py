"""What a command found: lines for a person, or JSON for a program, as every command has it by --json and --quiet."""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import typer

_OPTIONS = {
    "as_json": Annotated[bool, typer.Option("--json", help="print the result as JSON")],
    "quiet": Annotated[bool, typer.Option("--quiet", help="tell no progress, and no result but JSON")],
}


@dataclass(frozen=True)
class Result:
    """lines: for a person. content: the same for a program, and more; what JSON has no form for becomes text."""

    lines: Sequence[object]
    content: Mapping[str, Any]


def printing(command: Callable[..., Result]) -> Callable[..., None]:
    """A command that prints what it finds."""
    given = inspect.signature(command, eval_str=True).parameters.values()
    keyword = inspect.Parameter.KEYWORD_ONLY
    own = [inspect.Parameter(name, keyword, default=False, annotation=kind) for name, kind in _OPTIONS.items()]

    def run(*, as_json: bool, quiet: bool, **arguments: Any) -> None:
        from eimi_lab.process.progress import unseen

        if quiet:
            with unseen():
                result = command(**arguments)
        else:
            result = command(**arguments)
        if as_json:
            print(json.dumps(result.content, indent=1, default=str, ensure_ascii=False))
        elif result.lines and not quiet:
            print(*result.lines, sep="\n")

    run.__name__, run.__doc__ = command.__name__, command.__doc__
    run.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        [*(parameter.replace(kind=keyword) for parameter in given), *own]
    )
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in [*given, *own]}
    return run

"""Options that several commands share."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from eimi_lab.commands.result import Result

Specimen = Annotated[str, typer.Option(help="specimen.toml, or the name of a shipped one such as type1")]
Output = Annotated[Path, typer.Option("-o", "--output", help="the file to write")]
Workers = Annotated[int, typer.Option(help="processes that share the work, at most one a processor", min=1)]
Force = Annotated[bool, typer.Option("--force", help="replace files that exist")]


def with_fields(kind: type) -> Callable[[Callable[..., Result]], Callable[..., Result]]:
    """A command whose parameter ``options`` is a dataclass of options, each field an option of the command line."""

    def decorate(command: Callable[..., Result]) -> Callable[..., Result]:
        fields = dataclasses.fields(kind)
        hints = get_type_hints(kind, include_extras=True)
        keyword = inspect.Parameter.KEYWORD_ONLY
        given: list[inspect.Parameter] = []
        for parameter in inspect.signature(command, eval_str=True).parameters.values():
            if parameter.name != "options":
                given.append(parameter.replace(kind=keyword))
                continue
            given += [inspect.Parameter(f.name, keyword, default=f.default, annotation=hints[f.name]) for f in fields]

        def run(**arguments: Any) -> Result:
            own = {field.name: arguments.pop(field.name) for field in fields}
            return command(options=kind(**own), **arguments)

        run.__name__, run.__doc__ = command.__name__, command.__doc__
        run.__signature__ = inspect.Signature(given)  # type: ignore[attr-defined]
        run.__annotations__ = {parameter.name: parameter.annotation for parameter in given}
        return run

    return decorate

"""Options that several commands share."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from eimi_lab.commands.result import Result

Protocol = Annotated[
    str,
    typer.Argument(help="protocol.toml, or the name of a protocol that comes with the program, such as dragon_skin_10"),
]
Specimen = Annotated[
    str,
    typer.Option(
        metavar="FILE", help="specimen.toml, or the name of a specimen that comes with the program, such as type1"
    ),
]
Output = Annotated[Path, typer.Option("-o", "--output", metavar="FILE", help="file to write")]
Workers = Annotated[
    int, typer.Option(help="number of processes that compute in parallel; at most the number of processors", min=1)
]
Force = Annotated[bool, typer.Option("--force", help="overwrite existing files")]


def with_fields(kind: type) -> Callable[[Callable[..., Result]], Callable[..., Result]]:
    """Return a decorator that gives a command one option for each field of a dataclass.

    Parameters
    ----------
    kind : type
        The dataclass. The parameter ``options`` of the command is an instance of this class.
    """

    def decorate(command: Callable[..., Result]) -> Callable[..., Result]:
        fields = dataclasses.fields(kind)
        hints = get_type_hints(kind, include_extras=True)
        keyword = inspect.Parameter.KEYWORD_ONLY
        parameters: list[inspect.Parameter] = []
        for parameter in inspect.signature(command, eval_str=True).parameters.values():
            if parameter.name != "options":
                parameters.append(parameter.replace(kind=keyword))
                continue
            parameters += [
                inspect.Parameter(f.name, keyword, default=f.default, annotation=hints[f.name]) for f in fields
            ]

        def run(**arguments: Any) -> Result:
            field_values = {field.name: arguments.pop(field.name) for field in fields}
            return command(options=kind(**field_values), **arguments)

        run.__name__, run.__doc__ = command.__name__, command.__doc__
        run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
        return run

    return decorate

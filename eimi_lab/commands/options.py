"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Specimen = Annotated[str, typer.Option(help="specimen.toml, or the name of a shipped one such as type1")]
Output = Annotated[Path, typer.Option("-o", "--output", help="the file to write")]
Force = Annotated[bool, typer.Option("--force", help="replace files that exist")]

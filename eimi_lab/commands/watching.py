"""The page that a browser shows."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from eimi_lab.process.errors import InputError, tell


def dashboard(
    folder: Annotated[Path, typer.Argument(help="datasets, pictures and TOML files; nothing outside it")] = Path(),
    port: Annotated[int, typer.Option(help="to listen on; 0 takes any free one", min=0, max=65535)] = 0,
    host: Annotated[str, typer.Option(help="address of this machine to listen on")] = "127.0.0.1",
    open_to_network: Annotated[
        bool,
        typer.Option(
            "--open-to-network",
            help="with --host: whoever has the token sees the pictures and drives the coil, over an unencrypted line",
        ),
    ] = False,
    browser: Annotated[bool, typer.Option("--browser", help="open the page in the browser, too")] = False,
) -> None:
    """Serve the live page of a folder to a browser on this machine, until Ctrl-C."""
    try:
        from eimi_lab.page.redirect_file import redirect_file
        from eimi_lab.page.server import check_host, serve
    except ModuleNotFoundError as error:
        raise InputError(f"eimi dashboard needs {error.name}: pip install 'eimi-lab[page]'") from error

    with ExitStack() as until_the_end:

        def say(address: str) -> None:
            print(address, flush=True)
            tell("open this address in a browser of this machine; Ctrl-C ends the page, and a run with it, coil off")
            if browser:
                import webbrowser

                webbrowser.open(until_the_end.enter_context(redirect_file(address)).as_uri())

        check_host(host, open_to_network)
        serve(folder, host, port, say)

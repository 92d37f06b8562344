"""The commands `dashboard` and `phone`, which serve the live page."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from eimi_lab.process.errors import InputError, tell

Port = Annotated[int, typer.Option(help="port at which the page is served; 0 chooses a free port", min=0, max=65535)]
Host = Annotated[str, typer.Option(metavar="ADDRESS", help="address of this computer at which the page is served")]


def dashboard(
    folder: Annotated[
        Path, typer.Argument(help="folder with datasets, images and TOML files; the page uses no other folder")
    ] = Path(),
    port: Port = 0,
    host: Host = "127.0.0.1",
    open_to_network: Annotated[
        bool,
        typer.Option(
            "--open-to-network",
            help="allow a --host that other computers can reach: everybody who has the printed address, which contains "
            "a secret token, can see the images and control the coil, and the connection is not encrypted",
        ),
    ] = False,
    browser: Annotated[bool, typer.Option("--browser", help="also open the page in the browser")] = False,
) -> None:
    """Serve a live page to a browser on this machine, until Ctrl-C.

    With the page you can run protocols, watch runs, look at images and fit laws.
    """
    _serve(folder, host, port, open_to_network, browser)


def phone(
    folder: Annotated[Path, typer.Argument(help="folder for the photographs; it may be empty at first")],
    port: Port = 0,
    host: Host = "127.0.0.1",
    open_to_network: Annotated[
        bool,
        typer.Option(
            "--open-to-network",
            help="allow a --host that other devices, such as the phone, can reach; the connection is not encrypted",
        ),
    ] = False,
    browser: Annotated[bool, typer.Option(help="open the page in the browser")] = True,
) -> None:
    """Serve a page to measure photographs of a beam under weights.

    The command opens the page "Weights and a phone" in the browser, and serves this page until Ctrl-C. On the page you
    click the clamp, the tip and two ticks of a ruler, and type the dimensions and the weights in grams. The page writes
    specimen.toml, calibration.toml, states.csv and a dataset into the folder, and fits the dataset.
    """
    _serve(folder, host, port, open_to_network, browser, "phone")


def _serve(folder: Path, host: str, port: int, open_to_network: bool, browser: bool, view: str = "") -> None:
    try:
        from eimi_lab.page.redirect_file import redirect_file
        from eimi_lab.page.server import check_host, serve
    except ModuleNotFoundError as error:
        raise InputError(f"eimi {view or 'dashboard'} needs {error.name}: pip install 'eimi-lab[page]'") from error

    with ExitStack() as until_the_end:

        def say(address: str) -> None:
            print(address, flush=True)
            tell(
                "open this address in a browser on this computer; press Ctrl-C to end the page; a run then ends with "
                "the coil off"
            )
            if browser:
                import webbrowser

                webbrowser.open(until_the_end.enter_context(redirect_file(address)).as_uri())

        check_host(host, open_to_network)
        serve(folder, host, port, say, view)

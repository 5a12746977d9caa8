"""`cellctl console`: serves the operator's console until Ctrl-C."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cellctl.cli import arguments

if TYPE_CHECKING:
    from cellctl.console.shared import Console


def console(
    cell: arguments.ViewedCell = None,
    host: Annotated[str, typer.Option(help="Address of this machine to listen at.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port to listen at.", min=1, max=65535)] = 8090,
    runs: arguments.Runs = Path("runs"),
) -> None:
    """Serve the operator's console and its JSON API until Ctrl-C.

    Runs go on when the console ends. Everybody who can open the page can read; commands need the token, which is
    printed once at the start.

    Example: cellctl console --cell sphere_cell
    """
    from cellctl.console.server import serve
    from cellctl.console.shared import Settings

    serve(Settings(runs, cell, host, port), _announce)


def _announce(console: Console) -> None:
    settings = console.settings
    host = f"[{settings.host}]" if ":" in settings.host else settings.host
    address = f"http://{host}:{settings.port}/"
    typer.echo(f"console   {address}  (runs in {settings.runs}; Ctrl-C ends it, not the runs)")
    typer.echo(f"commands  {address}?token={console.sessions.token}")
    typer.echo(f"token     {console.sessions.token}")

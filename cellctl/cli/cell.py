"""`cellctl doctor`, `krl`, `sim`, `console`: a cell's devices, controller files, simulators, operator's console."""

from __future__ import annotations

import asyncio
import getpass
import signal
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import typer

from cellctl.cli import arguments
from cellctl.cli.arguments import refuse_outputs, write_json
from cellctl.cli.commissioning import commission_cell, write_page
from cellctl.cli.exit_codes import Exit
from cellctl.cli.run_progress import show_warnings
from cellctl.clock import WallClock
from cellctl.console.server import serve
from cellctl.console.sessions import IDLE_MIN
from cellctl.console.shared import Console, Settings
from cellctl.console.webhook import checked_url
from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.files import InputError
from cellctl.operations.cell_devices import (
    INSTRUCTIONS,
    as_loaded,
    require_cells,
    require_files,
    send_files,
    simulator_command,
)
from cellctl.operations.doctor import Examined, examination
from cellctl.operations.results import as_json

_WIDTH = 120


def doctor(
    cell: arguments.Cell,
    seed: arguments.Seed = None,
    json_: arguments.Json = None,
    commission: Annotated[bool, typer.Option("--commission", help="Lead through the first hour at the cell.")] = False,
    page: Annotated[
        Path | None,
        typer.Option(help="Write the commissioning as an HTML page; without --commission as it is, nothing is opened."),
    ] = None,
    clock: Annotated[
        Literal["realtime", "lockstep"] | None, typer.Option(help="Time of a simulated cell that is commissioned.")
    ] = None,
    motion: Annotated[bool, typer.Option(help="With --commission: go on to the steps that move.")] = True,
    yes: Annotated[
        bool, typer.Option("--yes", help="Confirm each step without asking, but no motion of a real robot.")
    ] = False,
    operator: Annotated[str | None, typer.Option(help="Who commissions the cell. Default: the user's name.")] = None,
) -> None:
    """Connect to every device of a cell and report its health; nothing moves.

    One row for each device: identity, firmware, latency, fit of its clock to the cell's, health. A device that fails
    does not keep the others from being tried. Exit code 0: all are healthy; 3: one is not.

    With --commission step by step, each confirmed, into commissioning.json beside the cell file: connections,
    telegrams, trips by hand, then what moves: a tenth of a degree, stops, one touch. The next call goes on where this
    one ended.

    Example: cellctl doctor sphere_cell
    """
    refuse_outputs({"--json": json_, "--page": page}, [cell])
    if not commission and (clock or yes or operator or not motion):
        raise typer.BadParameter("--clock, --no-motion, --yes and --operator go with --commission")
    drivers = DriverRegistry()
    if page and not commission:
        write_page(Cell.load(cell, drivers), page)
        return
    require_cells()
    loaded = Cell.load(cell, drivers)
    show_warnings(loaded)
    if commission:
        name = operator or getpass.getuser()
        commission_cell(loaded, drivers, name, seed=seed, clock=clock, motion=motion, yes=yes, page=page, json_=json_)
    found = asyncio.run(examination(loaded, drivers, seed))
    if json_ != "-":
        _show(found.devices)
    write_json(as_json(found), json_)
    for one in found.devices:
        if not one.healthy:
            typer.echo(f"cellctl: {one.name}: {one.what}\n    {one.cure}", err=True)
    if not found.healthy:
        raise typer.Exit(Exit.DEVICE_FAILED)


def _show(found: Sequence[Examined]) -> None:
    from rich.console import Console  # only for people: 0.1 s
    from rich.table import Table  # only for people: 0.1 s

    console = Console(highlight=False)
    console.width = max(console.width, _WIDTH)  # a narrow terminal may fold a line, but not truncate an identity
    table = Table(box=None, pad_edge=False)
    for title in ("device", "identity", "firmware"):
        table.add_column(title, overflow="fold")
    table.add_column("latency", justify="right", no_wrap=True)
    table.add_column("clock", no_wrap=True)
    table.add_column("health", overflow="fold")
    for one in found:
        table.add_row(*_cells(one), style="" if one.healthy else "red")
    console.print(table)


def _cells(one: Examined) -> list[str]:
    from rich.markup import escape  # only for people: 0.1 s

    identity = one.identity
    named = f"{identity.model} {identity.serial}" if identity and identity.serial not in identity.model else ""
    clock = one.clock
    cells = [
        one.name,
        named or (identity.model if identity else "–"),
        (identity.firmware if identity else "") or "–",
        "–" if one.latency_ms is None else f"{one.latency_ms:.1f} ms",
        f"{clock.drift_ppm:+.1f} ppm ± {clock.sigma_ms * 1e3:.0f} µs" if clock else "–",
        f"ok: {one.health}" if one.healthy else f"FAILED: {one.what}",
    ]
    return [escape(cell) for cell in cells]


def krl(
    cell: arguments.Cell,
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder to write to.")],
    device: Annotated[str | None, typer.Option(help="Device, if several have a controller to load.")] = None,
    load_to: Annotated[
        str | None, typer.Option(help="Folder on the controller to write the files to as well (C3 Bridge).")
    ] = None,
    json_: arguments.Json = None,
) -> None:
    """Write the files to load on the controller.

    KUKA: KRL programs, EthernetKRL channel, Ethernet configuration, RSI context. UR: the resident program in URScript.
    README.txt states where each file goes, and what has not been tried on a real controller yet. No device is opened,
    unless --load-to names a folder on the controller: then the files (not README.txt) are written there and read back.

    Example: cellctl krl sphere_cell -o krc
    """
    refuse_outputs({"--json": json_}, [cell])
    drivers = DriverRegistry()
    loaded = Cell.load(cell, drivers)
    name, made = _made(loaded, drivers, device)
    if load_to is not None:
        require_files(loaded, drivers, name)
    if out.exists() and not out.is_dir():
        raise typer.BadParameter(f"{out} is a file; give a folder")
    out.mkdir(parents=True, exist_ok=True)
    for file, text in made.items():
        (out / file).write_bytes(as_loaded(file, text))
    sent = asyncio.run(send_files(loaded, drivers, name, load_to, made)) if load_to is not None else []
    if json_ != "-":
        typer.echo(f"{len(made)} file{'s' * (len(made) != 1)} in {out}: {', '.join(made)}")
        before = f"read {out / INSTRUCTIONS}" if INSTRUCTIONS in made else "read its driver's documents"
        typer.echo(f"Not tried on a real controller: {before} before you load them.")
        for path in sent:
            typer.echo(f"Written to the controller and read back: {path}")
    write_json({"folder": str(out), "files": list(made), "sent": sent}, json_)


def _made(cell: Cell, drivers: DriverRegistry, device: str | None) -> tuple[str, dict[str, str]]:
    """The only device that has files for its controller, and these. Raises InputError if none has, or more than one."""
    if device is not None and device not in cell.addresses:
        known = ", ".join(sorted(cell.addresses))
        raise InputError(cell.document.problem((), f"has no device '{device}'", f"its devices: {known}"))
    found: dict[str, dict[str, str]] = {}
    for name, address in cell.addresses.items():
        if device in (None, name):
            files = drivers.controller_files(cell.name, address, cell.surroundings(name, WallClock()))
            if files is not None:
                found[name] = files
    if len(found) == 1:
        return next(iter(found.items()))
    what = f"several controllers can be loaded: {', '.join(found)}" if found else "has no controller to load files on"
    raise InputError(cell.document.problem((), what, "name one with --device" if found else ""))


def sim(
    cell: arguments.Cell,
    clock: Annotated[Literal["realtime", "lockstep"] | None, typer.Option(help="Time of the cell.")] = None,
    seed: arguments.Seed = None,
    ready: Annotated[Path | None, typer.Option(help="Write the device addresses to this file once all listen.")] = None,
) -> None:
    """Run a cell's simulators until Ctrl-C.

    Example: cellctl sim sphere_cell --clock realtime --ready /tmp/ready.json
    """
    refuse_outputs({"--ready": ready}, [cell])
    require_cells()
    loaded = Cell.load(cell, DriverRegistry())
    if not loaded.simulated:
        cure = "add it, or run against the real cell"
        raise InputError(loaded.document.problem((), "this cell has no `simulate:` section", cure))
    process = subprocess.Popen(simulator_command(cell, seed, clock, ready), start_new_session=True)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: process.terminate())
    raise typer.Exit(process.wait())


def console(
    cell: arguments.ViewedCell = None,
    host: Annotated[str, typer.Option(help="Address of this machine to listen at.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port to listen at.", min=1, max=65535)] = 8090,
    runs: arguments.Runs = Path("runs"),
    index: arguments.Index = None,
    tls_cert: Annotated[
        Path | None, typer.Option(help="Encrypt: file of the certificate with its chain, PEM. With --tls-key.")
    ] = None,
    tls_key: Annotated[Path | None, typer.Option(help="File of the certificate's private key, PEM.")] = None,
    users: Annotated[
        Path | None,
        typer.Option(help="Let only the named users in this file in, each with a role: see `cellctl users`."),
    ] = None,
    idle_min: Annotated[
        float, typer.Option(help="Time without use after which a user is signed out, min.", min=1.0)
    ] = IDLE_MIN,
    webhook: Annotated[
        str,
        typer.Option(
            help="Post alarms, ends of runs, and what waits for a person to this address. Other users of the computer "
            "see a command line; set CELLCTL_WEBHOOK for an address with a secret.",
            envvar="CELLCTL_WEBHOOK",
            show_envvar=False,
        ),
    ] = "",
) -> None:
    """Serve the operator's console and its JSON API until Ctrl-C.

    Runs go on when the console ends. Everybody who can open the page can read; commands need the token, which is
    printed once at the start. With --users nobody reads or commands who has not signed in.

    Example: cellctl console --cell sphere_cell
    """
    if (tls_cert is None) != (tls_key is None):
        raise typer.BadParameter("--tls-cert and --tls-key go together")
    tls = (tls_cert, tls_key) if tls_cert and tls_key else None
    url = checked_url(webhook) if webhook else ""
    serve(Settings(runs, cell, host, port, tls, url, users, idle_min), _announce)


def _announce(console: Console) -> None:
    settings = console.settings
    host = f"[{settings.host}]" if ":" in settings.host else settings.host
    address = f"{settings.scheme}://{host}:{settings.port}/"
    typer.echo(f"console   {address}  (runs in {settings.runs}; Ctrl-C ends it, not the runs)")
    if settings.users:
        typer.echo(f"users     {settings.users}")
        return
    typer.echo(f"commands  {address}?token={console.sessions.token}")
    typer.echo(f"token     {console.sessions.token}")

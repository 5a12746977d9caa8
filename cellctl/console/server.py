"""Serves the console: application, guards, start and end."""

from __future__ import annotations

import asyncio
import ipaddress
import os
import re
import secrets
import socket
import ssl
import tempfile
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from importlib import import_module
from itertools import chain
from pathlib import Path

from fastapi import FastAPI
from jinja2 import ChoiceLoader, DictLoader
from starlette.templating import Jinja2Templates
from starlette.types import ASGIApp

from cellctl.console.api.answers import INVALID, TAGS, answer_errors, answer_unknown, summarise, unique_id
from cellctl.console.guarding import LARGEST_BODY, Guard, names_of
from cellctl.console.live import LiveRuns
from cellctl.console.overview import calibration_causes, drift_causes, known_cells, rows_of_cells
from cellctl.console.scene.run_points import installed_sources
from cellctl.console.sessions import Sessions
from cellctl.console.shared import Audit, Console, Settings, use
from cellctl.console.signing_in import router as signing_in
from cellctl.console.users import UsersFile, read_users
from cellctl.console.watching import Watch
from cellctl.files import InputError, Problem
from cellctl.operations.fleet import fleet
from cellctl.version import __version__

ROUTERS = ("console", "cells", "attention", "starting", "queue", "running", "runs", "tables", "analyses", "metrics")
"""Modules of `cellctl.console.api` with a `router`."""

PAGES = (
    "home",
    "api",
    "overview",
    "cell",
    "alarms",
    "start",
    "jobs",
    "run",
    "runs",
    "result",
    "compare",
    "histories",
    "fleet",
    "tables",
    "analyse",
    "analyse_one",
)
"""Modules of `cellctl.console.pages`."""


def new_console(settings: Settings, token: str = "") -> Console:
    """The state of a console. `token`: empty for a new, random one (128 bits)."""
    users = UsersFile(settings.users) if settings.users else None
    sessions = Sessions(token or secrets.token_urlsafe(16), users, settings.idle_min * 60.0)
    live = LiveRuns(settings.runs)
    watch = Watch(settings.runs)
    watch.due = lambda index: chain(
        calibration_causes(known_cells(settings.cell, rows_of_cells(index))),
        drift_causes(fleet(index, settings.runs).robots),
    )
    return Console(settings, sessions, Audit(settings.runs), live, watch)


def api_app(console: Console) -> FastAPI:
    """The JSON API, without pages and guards; what it follows runs as long as the application."""
    use(console)

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        async with console.following():
            yield

    app = FastAPI(
        title="cellctl console",
        version=__version__,
        description="Runs, cells, tables and analyses of one folder of runs. mm, deg, s, A, °C unless a name differs.",
        openapi_tags=TAGS,
        generate_unique_id_function=unique_id,
        responses=INVALID,
        docs_url=None,
        redoc_url=None,
        openapi_url="/api/openapi.json",
        lifespan=lifespan,
    )
    answer_errors(app)
    app.include_router(signing_in)
    for name in ROUTERS:
        app.include_router(import_module(f"cellctl.console.api.{name}").router)
    answer_unknown(app)
    summarise(app)
    return app


def guarded(app: ASGIApp, console: Console, largest_body: int = LARGEST_BODY) -> Guard:
    """`app` behind the guards of `console`."""
    settings = console.settings
    names = names_of(settings.host, settings.port, settings.scheme)
    return Guard(app, names, console.sessions, f"cellctl_console_{settings.port}", largest_body, settings.scheme)


def console_app(console: Console) -> Guard:
    """The whole application: API and pages, guarded."""
    os.environ.setdefault("NICEGUI_STORAGE_PATH", str(Path(tempfile.gettempdir()) / "cellctl-console"))
    from nicegui import app as pages  # it takes a second, and configures itself
    from nicegui import client, ui  # it takes a second, and configures itself

    app = api_app(console)
    pages.state.openapi = app.openapi
    for name in PAGES:
        import_module(f"cellctl.console.pages.{name}")
    pages.on_startup(lambda: asyncio.to_thread(installed_sources))  # its imports take a second of the first run page
    _give_nonces(client.templates)
    ui.run_with(
        app,
        title="cellctl",
        tailwind=False,
        show_welcome_message=False,
        language="en-GB",
        reconnect_timeout=5.0,
        favicon=_FAVICON,
        dark=None,
    )
    return guarded(app, console)


def _give_nonces(templates: Jinja2Templates) -> None:
    """Give NiceGUI's own scripts and styles the nonce of their page; what a page adds to its head and body has its own.

    The text of the template is changed, never a finished page: there, names of runs could be taken for scripts.
    """
    loader = templates.env.loader
    assert loader is not None
    text = loader.get_source(templates.env, "index.html")[0]
    nonce = "{{ request.scope['cellctl.nonce'] }}"
    for tag in ("script", "style"):
        text = re.sub(rf"<{tag}(?=[ >])", f'<{tag} nonce="{nonce}"', text)
    text = text.replace('createElement("style"), {', f'createElement("style"), {{ nonce: "{nonce}",')
    # the body begins with the styles of NiceGUI's components
    own = """'<style nonce="' ~ request.scope['cellctl.nonce'] ~ '">'"""
    text = text.replace("body_html | safe", f"body_html | replace('<style>', {own}, 1) | safe")
    templates.env.loader = ChoiceLoader([DictLoader({"index.html": text}), loader])


_FAVICON = (
    "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 32 32'><circle cx='16' cy='16' r='13' fill='none' "
    "stroke='#0b5394' stroke-width='4'/><circle cx='16' cy='16' r='4' fill='#0b5394'/></svg>"
)


def serve(settings: Settings, announce: Callable[[Console], None], token: str = "") -> None:
    """Serve the console until Ctrl-C or SIGTERM. `announce` is called when it listens.

    Raises InputError if the address is no single address of this machine, or its port is taken; for files of a
    certificate or of users that cannot be used; and for users at another address than loopback without encryption.
    """
    import uvicorn  # it takes a second, and configures itself

    certificate, key = settings.tls or (None, None)
    if settings.tls:
        _check_certificate(*settings.tls)
    if settings.users:
        read_users(settings.users)
    listening = _listening(settings)
    console = new_console(settings, token)
    app = console_app(console)
    config = uvicorn.Config(
        app,
        log_level="warning",
        ws_max_size=LARGEST_BODY,
        timeout_graceful_shutdown=2,
        ssl_certfile=certificate,
        ssl_keyfile=key,
    )
    try:
        refuse_open_passwords(settings, listening.getsockname()[0])
        announce(console)
        uvicorn.Server(config).run(sockets=[listening])
    except KeyboardInterrupt:  # Ctrl-C is how a console ends
        pass
    finally:
        listening.close()


def _check_certificate(certificate: Path, key: Path) -> None:
    """Raises InputError unless the key is that of the certificate, without a password, and closed to other users."""
    try:
        if os.name == "posix" and key.stat().st_mode & 0o007:
            what = "every user of this machine may read the private key, or write it"
            raise InputError(Problem(str(key), 0, 0, what, f"chmod o= {key}"))
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key, password="")
    except OSError as error:  # ssl.SSLError is one
        what = f"cannot be used as certificate and private key: {error.strerror or error}"
        cure = "give PEM files: the certificate with its chain, and its key without a password"
        raise InputError(Problem(f"{certificate}, {key}", 0, 0, what, cure)) from error


def refuse_open_passwords(settings: Settings, address: str) -> None:
    """Raises InputError if users would send their passwords to `address` over a network without encryption."""
    if settings.users and not settings.tls and not ipaddress.ip_address(address.partition("%")[0]).is_loopback:
        what = "passwords would cross the network without encryption"
        cure = "give --tls-cert and --tls-key; or listen at 127.0.0.1, and forward the port by ssh"
        raise InputError(Problem(f"--users {settings.users} --host {address}", 0, 0, what, cure))


def _listening(settings: Settings) -> socket.socket:
    """A socket at the address; connections wait in it until the server takes them."""
    host, port = settings.host, settings.port
    place = f"--host {host} --port {port}"
    if host in ("0.0.0.0", "::", ""):
        what = "stands for all addresses of this machine"
        raise InputError(Problem(place, 0, 0, what, "name one address, such as 127.0.0.1"))
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        listening = socket.socket(found[0], socket.SOCK_STREAM)
        if os.name == "posix":
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind(found[4])
        listening.listen(128)
    except OSError as error:
        cure = "is another console running? give another port with --port, or an address of this machine with --host"
        raise InputError(Problem(place, 0, 0, f"cannot listen here: {error.strerror or error}", cure)) from error
    return listening

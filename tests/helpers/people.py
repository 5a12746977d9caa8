"""A console with named users, and browsers and programs that use it without a socket."""

from __future__ import annotations

import asyncio
import functools
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
from fastapi import FastAPI

from cellctl.console.guarding import Guard
from cellctl.console.server import api_app, guarded, new_console
from cellctl.console.shared import Console, Settings, use
from cellctl.console.users import Role, User, hashed_password, read_users, write_users
from cellctl.files import sha256_of

ROLES: dict[str, Role] = {"Ada": "engineer", "Bo": "operate", "Cy": "view"}
PASSWORD = "correct horse battery"
HERE = "http://127.0.0.1:8090"
_HASHED = hashed_password(PASSWORD)


def users_file(folder: Path) -> Path:
    """A file with the users of ROLES; PASSWORD is everyone's, `token of NAME` their programs' token."""
    file = folder / "users.yaml"
    write_users(file, [User(name, role, _HASHED, sha256_of(f"token of {name}")) for name, role in ROLES.items()])
    return file


@functools.cache
def _api() -> FastAPI:
    """The routes, for the console in use: they take 0.3 s to make."""
    return api_app(new_console(Settings(Path("runs"))))


@dataclass
class People:
    """The console (its token is `secret`), its application, and the time, s, that passes as a test says."""

    file: Path | None
    console: Console
    app: Guard
    time_s: float = 1000.0

    @classmethod
    def at(cls, folder: Path, *, users: bool = True) -> People:
        """A console over `folder`, with users or with the token alone."""
        file = users_file(folder) if users else None
        console = new_console(Settings(folder / "runs", users=file), "secret")
        app = _api()
        use(console)
        made = cls(file, console, guarded(app, console))
        console.sessions.now = console.sessions.tries.now = lambda: made.time_s
        return made

    def change(self, *users: User) -> None:
        """Put `users` in the place of those with their names."""
        assert self.file
        write_users(self.file, {**read_users(self.file), **{user.name: user for user in users}}.values())

    def browser(self, address: str = "10.0.0.1") -> Browser:
        """A browser at an address."""
        return Browser(self.app, address)


class Browser:
    """Keeps its cookies; follows no redirection."""

    def __init__(self, app: Any, address: str) -> None:
        self.client = httpx.AsyncClient(transport=httpx.ASGITransport(app, client=(address, 50000)), base_url=HERE)

    def get(self, path: str, **more: Any) -> httpx.Response:
        return self.send("GET", path, **more)

    def send(self, method: str, path: str, **more: Any) -> httpx.Response:
        return asyncio.run(self.client.request(method, path, **more))

    def sign_in(self, name: str, password: str = PASSWORD, to: str = "/runs", **more: Any) -> httpx.Response:
        return self.send("POST", "/login", data={"name": name, "password": password, "to": to}, **more)

    @property
    def reads(self) -> bool:
        """Whether it may read."""
        return self.get("/api/console").status_code == 200

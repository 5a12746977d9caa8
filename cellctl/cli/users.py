"""`cellctl users`: who may sign in at a console, and with which role."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from cellctl.cli import arguments
from cellctl.cli.arguments import write_json
from cellctl.console.users import Role, User, hashed_password, new_token, plain_name, read_users, write_users
from cellctl.files import InputError, Problem

app = typer.Typer(
    no_args_is_help=True,
    help="Add, remove and change the named users of a console.\n\n"
    "A console that runs with this file takes each change at once.",
)

Name = Annotated[str, typer.Argument(help="Name of the user, as it stands in the audit log.")]
File = Annotated[Path, typer.Option("--users", help="File of the users.")]
RoleOption = Annotated[
    Role,
    typer.Option(help="view: read, pause and abort; operate: also start and answer; engineer: also tables and models."),
]
_FILE = Path("users.yaml")


@app.command()
def add(name: Name, role: RoleOption, users: File = _FILE) -> None:
    """Add a user. The password is asked for, or read from stdin; the file is made if it is missing.

    Example: cellctl users add Ada --role engineer
    """
    known = read_users(users) if users.exists() else {}
    plain = plain_name(name)
    if not plain or plain in known:
        cure = "give one letter or more" if not plain else "change it by `password`, `role` or `token`"
        raise InputError(Problem(str(users), 0, 0, "has this user already" if plain else "no name is given", cure))
    write_users(users, [*known.values(), User(plain, role, hashed_password(_given_password()))])
    typer.echo(f"{plain} may sign in as {role}")


@app.command()
def remove(name: Name, users: File = _FILE) -> None:
    """Remove a user; the user's sessions end."""
    _change(users, name, lambda _: None)
    typer.echo(f"{plain_name(name)} is no user any more")


@app.command("list")
def list_(users: File = _FILE, json_: arguments.Json = None) -> None:
    """List names and roles."""
    found = read_users(users).values()
    if json_ != "-":
        for user in found:
            typer.echo(f"{user.role:10}{user.name}{'  (with a token for programs)' if user.token else ''}")
    write_json({"users": [{"name": user.name, "role": user.role, "token": bool(user.token)} for user in found]}, json_)


@app.command()
def role(
    name: Name, role: Annotated[Role, typer.Argument(help="view, operate or engineer.")], users: File = _FILE
) -> None:
    """Change the role of a user; the user's sessions end."""
    _change(users, name, lambda user: replace(user, role=role))
    typer.echo(f"{plain_name(name)} may sign in as {role}")


@app.command()
def password(name: Name, users: File = _FILE) -> None:
    """Change the password of a user, asked for or read from stdin; the user's sessions end."""
    _known(users, name)
    hashed = hashed_password(_given_password())
    _change(users, name, lambda user: replace(user, password=hashed))
    typer.echo(f"{plain_name(name)} has another password")


@app.command()
def token(
    name: Name,
    users: File = _FILE,
    remove: Annotated[bool, typer.Option("--remove", help="Remove the token, and make no other one.")] = False,
) -> None:
    """Make a token for the user's programs, in place of the one before, and print it: it is not kept.

    Example: cellctl users token Ada
    """
    made, hashed = ("", "") if remove else new_token()
    _change(users, name, lambda user: replace(user, token=hashed))
    typer.echo(made or f"{plain_name(name)} has no token")


def _known(file: Path, name: str) -> User:
    found = read_users(file)
    user = found.get(plain_name(name))
    if user is None:
        raise InputError(Problem(str(file), 0, 0, f"has no user '{name}'", f"one of: {', '.join(found) or 'none'}"))
    return user


def _change(file: Path, name: str, changed: Callable[[User], User | None]) -> None:
    """Write what `changed` makes of the user; None: the user is removed."""
    one = _known(file, name)
    made = [changed(user) if user.name == one.name else user for user in read_users(file).values()]
    write_users(file, [user for user in made if user])


def _given_password() -> str:
    """A password from the terminal, twice, or the first line of stdin; never from the command line."""
    if sys.stdin.isatty():
        return str(typer.prompt("Password", hide_input=True, confirmation_prompt=True))
    return sys.stdin.readline().rstrip("\r\n")

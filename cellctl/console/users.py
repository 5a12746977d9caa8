"""The named users of a console: their file, their passwords and the tokens of their programs.

The file is YAML, closed to other users of the computer:

    users:
      - name: "Ada"
        role: engineer
        password: "$argon2id$v=19$m=19456,t=2,p=1$…"
        token: "…"  # SHA-256 of the token for programs, hex; may be missing

Sources: OWASP Password Storage (cost of Argon2id); RFC 9106 (Argon2); RFC 8265 (NFC of names and passwords).
"""

from __future__ import annotations

import json
import logging
import os
import secrets
import unicodedata
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Annotated, Final, Literal, final

from argon2 import PasswordHasher
from argon2.exceptions import Argon2Error, InvalidHashError
from pydantic import BaseModel, ConfigDict, StringConstraints

from cellctl.files import Document, InputError, Problem, load_yaml, sha256_of, write_atomically
from cellctl.files.validated import validated

Role = Literal["view", "operate", "engineer"]
ROLES: Final[tuple[Role, ...]] = ("view", "operate", "engineer")
"""Each may do what those before it may."""

SHORTEST_PASSWORD, LONGEST_PASSWORD = 12, 1000
LONGEST_NAME = 80

_HASHER = PasswordHasher(time_cost=2, memory_cost=19456, parallelism=1)
"""19 MiB, 2 passes, 1 thread: OWASP's least cost. A try takes 20 ms of one core: a cell's real-time process may run
beside the console, and has the others.
"""


@final
@dataclass(frozen=True, slots=True)
class User:
    """A person who may sign in. password: Argon2id, encoded. token: SHA-256 (hex) of the one for programs, or empty."""

    name: str
    role: Role
    password: str = field(repr=False)
    token: str = field(default="", repr=False)

    def as_signed_in(self, other: User | None) -> bool:
        """Whether `other`, the user of this name now, still has the role and the password of this one."""
        return other is not None and (self.role, self.password) == (other.role, other.password)


class _Entry(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)
    name: Annotated[str, StringConstraints(min_length=1, max_length=LONGEST_NAME)]
    role: Role
    password: Annotated[str, StringConstraints(pattern=r"^\$argon2id\$v=19\$m=\d+,t=\d+,p=\d+\$[\w+/]+\$[\w+/]+$")]
    token: Annotated[str, StringConstraints(pattern=r"^([0-9a-f]{64})?$")] = ""


class _Content(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)
    users: list[_Entry]


def read_users(path: Path) -> dict[str, User]:
    """The users in the file `path` by name. Raises InputError: no file, open to others, or wrong content, by line."""
    try:
        mode = path.stat().st_mode
    except OSError as error:
        cure = "make it: `cellctl users add NAME --role engineer --users FILE`"
        raise InputError(Problem(str(path), 0, 0, f"cannot be read: {error.strerror}", cure)) from error
    if os.name == "posix" and mode & 0o077:
        what = f"other users of this computer may read or write it (mode {mode & 0o777:04o})"
        raise InputError(Problem(str(path), 0, 0, what, f"chmod 600 {path}"))
    document = load_yaml(path)
    entries = validated(document, _Content).users
    found: dict[str, User] = {}
    problems = []
    for number, entry in enumerate(entries):
        if problem := _wrong_name(document, number, entry.name, found):
            problems.append(problem)
        found[entry.name] = User(entry.name, entry.role, entry.password, entry.token)
    if problems:
        raise InputError(problems)
    return found


def _wrong_name(document: Document, number: int, name: str, found: Mapping[str, User]) -> Problem | None:
    place = ("users", number, "name")
    if name in found:
        return document.problem(place, f"'{name}' is there twice", "remove one of them")
    if name != plain_name(name):
        return document.problem(place, f"'{name}' is no name", f"write it '{plain_name(name)}'")
    return None


def write_users(path: Path, users: Iterable[User]) -> None:
    """Write the users to `path`; a new file is closed to other users from its beginning. Raises OSError."""
    lines = []
    for user in users:
        entry = {"name": user.name, "role": user.role, "password": user.password, "token": user.token}
        first, *others = [f"{key}: {json.dumps(text, ensure_ascii=False)}" for key, text in entry.items() if text]
        lines += [f"  - {first}", *(f"    {each}" for each in others)]
    if not path.exists():
        os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600))
    write_atomically(path, "\n".join(["users:", *lines, ""]) if lines else "users: []\n")


def plain_name(name: str) -> str:
    """A name as it is kept and compared: NFC, single spaces, printable letters alone, 80 at most."""
    spaced = " ".join(unicodedata.normalize("NFC", name).split())
    return "".join(letter for letter in spaced if letter.isprintable())[:LONGEST_NAME].strip()


def hashed_password(password: str) -> str:
    """The Argon2id of a password, encoded. Raises InputError for one that is too short or too long."""
    plain = unicodedata.normalize("NFC", password)
    if not SHORTEST_PASSWORD <= len(plain) <= LONGEST_PASSWORD:
        what = f"has {len(plain)} letters"
        cure = f"choose {SHORTEST_PASSWORD} or more: four words that nobody else would put together are easy to keep"
        raise InputError(Problem("password", 0, 0, what, cure))
    return _HASHER.hash(plain)


@cache
def _hash_of_nobody() -> str:
    """What a try for an unknown name is compared with: it takes the time of a wrong password."""
    return _HASHER.hash(secrets.token_hex())


def user_by_password(users: Mapping[str, User], name: str, password: str) -> User | None:
    """The user with this name and password; None for a wrong one, after the same time for an unknown name.

    Computes for some 20 ms: call it in a thread.
    """
    user = users.get(plain_name(name))
    plain = unicodedata.normalize("NFC", password[: LONGEST_PASSWORD + 1])
    try:
        _HASHER.verify(user.password if user else _hash_of_nobody(), plain)
    except (Argon2Error, InvalidHashError, UnicodeError):
        return None
    return user


def new_token() -> tuple[str, str]:
    """A token for a user's programs (256 bits), and what the file keeps of it."""
    token = f"cellctl_{secrets.token_urlsafe(32)}"
    return token, sha256_of(token)


def user_by_token(users: Mapping[str, User], token: str) -> User | None:
    """The user whose program sends `token`."""
    given = sha256_of(token.encode(errors="replace"))
    return next((user for user in users.values() if user.token and secrets.compare_digest(user.token, given)), None)


@final
class UsersFile:
    """The users in a file, which is read again when it has changed. While it cannot be used it lets nobody in."""

    def __init__(self, path: Path) -> None:
        self.path = path
        _hash_of_nobody()  # else the first try for an unknown name would take twice as long
        self._stamp: tuple[int, ...] = ()
        self._users: dict[str, User] = {}

    @property
    def users(self) -> Mapping[str, User]:
        """The users now, by name."""
        try:
            found = self.path.stat()
            stamp: tuple[int, ...] = (found.st_ino, found.st_size, found.st_mtime_ns, found.st_ctime_ns)
        except OSError:
            stamp = (0,)
        if stamp != self._stamp:
            self._stamp = stamp
            try:
                self._users = read_users(self.path)
            except InputError as error:
                self._users = {}
                logging.getLogger(__name__).error("nobody can sign in: %s", error)
        return self._users

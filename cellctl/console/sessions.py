"""Browsers and programs that use the console: who they are, by the console's token or as named users.

Sources: OWASP Session Management (a new id at each sign-in, an end after idle time).
"""

from __future__ import annotations

import asyncio
import getpass
import secrets
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, final

from cellctl.console.access import refuse_role, why_not
from cellctl.console.tries import Tries
from cellctl.console.users import Role, User, UsersFile, plain_name, user_by_password, user_by_token
from cellctl.engine import Operator

_MOST_SESSIONS = 1000
IDLE_MIN: Final = 60.0
"""Default time without use after which a user is signed out, min."""
_LOOK_S = 1.0
"""Time between two looks for sessions that have ended, s."""


@final
@dataclass(slots=True, eq=False)
class Session:
    """A browser. `operator`: who gives commands from it; None until then. `with_token`: it has given the console's
    token, so that only a name is missing. `user`: who signed in, as the file had the user then. `used`: s.
    """

    id: str
    operator: Operator | None = None
    with_token: bool = False
    user: User | None = None
    used: float = 0.0
    at_end: set[Callable[[], object]] = field(default_factory=set)
    """Called when it ends: its pages close."""


@final
class MustWait(Exception):
    """Nobody may try to sign in so soon after failures. `left_s`: time until then, s."""

    def __init__(self, left_s: float) -> None:
        self.left_s = left_s
        super().__init__(f"{left_s:.0f} s")


@final
@dataclass(slots=True)
class Sessions:
    """The browsers of this console, in memory: they end with it. `token`: allows commands; with a file of `users` it
    does not, and who is not signed in reads nothing. `now`: time, s.
    """

    token: str
    users: UsersFile | None = None
    idle_s: float = IDLE_MIN * 60.0
    now: Callable[[], float] = time.monotonic
    tries: Tries = field(default_factory=Tries)
    _one_try: asyncio.Lock = field(default_factory=asyncio.Lock)
    _known: dict[str, Session] = field(default_factory=dict)

    def of(self, number: str | None, *, keep: bool = True) -> Session:
        """The session with this id; a new one for an unknown id. keep: the browser is told its id, and comes again."""
        known = self._known.get(number or "")
        if known is not None and self._is_over(known):
            self.end(known)
            known = None
        if known is None:
            known = Session(secrets.token_urlsafe(24))
            if keep and self.users is None:
                self._keep(known)
        return known

    def _keep(self, session: Session) -> None:
        """Keep a session; if there are too many, forget the oldest that gives no commands, or else the oldest."""
        self._known[session.id] = session
        if len(self._known) > _MOST_SESSIONS:
            oldest = min(self._known.values(), key=lambda each: each.operator is not None)
            self.end(oldest) if oldest.user else self._known.pop(oldest.id)

    def allows(self, token: str) -> bool:
        """Whether `token` is the console's, and that is enough."""
        return self.users is None and secrets.compare_digest(token.encode(errors="replace"), self.token.encode())

    def open(self, session: Session, token: str, name: str) -> bool:
        """Allow commands from `session` as `name` if the token is right, or was before, and the name is one."""
        if not (plain_name(name) and (session.with_token or self.allows(token))):
            return False
        session.with_token, session.operator = True, operator_named(name)
        return True

    def invited(self, session: Session, token: str) -> Session | None:
        """A new session in place of `session` for the browser that brings the token; None for a wrong token.

        One that has stated a name keeps it.
        """
        if not self.allows(token):
            return None
        new = Session(secrets.token_urlsafe(24), session.operator, True)
        self._known.pop(session.id, None)
        self._keep(new)
        return new

    async def user_with(self, name: str, password: str, address: str) -> User | None:
        """The user with this name and password; None if one is wrong. Raises MustWait after too many failures.

        One try is computed at a time: strangers get no more than one core and 19 MiB.
        """
        async with self._one_try:
            if (wait := self.tries.wait_s(name, address)) > 0.0:
                raise MustWait(wait)
            users = self.users.users if self.users else {}
            user = await asyncio.to_thread(user_by_password, users, name, password)
            if user is None:
                self.tries.failed(name, address)
            else:
                self.tries.succeeded(name, address)
            return user

    def sign_in(self, user: User, before: Session) -> Session:
        """A new session of `user`; the one `before` it in the same browser ends."""
        self.end(before)
        new = Session(secrets.token_urlsafe(24), operator_named(user.name), user=user, used=self.now())
        self._keep(new)
        return new

    def end(self, session: Session) -> None:
        """Forget `session`; its pages give no more commands."""
        self._known.pop(session.id, None)
        session.operator, session.user, session.with_token = None, None, False
        for close in tuple(session.at_end):
            close()

    def _is_over(self, session: Session) -> bool:
        """Whether a user's session is idle for too long, or the user has gone, or got another role or password."""
        if self.users is None or session.user is None:
            return False
        now = self.users.users.get(session.user.name)
        return self.now() - session.used > self.idle_s or not session.user.as_signed_in(now)

    def may_read(self, session: Session) -> bool:
        """Whether the browser may read: everybody may, unless there are named users."""
        if session.user is not None and self._is_over(session):
            self.end(session)
        return self.users is None or session.user is not None

    def use(self, session: Session) -> None:
        """Note that a person uses `session` now."""
        session.used = self.now()

    async def end_in_time(self) -> None:
        """End the sessions of users that are over, each second, until this is cancelled."""
        while True:
            for session in list(self._known.values()):
                if self._is_over(session):
                    self.end(session)
            await asyncio.sleep(_LOOK_S)

    def of_program(self, token: str, name: str = "") -> Operator | None:
        """The operator of a program that sends `token`: a user's, or with the console's token one called `name`."""
        if self.users is not None:
            user = user_by_token(self.users.users, token)
            return operator_named(user.name) if user else None
        return operator_named(name) if self.allows(token) else None

    def role_of(self, operator: Operator) -> Role | None:
        """The role of a user now; None for one that is gone."""
        user = self.users.users.get(operator.name) if self.users else None
        return user.role if user else None

    def why_not(self, operator: Operator | None, command: str) -> str:
        """Why the operator may not give `command`; empty if that is not known to be so."""
        role = self.role_of(operator) if operator else None
        return why_not(role, command) if role else ""

    def refuse(self, operator: Operator | None, command: str) -> None:
        """Raise NotAllowed where there are users and the role of this one does not cover `command`."""
        if self.users is not None:
            refuse_role(operator.name if operator else "", self.role_of(operator) if operator else None, command)


def operator_named(name: str) -> Operator:
    """An operator at the console; an empty name is the user of this process. What is not printable is left out."""
    return Operator(plain_name(name) or getpass.getuser(), socket.gethostname(), "console")

"""Who uses the console: a session for each browser, and the token that allows commands."""

from __future__ import annotations

import getpass
import secrets
import socket
from dataclasses import dataclass, field
from typing import final

from cellctl.engine import Operator

_MOST_SESSIONS = 1000


@final
@dataclass(slots=True)
class Session:
    """A browser. `operator`: who gives commands from it; None until the token was given."""

    id: str
    operator: Operator | None = None


@final
@dataclass(slots=True)
class Sessions:
    """The browsers of this console, in memory: they end with it. `token`: allows commands."""

    token: str
    _known: dict[str, Session] = field(default_factory=dict)

    def of(self, number: str | None, *, keep: bool = True) -> Session:
        """The session with this id; a new one for an unknown id. keep: the browser is told its id, and comes again."""
        known = self._known.get(number or "")
        if known is None:
            known = Session(secrets.token_urlsafe(24))
            if keep:
                self._known[known.id] = known
                self._forget()
        return known

    def _forget(self) -> None:
        """Forget the oldest session that was not opened for commands, or else the oldest, if there are too many."""
        if len(self._known) > _MOST_SESSIONS:
            oldest = min(self._known.values(), key=lambda session: session.operator is not None)
            del self._known[oldest.id]

    def allows(self, token: str) -> bool:
        """Whether `token` is the console's."""
        return secrets.compare_digest(token.encode(errors="replace"), self.token.encode())

    def open(self, session: Session, token: str, name: str = "") -> bool:
        """Allow commands from `session` as `name` (empty: the user of this process) if the token is right."""
        if not self.allows(token):
            return False
        session.operator = operator_named(name)
        return True


def operator_named(name: str) -> Operator:
    """An operator at the console; an empty name is the user of this process. What is not printable is left out."""
    plain = "".join(letter for letter in " ".join(name.split()) if letter.isprintable())
    return Operator(plain[:80].strip() or getpass.getuser(), socket.gethostname(), "console")

"""What each role may do: one table of commands, with the routes of the API that give them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple, final

from cellctl.console.users import ROLES, Role
from cellctl.files import InputError, Problem


@final
class Access(NamedTuple):
    """The least role for a command, and the routes that give it."""

    role: Role
    routes: tuple[str, ...] = ()


COMMANDS: Final[Mapping[str, Access]] = {
    # whoever sees that something goes wrong may stop it
    "pause": Access("view", ("POST /api/runs/{name}/pause",)),
    "abort": Access("view", ("POST /api/runs/{name}/abort",)),
    "check": Access("operate", ("POST /api/check",)),
    "start": Access("operate", ("POST /api/runs", "POST /api/queue/{number}/confirm")),
    "resume": Access("operate", ("POST /api/runs/{name}/resume",)),
    "confirm": Access("operate", ("POST /api/runs/{name}/confirm",)),
    "reset": Access("operate", ("POST /api/runs/{name}/reset",)),
    "retry": Access("operate", ("POST /api/runs/{name}/retry",)),
    "doctor": Access("operate", ("POST /api/cells/{name}/doctor",)),
    "acknowledge": Access("operate", ("POST /api/alarms/{number}/acknowledge",)),
    "queue": Access("operate", ("POST /api/queue",)),
    "queue offer again": Access("operate", ("POST /api/queue/{number}/offer",)),
    "queue remove": Access("operate", ("DELETE /api/queue/{number}",)),
    "replay": Access("operate", ("POST /api/runs/{name}/replay",)),
    "report": Access("operate", ("POST /api/runs/{name}/report",)),
    "table look": Access("operate", ("POST /api/tables/look",)),
    # the route of all three actions; a push and a rollback are refused by their own rows
    "table verify": Access("operate", ("POST /api/tables/act",)),
    "table push": Access("engineer"),
    "table rollback": Access("engineer"),
    "schedule": Access("engineer", ("POST /api/schedules",)),
    "queue unschedule": Access("engineer", ("DELETE /api/schedules/{number}",)),
    "keep preset": Access("engineer"),
    "delete preset": Access("engineer"),
    "note": Access("operate", ("POST /api/runs/{name}/notes",)),
    "upload": Access("engineer", ("POST /api/analyses",)),
    "choose robot": Access("engineer", ("POST /api/analyses/{name}/robot",)),
    "fit": Access("engineer", ("POST /api/analyses/{name}/fit",)),
    "compensate": Access("engineer", ("POST /api/analyses/{name}/programs",)),
    "cancel": Access("engineer", ("POST /api/analyses/{name}/cancel",)),
    "delete": Access("engineer", ("DELETE /api/analyses/{name}",)),
}
"""Of every command. Reading (GET) is for every role. A command that is not here is for engineers."""

ROUTES: Final = {route: command for command, access in COMMANDS.items() for route in access.routes}
"""Route → its command."""


@final
class NotAllowed(InputError):
    """The role of a user does not cover a command."""


def least_role(command: str) -> Role:
    """The least role that may give `command`."""
    return COMMANDS[command].role if command in COMMANDS else ROLES[-1]


def why_not(role: Role, command: str) -> str:
    """Why `role` may not give `command`; empty if it may."""
    least = least_role(command)
    return "" if ROLES.index(role) >= ROLES.index(least) else f"needs the role {least}, and yours is {role}"


def refuse_role(name: str, role: Role | None, command: str) -> None:
    """Raise NotAllowed unless the user `name` with `role` (None: there is no such user now) may give `command`."""
    if role is None:
        raise NotAllowed(Problem(command, 0, 0, f"'{name}' is no user of this console now", "sign in again"))
    if why := why_not(role, command):
        raise NotAllowed(Problem(command, 0, 0, why, "ask somebody with that role"))

"""What each role may do: one table for commands and routes, enforced at the commands that pages and API share."""

from __future__ import annotations

import ast
import asyncio
from dataclasses import replace
from pathlib import Path
from typing import get_args

import pytest

from cellctl.console.access import COMMANDS, ROUTES, NotAllowed, least_role, why_not
from cellctl.console.api.answers import operations
from cellctl.console.server import api_app
from cellctl.console.sessions import operator_named
from cellctl.console.users import ROLES as KNOWN_ROLES
from cellctl.console.users import Role, read_users
from cellctl.engine import ActionName
from cellctl.operations.table_actions import Action
from tests.helpers.people import ROLES, Browser, People
from tests.helpers.runs import ROOT

MADE_UP = {
    "commands.py act_on: name": set(get_args(ActionName)),
    "commands.py change_presets: what": {"keep preset", "delete preset"},
    "commands.py recompute: what": {"replay", "report"},
    "commands.py _start: name": {"table look", *(f"table {action}" for action in get_args(Action))},
    "commands.py command_job: name": set(),  # passed on
    "queue_commands.py change_queue: f'queue {name}'": {"queue remove", "queue offer again", "queue unschedule"},
    "answers.py _operator: command": set(),  # of a route of the table
}
"""Names of commands that are no constant in their call → what they can be."""


@pytest.fixture(scope="module")
def people(tmp_path_factory: pytest.TempPathFactory) -> People:
    return People.at(tmp_path_factory.mktemp("roles"))


@pytest.fixture(scope="module")
def program(people: People) -> Browser:
    return people.browser()


def given_commands() -> set[str]:
    """The names of all commands in the code of the console."""
    found: set[str] = set()
    for file in (ROOT / "cellctl" / "console").rglob("*.py"):
        for function in ast.walk(ast.parse(file.read_text())):
            if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
                found |= _of(file, function)
    return found


def _of(file: Path, function: ast.FunctionDef | ast.AsyncFunctionDef) -> set[str]:
    found: set[str] = set()
    for call in ast.walk(function):
        if not isinstance(call, ast.Call) or len(call.args) < 3:
            continue
        if ast.unparse(call.func) not in ("console().command", "command_job"):
            continue
        name = call.args[1]
        if isinstance(name, ast.Constant):
            found.add(str(name.value))
        else:
            found |= MADE_UP[f"{file.name} {function.name}: {ast.unparse(name)}"]
    return found


def test_the_table_has_every_command_and_no_other() -> None:
    assert given_commands() | {"check"} == set(COMMANDS)


def test_the_table_has_every_route_of_the_api_that_commands_and_no_other(people: People) -> None:
    document = operations(api_app(people.console).openapi())
    assert {f"{method} {path}" for method, path in document if method != "GET"} == set(ROUTES)


def test_every_button_gives_a_command_of_the_table() -> None:
    named = {
        str(word.value.value)
        for file in (ROOT / "cellctl" / "console" / "pages").glob("*.py")
        for call in ast.walk(ast.parse(file.read_text()))
        if isinstance(call, ast.Call)
        for word in call.keywords
        if word.arg == "gives" and isinstance(word.value, ast.Constant)
    }
    assert named <= set(COMMANDS)
    assert {"pause", "abort", "start", "acknowledge", "fit", "note"} <= named


def test_each_role_may_do_what_those_before_it_may_and_every_role_may_stop() -> None:
    allowed = [{command for command in COMMANDS if not why_not(role, command)} for role in KNOWN_ROLES]
    assert allowed[0] == {"pause", "abort"}
    assert allowed[0] < allowed[1] < allowed[2] == set(COMMANDS)
    assert {"check", "start", "acknowledge", "confirm"} <= allowed[1]
    assert not {"table push", "table rollback", "upload", "fit", "schedule"} & allowed[1]
    assert least_role("a command of a package that is not in the table") == "engineer"


@pytest.mark.parametrize("name", ROLES)
def test_a_route_is_refused_to_roles_that_its_command_does_not_allow(
    people: People, program: Browser, name: str
) -> None:
    for route, command in ROUTES.items():
        method, path = route.split(" ")
        place = path.replace("{name}", "no-such").replace("{number}", "no-such")
        answer = program.send(method, place, headers={"Authorization": f"Bearer token of {name}"})
        if why := why_not(ROLES[name], command):
            assert (answer.status_code, answer.json()["what"]) == (403, why), route
            line = people.console.audit.read(1)[0]
            assert (line["operator"], line["command"], line["outcome"]) == (name, command, "failed"), route
        else:
            assert answer.status_code in (404, 409, 422), route


def test_a_push_is_refused_to_an_operator_by_the_route_that_verifies_too(program: Browser) -> None:
    body = {"action": "push", "cell": "sphere_cell", "table": "0" * 64, "confirmed": "00000000"}
    answer = program.send("POST", "/api/tables/act", json=body, headers={"Authorization": "Bearer token of Bo"})
    assert (answer.status_code, answer.json()["what"]) == (403, "needs the role engineer, and yours is operate")


@pytest.mark.parametrize(
    ("name", "command"), [("Cy", "start"), ("Bo", "table push"), ("Bo", "unknown"), ("Di", "abort")]
)
def test_a_command_is_refused_at_its_lowest_place_whoever_calls_it(people: People, name: str, command: str) -> None:
    done: list[str] = []

    async def work() -> None:
        done.append("done")

    with pytest.raises(NotAllowed):
        asyncio.run(people.console.command(operator_named(name), command, "x", work))
    assert done == []
    assert people.console.audit.read(1)[0]["outcome"] == "failed"


@pytest.mark.parametrize("role", ["view", "engineer"])
def test_another_role_counts_at_once(people: People, role: Role) -> None:
    assert people.file
    bo = read_users(people.file)["Bo"]
    people.change(replace(bo, role=role))
    assert people.console.sessions.why_not(operator_named("Bo"), "table push") == why_not(role, "table push")
    people.change(bo)


def test_without_users_nobody_is_refused(tmp_path: Path) -> None:
    people = People.at(tmp_path, users=False)

    async def work() -> str:
        return "done"

    assert asyncio.run(people.console.command(operator_named("Cy"), "table push", "x", work)) == "done"

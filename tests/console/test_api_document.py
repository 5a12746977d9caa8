"""The OpenAPI document says what each route does, takes and answers."""

from __future__ import annotations

from typing import Any

import pytest

from cellctl.console.api.answers import SUBJECTS, operations
from cellctl.console.server import api_app, new_console
from cellctl.console.shared import Settings


@pytest.fixture(scope="module")
def document(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return api_app(new_console(Settings(tmp_path_factory.mktemp("runs")))).openapi()


def test_every_route_has_a_summary_a_subject_and_an_id_of_its_own(document: dict[str, Any]) -> None:
    routes = operations(document)
    without = [
        place for place, route in routes.items() if not route.get("summary") or not set(route["tags"]) <= set(SUBJECTS)
    ]
    ids = [route["operationId"] for route in routes.values()]
    assert without == []
    assert len(set(ids)) == len(ids)


def test_every_parameter_of_a_route_is_described(document: dict[str, Any]) -> None:
    missing = [
        (*place, parameter["name"])
        for place, route in operations(document).items()
        for parameter in route.get("parameters", ())
        if not parameter.get("description")
    ]
    assert missing == []


def test_every_refusal_has_what_is_wrong_what_to_do_and_the_problems(document: dict[str, Any]) -> None:
    failure = {"$ref": "#/components/schemas/Refusal"}
    other = [
        (*place, status)
        for place, route in operations(document).items()
        for status, answer in route["responses"].items()
        if status.startswith("4") and answer["content"]["application/json"]["schema"] != failure
    ]
    assert other == []


def test_every_command_names_the_token_and_reading_needs_none(document: dict[str, Any]) -> None:
    wrong = [
        place for place, route in operations(document).items() if bool(route.get("security")) == (place[0] == "GET")
    ]
    assert wrong == []

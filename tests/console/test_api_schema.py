"""Schemathesis against the whole console: no request breaks it, answers are as the document describes them."""

from __future__ import annotations

import asyncio
import hashlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import httpx
import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from hypothesis.errors import Unsatisfiable
from schemathesis import Case, GenerationMode
from schemathesis.checks import not_a_server_error
from schemathesis.specs.openapi import checks

from cellctl.clock import WallClock
from cellctl.operations import analyses
from tests.helpers.console import ConsoleProcess, console_process
from tests.helpers.engine import WrittenRun

EXAMPLES = 3
"""Of each route, for content that the document allows and for content that it does not."""

CHECKS = [
    not_a_server_error,
    checks.status_code_conformance,
    checks.content_type_conformance,
    checks.response_headers_conformance,
    checks.response_schema_conformance,
]
"""Not whether content with the right types is taken: 422 is also the answer to a wrong meaning."""

KNOWN = {"/api/runs/": "run-1", "/api/cells/": "sphere_cell", "/api/procedures/": "sphere_selfcal"}
PROCESSES = ("/doctor", "/replay", "/report", "/export", "/fit", "/robot", "/programs", "/retry", "/check")
"""Ends of routes that start a process: with a known name these have one example."""


@dataclass
class Fuzzed:
    """A console over a folder with a run, a damaged run and an analysis."""

    console: ConsoleProcess
    analysis: str
    sent: dict[str, int] = field(default_factory=dict)

    def send(self, case: Case, known: bool, token: bool) -> Any:
        """The answer to `case`; known: for a run, cell or analysis that exists."""
        path = case.operation.path
        if known and self._first(path):
            names = {**KNOWN, "/api/analyses/": self.analysis}
            for prefix, name in names.items():
                if path.startswith(f"{prefix}{{name}}"):
                    case.path_parameters["name"] = name
        headers = {"Authorization": f"Bearer {self.console.token}"} if token else {}
        case.headers.pop("Authorization", None)
        if path == "/api/events":  # it has no end otherwise
            case.query["wait"] = False
        return case.call(base_url=self.console.url, headers=headers, timeout=60)

    def _first(self, path: str) -> bool:
        self.sent[path] = self.sent.get(path, 0) + 1
        return not path.endswith(PROCESSES) or self.sent[path] == 1

    def content(self) -> dict[str, str]:
        """The files of the runs folder with their hashes, the reading marks of journals and the index apart."""
        found = (file for file in self.console.runs.rglob("*") if file.is_file())
        files = (file for file in found if not file.name.endswith("-shm") and not file.name.startswith("index.sqlite"))
        return {str(file): hashlib.sha256(file.read_bytes()).hexdigest() for file in files}

    def log(self) -> str:
        """What the console wrote to stderr."""
        return (self.console.runs.parent / f"console-{self.console.url.rpartition(':')[2]}.log").read_text()


@pytest.fixture(scope="module")
def fuzzed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Fuzzed]:
    runs = tmp_path_factory.mktemp("fuzzed") / "runs"
    run = WrittenRun(runs / "run-1")
    run.journal.close()
    (runs / "damaged").mkdir()
    (runs / "damaged" / "journal.sqlite").write_bytes(b"SQLite format 3\0" + bytes(range(256)) * 20)
    folder, _ = analyses.new_analysis(runs, "Ada", "data.csv")
    (folder / "data.csv").write_text("A1,A2,A3,A4,A5,A6,X,Y,Z\n0,0,0,0,0,0,1,2,3\n")
    with console_process(runs) as console:
        _wait_for_the_alarm(console)
        yield Fuzzed(console, folder.name)
        _wait_for_jobs(console)


def _wait_for_the_alarm(console: ConsoleProcess) -> None:
    """Wait for what the console writes by itself at its start: the run has no process, and no end."""

    async def wait() -> None:
        async with httpx.AsyncClient(base_url=console.url) as client, asyncio.timeout(60):
            while not (await client.get("/api/alarms")).json():
                await WallClock().sleep(0.1)

    asyncio.run(wait())


def _wait_for_jobs(console: ConsoleProcess) -> None:
    """Wait for the end of all processes that requests started."""

    async def wait() -> None:
        number = 1
        async with httpx.AsyncClient(base_url=console.url) as client, asyncio.timeout(60):
            while (found := await client.get(f"/api/jobs/{number}")).status_code == 200:
                if found.json()["state"] in ("waiting", "running"):
                    await WallClock().sleep(0.1)
                else:
                    number += 1

    asyncio.run(wait())


def _answers(fuzzed: Fuzzed, token: bool) -> Iterator[tuple[Any, Any]]:
    """Each case of each route with its answer; routes that delete come last."""
    schema = schemathesis.openapi.from_url(f"{fuzzed.console.url}/api/openapi.json")
    operations = [found.ok() for found in schema.get_all_operations()]
    for operation in sorted(operations, key=lambda each: each.method.upper() == "DELETE"):
        for mode in (GenerationMode.POSITIVE, GenerationMode.NEGATIVE):
            examples = EXAMPLES if token or operation.method.upper() != "GET" else 1
            yield from _of_operation(fuzzed, operation, mode, token, examples)


def _of_operation(
    fuzzed: Fuzzed, operation: Any, mode: GenerationMode, token: bool, examples: int
) -> list[tuple[Any, Any]]:
    found: list[tuple[Any, Any]] = []

    @seed(1)
    @settings(
        max_examples=examples,
        database=None,
        deadline=None,
        suppress_health_check=list(HealthCheck),
        phases=[Phase.explicit, Phase.generate],
    )
    @given(case=operation.as_strategy(generation_mode=mode), known=st.booleans())
    def send(case: Case, known: bool) -> None:
        found.append((case, fuzzed.send(case, known, token)))

    with suppress(Unsatisfiable):  # a route without parameters has no content that the document does not allow
        send()
    return found


def _wrong(case: Case, answer: Any) -> str:
    """How the answer differs from the document; empty: it does not."""
    try:
        case.validate_response(answer, checks=CHECKS)
    except BaseExceptionGroup as error:
        return (
            f"{case.method} {case.operation.path} -> {answer.status_code}: {error.exceptions[0]}\n{answer.text[:500]}"
        )
    return ""


@pytest.mark.long
def test_no_request_with_the_token_breaks_the_console_and_answers_are_as_described(fuzzed: Fuzzed) -> None:
    wrong = [_wrong(case, answer) for case, answer in _answers(fuzzed, token=True)]
    assert not any(wrong), "\n\n".join(filter(None, wrong))
    assert "Traceback" not in (log := fuzzed.log()), log


@pytest.mark.long
def test_a_command_without_the_token_is_always_refused_and_changes_nothing_and_reading_is_as_described(
    fuzzed: Fuzzed,
) -> None:
    before, answers = fuzzed.content(), list(_answers(fuzzed, token=False))
    wrong = [_wrong(case, answer) for case, answer in answers if case.method.upper() == "GET"]
    assert not any(wrong), "\n\n".join(filter(None, wrong))
    assert {answer.status_code for case, answer in answers if case.method.upper() != "GET"} == {401}
    assert fuzzed.content() == before
    assert "Traceback" not in (log := fuzzed.log()), log

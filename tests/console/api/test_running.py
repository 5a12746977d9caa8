"""A running campaign over the API: everybody reads; who has the token pauses, continues, confirms and aborts."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from cellctl.clock import WallClock
from cellctl.engine import Operator
from cellctl.journal import OperatorAction, writer_of
from cellctl.operations.run_control import act
from cellctl.procedure import StepRegistry
from tests.helpers.console import ApiClient, api_client
from tests.helpers.engine import KINDS, PATIENCE_S, Running

ADA = {"Authorization": "Bearer secret", "X-Operator": "Ada"}


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Running]:
    found = Running(tmp_path / "test-1")
    yield found
    if writer_of(found.folder):
        asyncio.run(act(found.folder, "abort", Operator("Ada", "here", "test")))
    found.thread.join(PATIENCE_S)


@pytest.fixture
def client(running: Running, tmp_path: Path) -> Iterator[ApiClient]:
    with api_client(tmp_path, lambda: StepRegistry(KINDS)) as client:
        yield client


def status(client: ApiClient, ready: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    async def asked() -> dict[str, Any]:
        async with asyncio.timeout(PATIENCE_S):
            while True:
                found: dict[str, Any] = client.get("/api/runs/test-1/status").json()
                if ready(found):
                    return found
                await WallClock().sleep(0.02)

    return asyncio.run(asked())


def test_a_run_is_confirmed_paused_and_aborted_and_journal_and_audit_log_say_by_whom(
    client: ApiClient, running: Running
) -> None:
    found = status(client, lambda found: bool(found.get("confirm")))
    assert (found["step"], found["confirm"], found["done"], found["total"]) == ("clear", "Clear the cell", 1, 6)
    stale = client.post("/api/runs/test-1/confirm", json={"step": "mount"}, headers=ADA)
    assert (stale.status_code, "not of 'mount'" in stale.json()["what"]) == (409, True)
    assert client.post("/api/runs/test-1/confirm", json={"step": "clear"}, headers=ADA).json()["operator"] == "Ada"
    status(client, lambda found: found["step"] == "wait")
    assert client.post("/api/runs/test-1/resume", headers=ADA).json()["what"].endswith("the run is not paused")
    assert client.post("/api/runs/test-1/pause", json={"reason": "lunch"}, headers=ADA).status_code == 200
    assert client.post("/api/runs/test-1/abort", json={}, headers=ADA).status_code == 200
    assert status(client, lambda found: not found["active"])["state"] == "aborted"
    assert client.post("/api/runs/test-1/pause", json={}, headers=ADA).status_code == 409
    actions = [(action.action, action.operator, action.via, action.text) for action in running.events(OperatorAction)]
    assert actions[1] == ("confirm", "Ada", "console", "clear")
    assert [name for name, *_ in actions] == ["confirm", "confirm", "resume", "pause", "abort"]
    audit = client.get("/api/audit").json()
    assert [(line["command"], line["outcome"]) for line in reversed(audit)] == [
        ("confirm", "failed"),
        ("confirm", "done"),
        ("resume", "failed"),
        ("pause", "done"),
        ("abort", "done"),
        ("pause", "failed"),
    ]
    assert {line["operator"] for line in audit} == {"Ada"}


@pytest.mark.long
def test_everybody_reads_tree_and_log_and_filters_the_log(client: ApiClient, running: Running) -> None:
    status(client, lambda found: bool(found.get("confirm")))
    tree = client.get("/api/runs/test-1/tree").json()
    assert [child["path"] for child in tree["children"]] == ["some", "clear", "all", "wait"]
    assert [child["state"] for child in tree["children"]][:3] == ["done", "running", "waiting"]
    lines = client.get("/api/runs/test-1/log", params={"kind": "message", "text": "CLEAR"}).json()
    assert [line["text"] for line in lines] == ["Clear the cell"]
    assert len(client.get("/api/runs/test-1/log", params={"whole": True}).json()) > len(lines)


@pytest.mark.parametrize("command", ["pause", "resume", "abort", "confirm", "retry"])
@pytest.mark.parametrize("headers", [{}, {"Authorization": "Bearer wrong"}], ids=["no token", "wrong token"])
def test_without_the_token_nothing_is_done(command: str, headers: dict[str, str], tmp_path: Path) -> None:
    with api_client(tmp_path) as client:
        answer = client.post(f"/api/runs/test-1/{command}", json={"step": "clear"}, headers=headers)
    assert (answer.status_code, answer.json()["what"]) == (401, "this command needs the console's token")
    assert not (tmp_path / "audit.jsonl").exists()


@pytest.mark.parametrize("name", ["nothing", "..", "%2e%2e", "..%2fother", "audit.jsonl", "a" * 300, "%00", "ä" * 180])
def test_a_name_that_is_no_run_of_the_folder_is_not_found(name: str, tmp_path: Path) -> None:
    with api_client(tmp_path / "runs") as client:
        assert client.get(f"/api/runs/{name}/status").status_code == 404
        assert client.post(f"/api/runs/{name}/abort", json={}, headers=ADA).status_code == 404


def test_a_damaged_journal_is_shown_with_its_problem_and_takes_no_command(tmp_path: Path) -> None:
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "journal.sqlite").write_bytes(b"no journal at all" * 100)
    with api_client(tmp_path) as client:
        found = client.get("/api/runs/broken/status").json()
        refused = client.post("/api/runs/broken/abort", json={}, headers=ADA)
        retried = client.post("/api/runs/broken/retry", json={}, headers=ADA)
    assert found["state"] == "unreadable"
    assert "journal.sqlite" in found["problem"]
    assert (refused.status_code, retried.status_code) == (409, 409)


def test_a_damaged_journal_is_refused_with_its_file_and_the_cure(tmp_path: Path) -> None:
    journal = tmp_path / "damaged-1" / "journal.sqlite"
    journal.parent.mkdir()
    journal.write_text("no journal at all")
    with api_client(tmp_path) as client:
        answer = client.get("/api/runs/damaged-1/retry")
    (problem,) = answer.json()["problems"]
    assert (answer.status_code, problem["file"]) == (409, str(journal))
    assert problem["what"] == answer.json()["what"]
    assert problem["cure"] == answer.json()["cure"] != ""

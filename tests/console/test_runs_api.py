"""The API of runs: list, search, comparison, files by name alone, report, export, and who may start a process."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cellctl.console.commands import all_audited
from cellctl.console.pages.runs import seconds_of_day
from tests.helpers.arms import KR5_ERRORS, kr5_model
from tests.helpers.console import TOKEN, ApiClient, api_client
from tests.helpers.journals import run_in

COMMAND = {"Authorization": f"Bearer {TOKEN}", "X-Operator": "Kim"}


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    outside = tmp_path_factory.mktemp("console")
    folder = outside / "runs"
    folder.mkdir()
    (outside / "secret.txt").write_text("not for the browser")
    for month, a4 in ((9, 0.0), (10, 0.1), (11, 0.2)):
        place = run_in(folder, f"sphere-{month}", f"2026-{month:02d}-01", "925185")
        kr5_model(errors={**KR5_ERRORS, "a4": a4}).save(place / "model.json")
    (place / "report.html").write_text("<h1>Report</h1><script>alert(1)</script>")
    (place / "link.txt").symlink_to(outside / "secret.txt")
    (place / ".hidden").write_text("hidden")
    run_in(folder, "daily-1", "2026-11-20", "111111", "in control", "daily_check")
    (folder / "torn").mkdir()
    (folder / "torn" / "journal.sqlite").write_bytes(b"SQLite format 3\0 torn")
    return folder


@pytest.fixture(scope="module")
def client(runs: Path) -> Iterator[ApiClient]:
    with api_client(runs) as found:
        yield found


def ended(client: ApiClient, job: str) -> dict[str, Any]:
    """The job when it has ended."""
    client.done(all_audited())
    return client.get(f"/api/jobs/{job}").json()


def test_runs_are_listed_and_searched_without_a_token(client: ApiClient) -> None:
    listed = client.get("/api/runs").json()
    assert {run["run"] for run in listed} == {"sphere-9", "sphere-10", "sphere-11", "daily-1", "torn"}
    found = client.get("/api/runs", params={"text": "925185 kim", "since": "2026-10-01"}).json()
    assert [run["run"] for run in found] == ["sphere-11", "sphere-10"]
    assert found[0]["after"] == {"mean": 1.0, "rms": 1.1, "max": 2.0}


@pytest.mark.long
def test_an_unreadable_run_says_why(client: ApiClient) -> None:
    (torn,) = client.get("/api/runs", params={"state": "unreadable"}).json()
    assert torn["sentence"]
    assert client.get("/api/runs/torn/result").json()["state"] == "unreadable"
    assert client.get("/api/runs/torn/export", params={"form": "csv"}).status_code == 422
    assert client.get("/api/compare", params={"a": "torn", "b": "sphere-9"}).status_code == 409


def test_two_runs_are_compared_and_a_robots_drift_is_shown(client: ApiClient) -> None:
    found = client.get("/api/compare", params={"a": "sphere-9", "b": "sphere-11"}).json()
    assert found["models"]["parameters"][0]["name"] == "a4"
    drift = client.get("/api/drift", params={"serial": "925185", "parameter": "a4"}).json()
    assert [run["run"] for run in drift["runs"]] == ["sphere-9", "sphere-10", "sphere-11"]
    assert drift["parameters"][0]["slope"] == pytest.approx(0.1, rel=0.05)
    left_out = [{"run": "torn", "why": "its journal is damaged"}]
    assert client.get("/api/daily").json() == {"histories": [], "left_out": left_out, "total": 0}


def test_a_fleet_has_its_robots_with_reasons_and_their_charts(client: ApiClient) -> None:
    robots = {robot["serial"]: robot for robot in client.get("/api/fleet").json()["robots"]}
    assert [each["name"] for each in robots["925185"]["moved"]] == []
    assert robots["925185"]["calibration"] == "sphere-9"
    charts = client.get("/api/fleet/925185").json()
    assert charts["runs"] == ["sphere-9", "sphere-10", "sphere-11"]
    assert "a4" in {each["name"] for each in charts["parameters"]}
    assert client.get("/api/fleet", params={"type": "none"}).json()["robots"] == []
    assert client.get("/api/fleet/no such").status_code == 404


@pytest.mark.parametrize(
    "name",
    [
        "..",
        ".",
        "%2e%2e",
        "..%2f..",
        "..%2fsecret.txt",
        "nothing",
        "tables",
        "sphere-11%2f..",
        "%00",
        "%5c..%5c",
        "~",
        "a" * 300,
    ],
)
def test_nothing_outside_a_run_is_read_by_its_name(client: ApiClient, name: str) -> None:
    for path in ("files", "report", "result", "export", "files/secret.txt"):
        answer = client.get(f"/api/runs/{name}/{path}")
        assert answer.status_code in (404, 422), path
        assert "not for the browser" not in answer.text


@pytest.mark.parametrize(
    "file",
    [
        "../secret.txt",
        "..%2fsecret.txt",
        "%2e%2e%2f%2e%2e%2fsecret.txt",
        "link.txt",
        ".hidden",
        "journal.sqlite-wal",
    ],
)
def test_no_file_is_read_but_those_of_the_list(client: ApiClient, file: str) -> None:
    answer = client.get(f"/api/runs/sphere-11/files/{file}")
    assert "not for the browser" not in answer.text
    assert answer.status_code == 404


def test_files_are_for_saving_and_are_never_shown_as_pages(client: ApiClient) -> None:
    names = [file["name"] for file in client.get("/api/runs/sphere-11/files").json()]
    assert names == ["journal.sqlite", "model.json", "report.html"]
    answer = client.get("/api/runs/sphere-11/files/report.html")
    assert answer.headers["content-type"] == "application/octet-stream"
    assert answer.headers["content-disposition"] == 'attachment; filename="sphere-11-report.html"'


def test_a_report_is_served_without_rights_to_scripts_and_other_hosts(client: ApiClient) -> None:
    answer = client.get("/api/runs/sphere-11/report")
    assert answer.headers["content-type"].startswith("text/html")
    rules = answer.headers["content-security-policy"].split("; ")
    assert "default-src 'none'" in rules
    assert "sandbox" in rules
    assert not any(rule.startswith("script-src") for rule in rules)
    assert client.get("/api/runs/sphere-9/report").status_code == 404


@pytest.mark.long
def test_an_export_is_made_and_named_after_its_run(client: ApiClient) -> None:
    answer = client.get("/api/runs/sphere-11/export", params={"form": "jsonl"})
    assert answer.headers["content-disposition"] == 'attachment; filename="sphere-11-events.jsonl"'
    assert "run_started" in answer.text.splitlines()[0]
    assert client.get("/api/runs/sphere-11/export", params={"form": "exe"}).status_code == 422


@pytest.mark.long
def test_starting_a_process_needs_the_token_and_leaves_an_audit_line_with_its_outcome(
    client: ApiClient, runs: Path
) -> None:
    assert client.post("/api/runs/sphere-11/replay").status_code == 401
    assert client.post("/api/runs/nothing/replay", headers=COMMAND).status_code == 404
    started = client.post("/api/runs/sphere-11/replay", headers=COMMAND)
    assert started.status_code == 202
    job = ended(client, started.json()["job"])
    (line, *_) = client.get("/api/audit").json()
    assert (line["command"], line["target"], line["operator"]) == ("replay", "sphere-11", "Kim")
    assert line["outcome"] == job["state"]
    assert json.dumps(job)
    assert client.get("/api/jobs/999").status_code == 404


@pytest.mark.parametrize(
    ("day", "seconds"),
    [
        ("2026-11-28", ("2026-11-27T23:00:00", "2026-11-28T22:59:59")),
        ("2026-10-25", ("2026-10-24T22:00:00", "2026-10-25T22:59:59")),  # summer time ends: 25 hours
        ("2026", ("2026", "2026")),
    ],
)
def test_a_day_of_the_list_is_one_of_the_consoles_own_zone(
    day: str, seconds: tuple[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as zone:
        zone.setenv("TZ", "Europe/Berlin")
        time.tzset()
        found = seconds_of_day(day)
    time.tzset()
    assert found == seconds

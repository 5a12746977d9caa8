"""Analyses through the JSON API: upload, robot, fit, downloads, and files that are refused with a plain message."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import httpx
import pytest

from cellctl.console.commands import all_audited
from cellctl.console.server import api_app, guarded, new_console
from cellctl.console.shared import Settings
from cellctl.journal.journal_file import WriterLock
from cellctl.operations import analyses
from cellctl.operations.exporting import ExportOptions, exported, read_source
from cellctl.operations.results import as_json
from tests.helpers.arms import kr5_model, readings_near_the_middle, targets_csv

INPUTS = Path(__file__).parents[1] / "golden" / "inputs"
COMMANDS = {"authorization": "Bearer secret", "x-operator": "Ada"}
Work = Callable[[httpx.AsyncClient], Awaitable[Any]]


def run(runs: Path, work: Work) -> Any:
    """`work` with a client of a console over the folder `runs`."""

    async def go() -> Any:
        console = new_console(Settings(runs), "secret")
        transport = httpx.ASGITransport(guarded(api_app(console), console))
        async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1:8090", timeout=60) as client:
            try:
                return await work(client)
            finally:
                await console.jobs.close()

    return asyncio.run(go())


def upload(runs: Path, files: dict[str, Any], data: dict[str, str] | None = None) -> httpx.Response:
    """The answer to an upload."""
    return run(runs, lambda client: client.post("/api/analyses", files=files, data=data or {}, headers=COMMANDS))


def reversed_axis_2(robot: str) -> bytes:
    """A robot file whose A2 turns the other way."""
    return robot.replace("{min", "{sign: -1, min", 2).replace("{sign: -1, min", "{min", 1).encode()


@pytest.mark.long
def test_a_data_file_is_uploaded_understood_fitted_and_its_results_downloaded(tmp_path: Path) -> None:
    async def work(client: httpx.AsyncClient) -> dict[str, httpx.Response]:
        files = {
            "data": ("positions.csv", (INPUTS / "positions.csv").read_bytes()),
            "robot": ("robot.yaml", (INPUTS / "robot.yaml").read_bytes()),
        }
        found = (await client.post("/api/analyses", files=files, headers=COMMANDS)).json()
        place = f"/api/analyses/{found['name']}"
        assert dict(found["understood"]["facts"])["Set-up check"] == "no set-up error found"
        assert (await client.post(f"{place}/fit", json={"model": "geometry"}, headers=COMMANDS)).status_code == 202
        while (state := (await client.get(place)).json())["state"] in ("new", "running"):
            await asyncio.sleep(0.05)
        assert (state["state"], state["outcome"]["verdict"]) == ("done", "better")
        names = [*state["files"], "positions.csv"]
        answers = {name: await client.get(f"{place}/files/{name}") for name in names}
        return {**answers, "report": await client.get(f"{place}/report")}

    answers = run(tmp_path, work)
    assert {name: answer.status_code for name, answer in answers.items()} == dict.fromkeys(answers, 200)
    assert answers["positions.csv"].content == (INPUTS / "positions.csv").read_bytes()
    assert b"<robot" in answers["robot.urdf"].content
    assert answers["report"].headers["content-security-policy"].endswith("sandbox")
    audit = (tmp_path / "audit.jsonl").read_text()
    assert audit.count('"operator": "Ada"') == 2


@pytest.mark.long
def test_a_binary_is_refused_and_not_kept(tmp_path: Path) -> None:
    answer = upload(tmp_path, {"data": ("data.csv", bytes(range(256)) * 40)})
    problem = answer.json()["problems"][0]
    assert (answer.status_code, problem["file"], problem["what"]) == (422, "data.csv", "is not text")
    assert not list(tmp_path.glob("analyses/*"))


@pytest.mark.long
def test_a_data_set_that_fit_refuses_is_understood_with_the_line_and_cure_of_the_command_line(tmp_path: Path) -> None:
    wrong = reversed_axis_2((INPUTS / "robot.yaml").read_text())
    data = (INPUTS / "positions.csv").read_bytes()
    answer = upload(tmp_path, {"data": ("data.csv", data), "robot": ("arm.yaml", wrong)})
    assert answer.status_code == 201
    problem = answer.json()["understood"]["problems"][0]
    assert (problem["file"], problem["line"] > 0) == ("arm.yaml", True)
    assert "A2 reversed" in problem["what"]
    assert "sign" in problem["cure"]


@pytest.mark.long
def test_the_audit_log_has_the_outcome_of_a_fits_end(tmp_path: Path) -> None:
    async def work(client: httpx.AsyncClient) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
        files = {"data": ("data.csv", (INPUTS / "positions.csv").read_bytes())}
        files["robot"] = ("arm.yaml", reversed_axis_2((INPUTS / "robot.yaml").read_text()))
        name = (await client.post("/api/analyses", files=files, headers=COMMANDS)).json()["name"]
        await client.post(f"/api/analyses/{name}/fit", json={"model": "geometry"}, headers=COMMANDS)
        begun = (await client.get("/api/audit")).json()
        await all_audited()
        return begun, (await client.get("/api/audit")).json()

    begun, ended = run(tmp_path, work)
    assert [(line["command"], line["outcome"]) for line in begun] == [("fit", "cut off"), ("upload", "done")]
    assert (ended[0]["command"], ended[0]["outcome"]) == ("fit", "failed")
    assert "A2 reversed" in ended[0]["reason"]
    assert (tmp_path / "audit.jsonl").read_text().count("\n") == 4


def test_an_upload_of_100_megabytes_is_refused_before_it_is_read(tmp_path: Path) -> None:
    sent = 0

    async def work(client: httpx.AsyncClient) -> httpx.Response:
        async def body() -> Any:
            nonlocal sent
            for _ in range(100):
                sent += 1_000_000
                yield bytes(1_000_000)

        headers = {**COMMANDS, "content-type": "multipart/form-data; boundary=x", "content-length": "100000000"}
        return await client.post("/api/analyses", content=body(), headers=headers)

    answer = run(tmp_path, work)
    assert answer.status_code == 413
    assert "20 MB" in answer.json()["what"]
    assert not list(tmp_path.glob("analyses/*"))


@pytest.mark.parametrize(
    ("method", "path"),
    [
        ("POST", ""),
        ("POST", "/{name}/fit"),
        ("POST", "/{name}/robot"),
        ("POST", "/{name}/cancel"),
        ("POST", "/{name}/programs"),
        ("DELETE", "/{name}"),
    ],
)
def test_no_command_is_taken_without_the_token(tmp_path: Path, method: str, path: str) -> None:
    folder, _ = analyses.new_analysis(tmp_path, "Ada", "data.csv")
    files = {"data": ("data.csv", b"A1\n1\n"), "files": ("a.csv", b"A1\n1\n")}
    given = {"json": {}} if path.endswith("/fit") else {"files": files} if method == "POST" else {}
    url = "/api/analyses" + path.format(name=folder.name)
    answer = run(tmp_path, lambda client: client.request(method, url, **given))
    assert answer.status_code == 401
    assert [each.name for each in tmp_path.glob("analyses/*")] == [folder.name]


@pytest.mark.parametrize("file", ["analysis.json", "lock", "..%2f..%2faudit.jsonl", "%2e%2e/audit.jsonl", "none.json"])
def test_only_the_files_of_an_analysis_are_served(tmp_path: Path, file: str) -> None:
    folder, _ = analyses.new_analysis(tmp_path, "Ada", "data.csv")
    (tmp_path / "audit.jsonl").write_text("{}")
    answer = run(tmp_path, lambda client: client.get(f"/api/analyses/{folder.name}/files/{file}"))
    assert answer.status_code == 404


@pytest.mark.long
def test_targets_are_compensated_and_downloaded(tmp_path: Path) -> None:
    folder, _ = analyses.new_analysis(tmp_path, "Ada", "poses.csv")
    kr5_model().save(folder / analyses.MODEL)

    async def work(client: httpx.AsyncClient) -> tuple[httpx.Response, httpx.Response]:
        files = [("files", ("targets.csv", targets_csv(readings_near_the_middle(3)).encode()))]
        made = await client.post(f"/api/analyses/{folder.name}/programs", files=files, headers=COMMANDS)
        found = made.json()
        return made, await client.get(f"/api/analyses/{folder.name}/programs/{found['id']}/{found['files'][0]}")

    made, file = run(tmp_path, work)
    assert made.json()["predicted_after_mm"]["max"] < 0.01 < made.json()["predicted_before_mm"]["mean"]
    assert len(file.text.splitlines()) == 4


def test_two_files_of_one_name_are_refused(tmp_path: Path) -> None:
    folder, _ = analyses.new_analysis(tmp_path, "Ada", "poses.csv")
    files = [("files", ("a.csv", b"X\n")), ("files", ("a.csv", b"X\n"))]
    url = f"/api/analyses/{folder.name}/programs"
    answer = run(tmp_path, lambda client: client.post(url, files=files, headers=COMMANDS))
    assert (answer.status_code, answer.json()["problems"][0]["what"]) == (422, "is there more than once")


@pytest.mark.long
def test_a_urdf_is_taken_with_the_repeatability_that_it_lacks(tmp_path: Path) -> None:
    made = exported(read_source(INPUTS / "robot.yaml", None, None, None), "urdf", ExportOptions())
    urdf = ("arm.urdf", str(made.content).encode())

    async def work(client: httpx.AsyncClient) -> tuple[httpx.Response, httpx.Response]:
        files = {"data": ("data.csv", (INPUTS / "positions.csv").read_bytes())}
        library = {"library": "kr5_r1400"}
        name = (await client.post("/api/analyses", files=files, data=library, headers=COMMANDS)).json()["name"]
        place = f"/api/analyses/{name}/robot"
        refused = await client.post(place, files={"file": urdf}, headers=COMMANDS)
        stated = {"repeatability": "0.05"}
        return refused, await client.post(place, files={"file": urdf}, data=stated, headers=COMMANDS)

    refused, taken = run(tmp_path, work)
    assert (refused.status_code, refused.json()["problems"][0]["file"]) == (422, "arm.urdf")
    assert "repeatability" in refused.json()["what"]
    assert (taken.status_code, taken.json()["library"]) == (200, "")
    assert taken.json()["robot"].endswith("arm.yaml")
    assert dict(taken.json()["understood"]["facts"])["Set-up check"] == "no set-up error found"


@pytest.mark.long
def test_a_fit_in_progress_is_cancelled_and_the_analysis_says_so(tmp_path: Path) -> None:
    async def work(client: httpx.AsyncClient) -> dict[str, Any]:
        files = {"data": ("poses.csv", (INPUTS / "poses.csv").read_bytes())}
        name = (await client.post("/api/analyses", files=files, headers=COMMANDS)).json()["name"]
        place = f"/api/analyses/{name}"
        await client.post(f"{place}/fit", json={}, headers=COMMANDS)
        while ((await client.get(place)).json()["progress"] or {}).get("share", 0.0) < 0.1:
            await asyncio.sleep(0.05)
        assert (await client.post(f"{place}/fit", json={}, headers=COMMANDS)).status_code == 409
        await client.post(f"{place}/cancel", headers=COMMANDS)
        while (state := (await client.get(place)).json())["progress"]:
            await asyncio.sleep(0.05)
        return state

    assert run(tmp_path, work)["state"] == "cancelled"


def test_a_console_started_again_shows_a_fit_that_still_runs_and_its_end(tmp_path: Path) -> None:
    folder, _ = analyses.new_analysis(tmp_path, "Ada", "data.csv")
    of_another_process = WriterLock.take(folder / analyses.LOCK)

    async def work(client: httpx.AsyncClient) -> tuple[str, dict[str, Any]]:
        before = (await client.get(f"/api/analyses/{folder.name}")).json()
        assert before["progress"] is not None
        analyses.write_json(folder / analyses.OUTCOME, as_json(analyses.Outcome.of("better", "", ())))
        of_another_process.release()
        while (state := (await client.get(f"/api/analyses/{folder.name}")).json())["progress"]:
            await asyncio.sleep(0.05)
        return before["state"], state

    before, state = run(tmp_path, work)
    assert (before, state["state"], state["outcome"]["verdict"]) == ("running", "done", "better")

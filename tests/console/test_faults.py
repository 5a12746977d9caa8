"""The console in trouble: no run, a damaged journal, hostile names, contents that are no JSON."""

from __future__ import annotations

import asyncio
import re
import shutil
from collections.abc import Iterator
from urllib.parse import quote

import httpx
import pytest

from cellctl.clock import WallClock
from tests.helpers.console import ConsoleProcess, console_process
from tests.helpers.journals import run_in

HOSTILE = """<img src=x onerror="hacked=1">' "quoted" #?&%41;"""
"""The name of a run that a program or person put into the folder."""

PAGES = (
    "/overview",
    "/alarms",
    "/jobs",
    "/analyse",
    "/cell",
    "/start",
    "/run",
    "/runs",
    "/compare",
    "/daily",
    "/fleet",
    "/tables",
    "/api",
    "/start?procedure=no+such&cell=no+such",
    "/cell?name=no+such",
    "/compare?a=no+such&b=..",
    "/run/no+such",
    "/run/no+such/result",
    "/analyse/no+such",
)


def log_of(console: ConsoleProcess) -> str:
    """What the console wrote to stderr."""
    return (console.runs.parent / f"console-{console.url.rpartition(':')[2]}.log").read_text()


async def listed(client: httpx.Client, names: set[str]) -> None:
    """Wait until the console lists these runs: it looks at its folder every second."""
    async with asyncio.timeout(60):
        while not names <= {row["run"] for row in client.get("/api/runs").json()}:
            await WallClock().sleep(0.05)


@pytest.fixture(scope="module")
def console(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ConsoleProcess]:
    with console_process(tmp_path_factory.mktemp("faults") / "runs") as console:
        yield console


@pytest.fixture(scope="module")
def client(console: ConsoleProcess) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=console.url, timeout=60, follow_redirects=True) as client:
        yield client


@pytest.mark.parametrize("page", PAGES)
def test_every_page_opens_without_a_run_and_with_names_of_nothing(
    console: ConsoleProcess, client: httpx.Client, page: str
) -> None:
    answer = client.get(page)
    assert answer.status_code in (200, 404)
    assert "No button of this console is a safety stop" in answer.text
    assert "Traceback" not in log_of(console)


def test_a_damaged_journal_is_shown_as_that_and_hides_no_other_run(
    console: ConsoleProcess, client: httpx.Client
) -> None:
    run_in(console.runs, "good", "2026-05-01", "12")
    shutil.copytree(console.runs / "good", console.runs / "damaged")
    journal = console.runs / "damaged" / "journal.sqlite"
    content = bytearray(journal.read_bytes())
    content[4096:] = bytes(len(content) - 4096)
    journal.write_bytes(content)
    page = client.get("/run/damaged")
    assert page.status_code == 200
    status = client.get("/api/runs/damaged/status").json()
    assert "damaged" in status["problem"]
    asyncio.run(listed(client, {"good", "damaged"}))
    assert client.get("/api/runs/good/result").json()["verdict"] == "better"
    for each in ("/runs", "/run/good", "/run/damaged/result", "/compare?a=good&b=damaged", "/daily", "/tables"):
        assert client.get(each).status_code == 200
    assert "Traceback" not in log_of(console)


@pytest.mark.parametrize("name", ["a" * 300, "%00", "%ff", "..%2f..%2fetc", "%2e%2e", "a%0d%0ab", "%5c%5chost"])
@pytest.mark.parametrize(
    "place", ["/api/runs/{}/status", "/api/runs/{}/result", "/api/runs/{}/files/x", "/api/analyses/{}", "/api/cells/{}"]
)
def test_a_name_that_no_file_can_have_is_not_found(client: httpx.Client, place: str, name: str) -> None:
    answer = client.get(place.format(name))
    assert answer.status_code == 404
    assert set(answer.json()) == {"what", "cure", "problems"}


@pytest.mark.parametrize(
    "content",
    [b"[" * 100_000, b'{"reason": "\xff"}', b'{"reason": "\\ud800"}', b"", b"\x00", b'{"reason": NaN}'],
    ids=["deep", "not UTF-8", "half a character", "empty", "binary", "no number"],
)
def test_content_that_is_no_json_is_refused_with_the_reason(
    console: ConsoleProcess, client: httpx.Client, content: bytes
) -> None:
    run_in(console.runs, "for-content", "2026-05-02", "12") if not (console.runs / "for-content").exists() else None
    headers = {"Authorization": f"Bearer {console.token}", "Content-Type": "application/json"}
    answer = client.post("/api/runs/for-content/pause", content=content, headers=headers)
    assert answer.status_code == 422
    assert answer.json()["what"]
    assert "Traceback" not in log_of(console)


def test_a_form_that_is_cut_off_is_refused_with_the_reason(console: ConsoleProcess, client: httpx.Client) -> None:
    headers = {"Authorization": f"Bearer {console.token}", "Content-Type": "multipart/form-data; boundary=x"}
    answer = client.post(
        "/api/analyses", content=b'--x\r\nContent-Disposition: form-data; name="data"', headers=headers
    )
    assert answer.status_code == 422
    assert not list(console.runs.glob("analyses/*"))


@pytest.mark.long
@pytest.mark.parametrize(
    ("method", "path", "status"),
    [
        ("GET", "/api/nothing", 404),
        ("PUT", "/api/runs", 405),
        ("POST", "/api/console", 405),
        ("GET", "/api/runs/", 404),
    ],
)
def test_what_is_no_route_of_the_api_is_answered_as_json(
    console: ConsoleProcess, client: httpx.Client, method: str, path: str, status: int
) -> None:
    answer = client.request(method, path, headers={"Authorization": f"Bearer {console.token}"})
    assert (answer.status_code, bool(answer.json()["cure"])) == (status, True)


@pytest.mark.long
def test_a_download_of_a_run_with_a_strange_name_keeps_its_headers_apart(
    console: ConsoleProcess, client: httpx.Client
) -> None:
    name = 'a"; filename="x.exe\r\nset-cookie: a=b'
    run_in(console.runs, name, "2026-05-03", "12")
    (console.runs / name / "model.json").write_text("{}")
    answer = client.get(f"/api/runs/{quote(name, safe='')}/files/model.json")
    shutil.rmtree(console.runs / name)
    assert answer.status_code == 200
    assert "set-cookie" not in answer.headers
    assert re.fullmatch(r"attachment; filename\*=utf-8''[\w.%-]+", answer.headers["content-disposition"])

"""`cellctl console` as a process: its addresses, its token, its end; and what a browser loads from where."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import httpx
import nicegui
import pytest

from tests.helpers.console import ConsoleProcess, browser, console_process


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory):
    with console_process(tmp_path_factory.mktemp("console") / "runs") as console:
        yield console


def test_reading_needs_no_token(served: ConsoleProcess) -> None:
    answer = httpx.get(f"{served.url}/api/console")
    assert answer.json()["runs"] == str(served.runs)


def test_the_openapi_document_says_which_routes_need_the_token(served: ConsoleProcess) -> None:
    document = httpx.get(f"{served.url}/api/openapi.json").json()
    commands = {path for path, methods in document["paths"].items() for name in methods if name != "get"}
    free = [
        path
        for path in commands
        for name, route in document["paths"][path].items()
        if name != "get" and not route.get("security")
    ]
    assert free == []


@pytest.mark.long
def test_a_second_console_at_the_same_port_says_so(served: ConsoleProcess, tmp_path: Path) -> None:
    port = served.url.rpartition(":")[2]
    command = [sys.executable, "-P", "-m", "cellctl", "console", "--port", port, "--runs", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 2
    assert "is another console running?" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.long
def test_a_console_does_not_listen_at_all_addresses(tmp_path: Path) -> None:
    command = [sys.executable, "-P", "-m", "cellctl", "console", "--host", "0.0.0.0", "--runs", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 2
    assert "name one address" in done.stderr


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_and_sigterm_end_a_console_with_code_0(tmp_path: Path, number: signal.Signals) -> None:
    with console_process(tmp_path / "runs") as console:
        console.process.send_signal(number)
        assert console.process.wait(30) == 0


@pytest.mark.long
def test_a_browser_loads_nothing_from_another_host_and_shows_that_no_button_is_a_safety_stop(
    served: ConsoleProcess,
) -> None:
    with browser() as chromium:
        page = chromium.new_page()
        asked: list[str] = []
        problems: list[str] = []
        page.on("request", lambda request: asked.append(request.url))
        page.on("console", lambda message: problems.append(message.text) if message.type == "error" else None)
        page.goto(f"{served.url}/api")
        page.get_by_text("No button of this console is a safety stop").wait_for()
        page.get_by_role("button", name="Give commands").wait_for()
    own = (served.url, served.url.replace("http", "ws"), "data:", "blob:")
    assert asked
    assert [url for url in asked if not url.startswith(own)] == []
    assert problems == []


@pytest.mark.long
def test_a_browser_gives_commands_after_the_token_and_a_name(served: ConsoleProcess) -> None:
    with browser() as chromium:
        page = chromium.new_page()
        page.goto(f"{served.url}/api")
        page.get_by_role("button", name="Give commands").click()
        page.get_by_label("Your name (for the record)").fill("Ada")
        page.get_by_label("Token").fill("wrong")
        page.get_by_role("dialog").get_by_role("button", name="Give commands").click()
        page.get_by_text("This is not the token of this console.").wait_for()
        page.get_by_label("Token").fill(served.token)
        page.get_by_label("Token").press("Enter")
        page.get_by_label("Operator").get_by_text("Ada").wait_for()
        page.reload()
        page.get_by_label("Operator").get_by_text("Ada").wait_for()


@pytest.mark.long
def test_an_unknown_address_is_a_page_of_the_console_with_a_way_back(served: ConsoleProcess) -> None:
    with browser() as chromium:
        page = chromium.new_page()
        answer = page.goto(f"{served.url}/tabels/<b>")
        assert answer.status == 404
        page.get_by_text("This console has no page /tabels/<b>.").wait_for()
        page.get_by_role("link", name="First page").click()
        page.get_by_role("heading", name="Analyse a data file").wait_for()


@pytest.mark.long
def test_a_missing_file_of_a_page_is_a_plain_answer(served: ConsoleProcess) -> None:
    answer = httpx.get(f"{served.url}/_nicegui/{nicegui.__version__}/resources/none/none.js")
    assert (answer.status_code, answer.headers["content-type"]) == (404, "application/json")

"""A whole run from the pages: started, confirmed, paused, continued, seen to its end; two pages show the same."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from cellctl.journal import OperatorAction, fold, read_journal
from tests.helpers.console import browser, console_process
from tests.helpers.runs import confirmed_touches, only_run

PATIENCE_MS = 120_000


def give_token(page: Any, token: str, name: str) -> None:
    page.get_by_label("Your name (for the record)").fill(name)
    page.get_by_label("Token").fill(token)
    page.get_by_label("Token").press("Enter")


@pytest.mark.long
def test_a_run_is_started_confirmed_paused_and_continued_from_the_pages(tmp_path: Path) -> None:
    confirmed_touches(tmp_path)
    runs = tmp_path / "runs"
    with console_process(runs, folder=tmp_path) as console, browser() as chromium:
        page = chromium.new_page()
        page.set_default_timeout(PATIENCE_MS)
        page.goto(f"{console.url}/start?procedure=confirmed_touches")
        page.get_by_text("You will confirm").wait_for()
        start = page.get_by_role("button", name="Start the run")
        assert start.is_disabled()
        page.get_by_role("button", name="Check", exact=True).click()
        page.get_by_text("No errors. Cell 'sphere cell'").wait_for()
        start.click()
        give_token(page, console.token, "Ada")
        page.wait_for_url("**/run/confirmed_touches-*")
        name = page.url.rpartition("/")[2]

        second = chromium.new_page()  # reads only
        second.set_default_timeout(PATIENCE_MS)
        second.goto(f"{console.url}/run")
        assert second.url.endswith(name)
        second.goto(f"{console.url}/run/{name}?scene=false")
        for each in (page, second):
            each.get_by_role("alert").get_by_text("Is the cell clear?").wait_for()
        page.get_by_role("button", name="Confirm", exact=True).click()
        for each in (page, second):
            each.locator("[aria-current=step]").get_by_text("Touch", exact=False).first.wait_for()

        page.get_by_role("button", name="Pause", exact=True).click()
        for each in (page, second):
            each.get_by_text("Paused: by the operator", exact=True).wait_for()
        page.reload()
        page.get_by_text("Paused: by the operator", exact=True).wait_for()
        page.get_by_role("button", name="Continue", exact=True).click()
        for each in (page, second):
            each.get_by_text("Finished.", exact=True).wait_for()
        page.get_by_role("link", name="Result and report").wait_for()
        assert page.get_by_role("button", name="Pause", exact=True).is_disabled()

    state = fold(read_journal(only_run(runs)))
    assert state.started is not None
    assert (state.state, state.started.operator) == ("finished", "Ada")
    events = [entry.event for entry in read_journal(only_run(runs))]
    actions = [(e.action, e.operator, e.via, e.text) for e in events if isinstance(e, OperatorAction)]
    assert actions == [
        ("confirm", "Ada", "console", "clear"),
        ("pause", "Ada", "console", ""),
        ("resume", "Ada", "console", ""),
    ]

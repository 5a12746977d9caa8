"""A user in a browser: signs in by keyboard, sees what the role allows; the pages end with the session."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from cellctl.console.users import read_users, write_users
from tests.helpers.console import browser, console_process
from tests.helpers.engine import WrittenRun
from tests.helpers.people import PASSWORD, users_file

PATIENCE_MS = 120_000


@pytest.mark.long
def test_a_user_signs_in_by_keyboard_and_the_pages_end_with_the_role(tmp_path: Path) -> None:
    file, runs = users_file(tmp_path), tmp_path / "runs"
    run = WrittenRun(runs / "active")
    with console_process(runs, "--users", str(file)) as console, browser() as chromium:
        page = chromium.new_page()
        page.set_default_timeout(PATIENCE_MS)
        page.goto(f"{console.url}/run/active?scene=false")
        for text in ("Cy", PASSWORD):
            page.keyboard.press("Tab")
            page.keyboard.type(text)
        page.keyboard.press("Enter")
        page.wait_for_url("**/run/active?scene=false")
        page.get_by_label("Operator").get_by_text("Cy (view)").wait_for()
        assert page.get_by_role("button", name="Add the note for role operate").is_disabled()
        assert page.get_by_role("button", name="Abort …").is_enabled()
        write_users(file, [replace(read_users(file)["Cy"], role="engineer")])
        page.wait_for_url("**/login?to=%2Frun%2Factive%3Fscene%3Dfalse")
    run.end()

"""Pages in trouble: hostile names, ten pages with one that stopped, the keyboard alone, a tablet; a console killed."""

from __future__ import annotations

import asyncio
import os
import re
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

import httpx
import pytest

from cellctl.clock import WallClock
from cellctl.console.appearance import COLOURS, CSS, INKS
from cellctl.journal import Journal, OperatorAction, read_journal
from tests.helpers.console import ConsoleProcess, browser, console_process
from tests.helpers.engine import WrittenRun
from tests.helpers.journals import run_in, touch_run
from tests.helpers.runs import confirmed_touches

HOSTILE = """<img src=x onerror="window.hacked=1">' innerHTML="<b>" #?&%41;"""
PATIENCE_MS = 60_000
PAGES = (
    "/analyse",
    "/cell",
    "/start",
    "/run/run-1",
    "/run/run-1/result",
    "/runs",
    "/compare",
    "/daily",
    "/fleet",
    "/tables",
    "/api",
)
_UNREACHED = """() => [...document.querySelectorAll('button, a[href], summary, input')]
  .filter(each => each.checkVisibility({visibilityProperty: true}) && !each.disabled && each.tabIndex >= 0)
  .filter(each => !each.dataset.reached && each.type !== 'file')
  .map(each => each.outerHTML.slice(0, 120))"""

_SMALL = """() => [...document.querySelectorAll('button, a[href]')]
  .filter(each => each.checkVisibility({visibilityProperty: true}))
  .map(each => [each.innerText, each.getBoundingClientRect()])
  .filter(([, box]) => box.height < 43.5 || box.width < 43.5)
  .map(([text, box]) => `${text} ${box.width} ${box.height}`)"""
"""Buttons and links that are less than 44 px wide or high (WCAG 2.2, 2.5.5)."""

_UNNAMED = """() => [...document.querySelectorAll('th')]
  .filter(each => !each.textContent.trim() && !each.querySelector('[aria-label]')).map(each => each.outerHTML)"""

_REFUSED = """window.refused = [];
document.addEventListener('securitypolicyviolation', each => window.refused.push(each.effectiveDirective));"""
"""What the page's Content-Security-Policy refuses of its own content."""


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ConsoleProcess]:
    runs = tmp_path_factory.mktemp("trouble") / "runs"
    run_in(runs, "run-1", "2026-05-01", "12")
    hostile = WrittenRun(runs / HOSTILE.replace("/", ""))
    hostile.say(HOSTILE)
    hostile.add(OperatorAction("pause", HOSTILE, "here", "console", HOSTILE))
    hostile.journal.close()
    (hostile.folder / "report.html").write_text("<script>parent.hacked = 1</script>")
    with console_process(runs) as console:
        yield console


@pytest.mark.long
def test_a_run_with_10000_points_opens_with_and_without_the_scene(tmp_path: Path) -> None:
    with Journal.create(tmp_path / "runs" / "large", lambda: 0) as journal:
        for event in touch_run(10_000, 9_000).events:
            journal.append(event)
    with console_process(tmp_path / "runs") as console, browser() as chromium:
        page = chromium.new_page()
        page.set_default_timeout(PATIENCE_MS)
        page.goto(f"{console.url}/run/large?scene=false")
        page.get_by_role("heading", name="Log").wait_for()
        page.get_by_role("switch", name="3-D scene").click()
        page.get_by_text("of the fit, measured").wait_for()
        page.get_by_role("link", name="API").click()  # the page still answers
        page.get_by_role("heading", name="JSON API").wait_for()


@pytest.mark.long
def test_markup_in_names_of_runs_and_people_and_in_logs_is_shown_as_text(served: ConsoleProcess) -> None:
    name = quote(HOSTILE.replace("/", ""), safe="")
    with browser() as chromium:
        page = chromium.new_page()
        page.set_default_timeout(PATIENCE_MS)
        for place in (f"/run/{name}", f"/run/{name}/result", "/runs", f"/compare?a={name}&b=run-1", "/cell"):
            page.goto(served.url + place)
            page.get_by_text("No button of this console").wait_for()
            page.wait_for_timeout(300)
            assert page.evaluate("[window.hacked, document.querySelectorAll('img[src=x]').length]") == [None, 0]
        page.goto(f"{served.url}/run/{name}")
        page.get_by_role("heading", level=1).get_by_text("<img src=x", exact=False).wait_for()


@pytest.mark.long
def test_each_page_is_used_by_keyboard_alone_and_fits_a_tablet_and_no_state_is_a_colour_alone(
    served: ConsoleProcess,
) -> None:
    with browser() as chromium:
        page = chromium.new_page(viewport={"width": 1024, "height": 768})
        page.set_default_timeout(PATIENCE_MS)
        page.add_init_script(_REFUSED)
        served.open_for_commands(page)
        for place in PAGES:
            page.goto(served.url + place)
            page.get_by_text("No button of this console").wait_for()
            page.wait_for_timeout(500)
            assert page.locator("main").count() == 1, place
            assert page.evaluate(_UNNAMED) == [], place
            assert page.evaluate(_SMALL) == [], place
            assert page.evaluate("window.refused") == [], place
            assert page.evaluate("document.documentElement.scrollWidth") <= 1024, place
            assert page.evaluate("[...document.querySelectorAll('.state-word')].every(e => e.innerText.trim())"), place
            assert nameless(page) == [], place
            assert unreached(page) == [], place


def nameless(page: Any) -> list[str]:
    """Controls without an accessible name, as the browser tells them to a screen reader."""
    session = page.context.new_cdp_session(page)
    nodes = session.send("Accessibility.getFullAXTree")["nodes"]
    controls = [node for node in nodes if node.get("role", {}).get("value") in _CONTROLS and not node["ignored"]]
    return [str(node["role"]["value"]) for node in controls if not node.get("name", {}).get("value", "").strip()]


_CONTROLS = ("button", "link", "textbox", "checkbox", "combobox", "radio", "switch", "slider", "spinbutton", "tab")


def unreached(page: Any) -> list[str]:
    """Controls that Tab does not reach."""
    page.evaluate("document.activeElement.blur()")
    for _ in range(
        page.evaluate("document.querySelectorAll('button, a[href], summary, input, [tabindex]').length") + 10
    ):
        page.keyboard.press("Tab")
        page.evaluate("document.activeElement.dataset.reached = 1")
    found: list[str] = page.evaluate(_UNREACHED)
    return found


@pytest.mark.long
def test_ten_pages_show_the_same_while_one_of_them_has_stopped(tmp_path: Path) -> None:
    run = WrittenRun(tmp_path / "runs" / "run-1")
    with console_process(tmp_path / "runs") as console, browser() as chromium:
        pages = [chromium.new_page() for _ in range(10)]
        for page in pages:
            page.set_default_timeout(PATIENCE_MS)
            page.goto(f"{console.url}/run/run-1?scene=false")
        stopped = pages[0].context.new_cdp_session(pages[0])
        stopped.send("Debugger.enable")
        stopped.send("Debugger.pause")
        for number in range(300):
            run.say(f"event {number} of many")
        for page in pages[1:]:
            page.get_by_text("event 299 of many").first.wait_for()
    run.journal.close()


def test_words_and_states_are_readable_in_light_and_dark() -> None:
    def luminance(colour: str) -> float:
        parts = [int(colour[at : at + 2], 16) / 255 for at in (1, 3, 5)]
        linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    def contrast(one: str, other: str) -> float:
        low, high = sorted((luminance(one), luminance(other)))
        return (high + 0.05) / (low + 0.05)

    light, dark = (
        dict(
            re.findall(
                r"--([a-z-]+): (#[0-9a-f]{6})", CSS.replace("#fff;", "#ffffff;").partition(start)[2].partition("}")[0]
            )
        )
        for start in (":root {", "body.body--dark {")
    )
    inks = {found[1] for ink in INKS.values() if (found := re.fullmatch(r"var\(--([a-z]+)\)", ink))}
    assert len(inks) == 5
    for look in (light, dark):
        grounds = ("ground", "faint", "bad-ground", "wait-ground", "marked", "now")
        assert min(contrast(look[ink], look[on]) for ink in (*inks, "ink", "soft") for on in grounds) >= 4.5
        assert contrast(look["on-accent"], look["accent"]) >= 4.5
    assert {light[INKS[state][6:-1]] for state in COLOURS} == set(COLOURS.values())


@pytest.mark.long
def test_a_run_goes_on_while_its_console_is_killed_and_a_new_console_shows_and_confirms_it(tmp_path: Path) -> None:
    confirmed_touches(tmp_path)
    runs = tmp_path / "runs"
    with console_process(runs, folder=tmp_path) as first:
        order = {"procedure": "confirmed_touches"}
        headers = {"Authorization": f"Bearer {first.token}", "X-Operator": "Ada"}
        started = httpx.post(f"{first.url}/api/runs", json=order, headers=headers, timeout=120)
        assert started.status_code == 201, started.text
        name = started.json()["run"]
        status_when(first, name, lambda found: bool(found["confirm"]))
        os.kill(first.process.pid, signal.SIGKILL)
        first.process.wait(30)
    with console_process(runs, folder=tmp_path) as second:
        found = status_when(second, name, lambda found: bool(found["confirm"]))
        assert found["active"]
        headers = {"Authorization": f"Bearer {second.token}", "X-Operator": "Kim"}
        confirmed = httpx.post(
            f"{second.url}/api/runs/{name}/confirm", json={"step": found["step"]}, headers=headers, timeout=60
        )
        assert confirmed.status_code == 200
        assert status_when(second, name, lambda found: not found["active"])["state"] == "finished"
    people = [entry.event.operator for entry in read_journal(runs / name) if isinstance(entry.event, OperatorAction)]
    assert people == ["Kim"]


def status_when(
    console: ConsoleProcess, run: str, ready: Callable[[dict[str, Any]], bool], patience_s: float = 300.0
) -> dict[str, Any]:
    """The status of the run, once it is `ready`."""

    async def asked() -> dict[str, Any]:
        async with httpx.AsyncClient(base_url=console.url, timeout=60) as client, asyncio.timeout(patience_s):
            while not ready(found := (await client.get(f"/api/runs/{run}/status")).json()):
                await WallClock().sleep(0.1)
            return dict(found)

    return asyncio.run(asked())

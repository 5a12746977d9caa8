"""A person who has a keyboard alone, in a browser; and what axe-core finds wrong on the pages that they pass."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from axe_playwright_python.sync_playwright import Axe

_FURTHEST = 40
_HAS_FOCUS = "element => element.contains(document.activeElement)"


class Keyboard:
    """Uses `page` by keys alone: no pointer, no call of a script. furthest: the most presses of Tab on one way."""

    def __init__(self, page: Any) -> None:
        self._page, self._axe = page, Axe()
        self.furthest = 0

    def to(self, target: Any, *, back: bool = False) -> None:
        """Press Tab (back: with Shift) until `target` has the focus. AssertionError after 40 times."""
        target.wait_for()
        for pressed in range(1, _FURTHEST + 1):
            self._page.keyboard.press("Shift+Tab" if back else "Tab")
            if target.evaluate(_HAS_FOCUS):
                self.furthest = max(self.furthest, pressed)
                return
        raise AssertionError(f"{_FURTHEST} times Tab do not lead to {target}")

    def press(self, target: Any, key: str = "Enter") -> None:
        """Go to `target` and press a key."""
        self.to(target)
        self._page.keyboard.press(key)

    def write(self, target: Any, text: str) -> None:
        """Go to `target` and type in place of what it holds."""
        self.to(target)
        self._page.keyboard.press("Control+a")
        self._page.keyboard.type(text)

    def choose(self, target: Any, option: str, *, back: bool = False) -> None:
        """Go to the list `target`, open it, and take an option by the arrows."""
        self.to(target, back=back)
        self._page.keyboard.press("ArrowDown")
        wanted = self._page.get_by_role("option", name=option)
        wanted.wait_for()
        for _ in range(self._page.get_by_role("option").count()):
            if "q-manual-focusable--focused" in str(wanted.get_attribute("class")):
                break
            self._page.keyboard.press("ArrowDown")
        self._page.keyboard.press("Enter")
        wanted.wait_for(state="hidden")

    def to_content(self) -> None:
        """Pass by the navigation of a page that has just been opened."""
        self.press(self._page.get_by_role("link", name="To the content"))

    def opens(self, name: str | re.Pattern[str], until: str | Callable[[str], bool]) -> None:
        """Follow the link `name`; until: the address of its page, or what accepts it."""
        self.press(self._page.get_by_role("link", name=name, exact=True))
        self._page.wait_for_url(until)

    def sees_nothing_wrong(self) -> None:
        """Let axe-core look at the page as it is now. AssertionError with each rule that is broken, and where."""
        self._page.locator("[class*=-enter-active]").first.wait_for(state="detached")  # nothing fades in
        found = self._axe.run(self._page).response["violations"]
        places = {rule["id"]: [(node["html"], node["failureSummary"]) for node in rule["nodes"]] for rule in found}
        assert not places, f"{self._page.url}: {places}"

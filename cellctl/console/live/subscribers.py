"""Who is called when a run changes."""

from __future__ import annotations

import logging
from collections.abc import Callable, Set
from typing import final


@final
class Subscribers:
    """Callbacks, each for one run or for all. One that raises is not called again."""

    def __init__(self) -> None:
        self._found: dict[int, tuple[Callable[[], object], str]] = {}
        self._last = 0

    def add(self, callback: Callable[[], object], run: str = "") -> Callable[[], None]:
        """Call `callback` when `run` changes, or any run if it is empty; returns what ends that."""
        self._last += 1
        number = self._last
        self._found[number] = (callback, run)

        def end() -> None:
            self._found.pop(number, None)

        return end

    def wait_for(self, run: str) -> bool:
        """Whether a callback is for `run` alone."""
        return any(each == run for _, each in self._found.values())

    def call(self, runs: Set[str]) -> None:
        """Call once each that waits for one of `runs`."""
        for number, (callback, run) in list(self._found.items()):
            if runs and (not run or run in runs) and number in self._found:
                try:
                    callback()
                except Exception:  # a page that is gone must not stop the others
                    logging.getLogger(__name__).exception("a subscriber failed; it is not called again")
                    self._found.pop(number, None)

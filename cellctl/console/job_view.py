"""A job on a page: what it is doing, then its result or why it failed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, final

from nicegui import ui

from cellctl.console.jobs import Job
from cellctl.console.look import problem_list, state_word


@final
class JobView:
    """Shows one job after another in its place. show: draws the result of a job that is done."""

    def __init__(self, show: Callable[[Any], None]) -> None:
        self._show = show
        self._area = ui.element("div").classes("section").props("aria-live=polite")
        self._end: Callable[[], None] | None = None
        ui.context.client.on_delete(self._leave)

    def clear(self) -> None:
        """Show nothing."""
        self._leave()
        self._area.clear()

    def follow(self, job: Job, then: Callable[[], Any] = lambda: None) -> None:
        """Show `job` from now on; `then` is called when it has ended."""
        self.clear()
        with self._area:
            word = state_word("working", job.title)
            lines = ui.label().classes("note")

        def changed() -> None:
            if not job.ended_already:
                word.show("waiting" if job.state == "waiting" else "working", f"{job.title}: {job.doing or job.state}")
                lines.set_text(job.lines[-1] if job.lines else "")
                return
            self.clear()
            with self._area:
                self._outcome(job)
                then()

        self._end = job.subscribe(changed)
        if job.ended_already:
            changed()

    def _outcome(self, job: Job) -> None:
        if job.state == "done":
            self._show(job.result)
            return
        state_word("bad" if job.state == "failed" else "off", f"{job.title}: {job.state}")
        if job.failure:
            problem_list(job.failure.problems)

    def _leave(self) -> None:
        if self._end:
            self._end()
            self._end = None

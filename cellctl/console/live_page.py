"""What pages with live content share: follow the runs, and carry out commands with their refusals shown."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from typing import final

from nicegui import background_tasks, ui

from cellctl.console.frame import with_operator
from cellctl.console.look import problem_list
from cellctl.console.shared import console
from cellctl.devices import DeviceError
from cellctl.engine import Operator
from cellctl.files import InputError, Problem
from cellctl.journal import JournalError

_AT_MOST_EVERY_S = 0.05
"""Time between two updates of a page: a page shows the latest state, and leaves out states between."""


def on_change(show: Callable[[], object], run: str = "") -> None:
    """Call `show` in the context of this page after changes of `run`, or of any run, as long as the page is open."""
    on_event(show, lambda changed: console().live.subscribe(changed, run))


def on_event(show: Callable[[], object], subscribe: Callable[[Callable[[], None]], Callable[[], None]]) -> None:
    """Call `show`, a function or coroutine function, in the context of this page after each event, while it is open.

    subscribe: registers a callback for the event, and returns the function that ends that.
    """
    changed, client = asyncio.Event(), ui.context.client
    end = subscribe(changed.set)

    async def follow() -> None:
        while True:
            await changed.wait()
            changed.clear()
            try:
                with client:
                    waiting = show()
                    if isinstance(waiting, Awaitable):
                        await waiting
            except Exception:  # the page stays as it is; the next change is tried again
                logging.getLogger(__name__).exception("a page cannot show a change")
            await asyncio.sleep(_AT_MOST_EVERY_S)

    task = background_tasks.create(follow(), name="page follows runs")

    def leave() -> None:
        end()
        task.cancel()

    client.on_delete(leave)


@final
class Commands:
    """Carries out commands from a page. A refused one is shown at this place until the next command."""

    def __init__(self) -> None:
        self._place = ui.element("div").classes("refusals").props("aria-live=assertive")
        self._at_work = False

    async def give(self, work: Callable[[Operator], Awaitable[object]]) -> None:
        """Carry out `work`, once the browser has given the token; a second one at the same time is ignored."""

        async def done(operator: Operator) -> None:
            if self._at_work:
                return
            self._at_work = True
            self._place.clear()
            try:
                await work(operator)
            except (InputError, DeviceError, JournalError, OSError) as error:
                self.refuse(problems_of(error))
            finally:
                self._at_work = False

        await with_operator(done)

    def refuse(self, problems: tuple[Problem, ...]) -> None:
        """Show why a command was refused."""
        self._place.clear()
        with self._place:
            problem_list(problems)


def problems_of(error: Exception) -> tuple[Problem, ...]:
    """The problems of an error, for `problem_list`."""
    match error:
        case InputError():
            return tuple(error.problems)
        case DeviceError():
            return (Problem(error.device, 0, 0, error.what, error.cure),)
        case JournalError():
            return (Problem(str(error.path), 0, 0, error.what, error.cure),)
        case _:
            return (Problem("this computer", 0, 0, str(error)),)


def set_text(label: ui.label, text: str) -> None:
    """Change the text of a label; an unchanged one sends nothing."""
    if label.text != text:
        label.set_text(text)


def enable(button: ui.button, value: bool) -> None:
    """Enable or disable a button; an unchanged one sends nothing."""
    if button.enabled is not value:
        button.set_enabled(value)

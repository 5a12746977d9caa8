"""Commands that a page gives, with their refusals shown; and changes that send only what changed."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterable
from typing import final

from nicegui import ui

from cellctl.console.frame import with_operator
from cellctl.console.look import problem_list
from cellctl.devices import DeviceError
from cellctl.engine import Operator
from cellctl.files import InputError, Problem
from cellctl.journal import JournalError
from cellctl.operations.failure import Failure


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
                self.refuse(error)
            finally:
                self._at_work = False

        await with_operator(done)

    def refuse(self, error: Exception) -> None:
        """Show why a command was refused."""
        show_problems(self._place, Failure.of(error).problems)


def show_problems(place: ui.element, problems: Iterable[Problem]) -> None:
    """Show `problems` at `place`, in place of what was there, and scroll the page to them."""
    place.clear()
    with place:
        listed = problem_list(problems)
    scroll = f"getHtmlElement({listed.id})?.scrollIntoView({{block: 'center'}})"
    listed.client.run_javascript(f"setTimeout(() => {scroll}, 100)")  # once the browser has drawn them


async def answer_of(dialog: ui.dialog) -> bool:
    """Show a dialog until it is answered by `submit`; closing it means no. The dialog is removed afterwards."""
    answer = await dialog
    dialog.delete()
    return bool(answer)


def set_text(label: ui.label, text: str) -> None:
    """Change the text of a label; an unchanged one sends nothing."""
    if label.text != text:
        label.set_text(text)


def enable(button: ui.button, value: bool) -> None:
    """Enable or disable a button; an unchanged one sends nothing."""
    if button.enabled is not value:
        button.set_enabled(value)

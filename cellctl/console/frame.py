"""The frame of every page; how a page follows the runs, shows a job, and gives commands with their refusals."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, final

from nicegui import background_tasks, ui

from cellctl.console.appearance import (
    CSS,
    NOT_PERMITTED,
    command_button,
    escaped,
    head_script,
    head_style,
    problem_list,
    state_word,
)
from cellctl.console.attention import SCRIPT, AlarmCount, Attention, sound_switch
from cellctl.console.guarding import session_of
from cellctl.console.jobs import Job
from cellctl.console.sessions import Session
from cellctl.console.shared import console
from cellctl.devices import DeviceError
from cellctl.engine import Operator
from cellctl.files import InputError, Problem
from cellctl.installed import histories
from cellctl.journal import JournalError
from cellctl.operations.results import Failure

ALARMS = "/alarms"
NAVIGATION = (
    ("Overview", "/overview"),
    ("Analyse", "/analyse"),
    ("Cell", "/cell"),
    ("Start", "/start"),
    ("Jobs", "/jobs"),
    ("Run", "/run"),
    ("Runs", "/runs"),
    ("Alarms", ALARMS),
    *((each.title, f"/{each.name}") for each in histories()),
    ("Fleet", "/fleet"),
    ("Tables", "/tables"),
    ("API", "/api"),
)
NO_SAFETY = (
    "No button of this console is a safety stop. Use the emergency stop of the cell: it works without this computer."
)

_LOST = """addEventListener("DOMContentLoaded", () => {
  const popup = document.getElementById("popup");
  new MutationObserver(() => {
    for (const part of document.querySelectorAll("#app, .q-dialog, .q-menu")) part.inert = popup.ariaHidden === "false";
  }).observe(popup, { attributes: true });
  const look = localStorage.getItem("cellctl-look");
  if (look) setDark(look === "dark");
});"""
"""While the connection is lost nothing on the page can be pressed; the notice says so (`#popup` in console.css). The
look that a person chose stays; without a choice it is that of the system.
"""

_OTHER_LOOK = """() => {
  const dark = !Quasar.Dark.isActive;
  setDark(dark);
  localStorage.setItem("cellctl-look", dark ? "dark" : "light");
}"""


def session() -> Session:
    """The session of the browser that shows this page."""
    request = ui.context.client.request
    assert request is not None
    return session_of(request.scope)


def operator() -> Operator | None:
    """Who gives commands from this page; None until the token was given."""
    return session().operator


@contextmanager
def frame(title: str, here: str) -> Iterator[None]:
    """The frame of a page; its content goes inside. `here`: the page's entry of the navigation (`/runs`)."""
    head_style(CSS)
    head_script(_LOST + SCRIPT)
    around = ui.context.client.content.parent_slot
    assert around is not None
    around.parent.tag = "div"  # NiceGUI's is a second <main>
    shown: list[Callable[[], None]] = []
    ui.link("To the content", "#content").classes("skip")
    with ui.element("header").classes("top"):
        ui.link("cellctl", "/").classes("name").style("color: inherit; text-decoration: none")
        with ui.element("nav").props('aria-label="Pages"'):
            for name, target in NAVIGATION:
                link = ui.link(name, target)
                if target == here:
                    link.props("aria-current=page")
                if target == ALARMS:
                    shown.append(AlarmCount(link).show)
        with ui.element("div").classes("who"):
            sound_switch()
            _who()
            look = command_button("", lambda: None, icon="contrast").props('aria-label="Light or dark"')
            look.on("click", js_handler=_OTHER_LOOK)
    shown.append(Attention(f"{title} · cellctl").show)
    for show in shown:
        show()
    _close_with_session()
    follow_event(lambda: [show() for show in shown], console().watch.subscribe, "alarms and what waits for a person")
    with ui.element("main").classes("page").props("id=content tabindex=-1"):
        ui.html(tag="h1", content=escaped(title), sanitize=False)
        yield
    with ui.element("footer").classes("bottom"):
        ui.label(NO_SAFETY)


@ui.refreshable
def _who() -> None:
    found, user = operator(), session().user
    if found:
        ui.icon("person").props("aria-hidden=true")
        ui.label(f"{found.name} ({user.role})" if user else found.name).props('aria-label="Operator"')
        command_button("Sign out" if user else "Leave", _leave)
    else:
        ui.label("read only")
        command_button("Give commands", lambda: TokenDialog().open())


def _leave() -> None:
    here = session()
    if here.user is not None:
        console().sessions.end(here)
        return
    here.operator, here.with_token = None, False
    _who.refresh()


def _close_with_session() -> None:
    """Load this page again when its user is signed out: that leads to the form."""
    here, client = session(), ui.context.client
    if here.user is None:
        return

    def reload() -> None:
        client.run_javascript("location.reload()")

    here.at_end.add(reload)
    client.on_delete(lambda: here.at_end.discard(reload))


@final
class TokenDialog:
    """Asks for token and name; then calls `then`."""

    def __init__(self, then: Callable[[Operator], Awaitable[None] | None] | None = None) -> None:
        self._then = then
        with ui.dialog().props('aria-label="Give commands"') as self._dialog, ui.card():
            self._title = ui.label().classes("section-title")
            self._note = ui.label("The console printed it at its start, with its address.").classes("note")
            self._name = ui.input("Your name (for the record)").props("outlined dense autofocus").classes("wide")
            self._token = ui.input("Token", password=True).props("outlined dense").classes("wide")
            for field in (self._name, self._token):
                field.on("keydown.enter", self._given)
            with ui.element("div").classes("row"):
                command_button("Give commands", self._given, important=True)
                command_button("Cancel", self._dialog.close)

    def open(self) -> None:
        """Show the dialog; a browser that has given the token is asked for the name alone."""
        given = session().with_token
        self._title.set_text("Commands bear your name" if given else "Commands need the console's token")
        for part in (self._note, self._token):
            part.set_visibility(not given)
        self._dialog.open()

    async def _given(self) -> None:
        here, token = session(), (self._token.value or "").strip()
        right = here.with_token or console().sessions.allows(token)
        for field, error in (
            (self._token, not right and _WRONG_TOKEN),
            (self._name, not self._name.value and _NO_NAME),
        ):
            field.props(f"error error-message='{error}'") if error else field.props(remove="error error-message")
        if not console().sessions.open(here, token, self._name.value or ""):
            return
        self._dialog.close()
        _who.refresh()
        if self._then and here.operator:
            waiting = self._then(here.operator)
            if waiting is not None:
                await waiting


_WRONG_TOKEN = "This is not the token of this console."
_NO_NAME = "State a name: commands bear it."


async def with_operator(work: Callable[[Operator], Awaitable[None] | None]) -> None:
    """Call `work` with the operator; asks for token and name first if this browser has not given them."""
    known = operator()
    if known is None and console().sessions.users is not None:
        ui.navigate.reload()  # to the form: the user was signed out
        return
    if known is None:
        TokenDialog(work).open()
        return
    waiting = work(known)
    if waiting is not None:
        await waiting


def not_there(problems: Iterable[Problem]) -> None:
    """What the address of this page names is not there: the answer is 404."""
    ui.context.client.status_code = 404
    problem_list(problems)


Subscribe = Callable[[Callable[[], None]], Callable[[], None]]
"""Registers a callback for an event; returns the function that ends that."""


def follow(show: Callable[[], object], run: str = "") -> None:
    """Call `show` in this page now, and after each change of `run` (empty: of any run), until the page is closed.

    Changes that come while `show` works are shown together by its next call. Let it change only what changed.
    """
    follow_event(show, lambda changed: console().live.subscribe(changed, run), run or "all runs")


def follow_event(show: Callable[[], object], subscribe: Subscribe, name: str) -> None:
    """As `follow`, for the event that `subscribe` is for. `show`: a function or a coroutine function."""
    changed, client = asyncio.Event(), ui.context.client
    changed.set()

    async def shown() -> None:
        while True:
            await changed.wait()
            changed.clear()
            try:
                with client:
                    work = show()
                    if isinstance(work, Awaitable):
                        await work
            except Exception:  # shown again with the next change
                logging.getLogger(__name__).exception("a page cannot show the live state")

    unsubscribe = subscribe(changed.set)
    task = background_tasks.create(shown(), name=f"page follows {name}")

    def end() -> None:
        unsubscribe()
        task.cancel()

    client.on_delete(end)


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
    """Enable or disable a button; an unchanged one sends nothing, and one that the role forbids stays disabled."""
    if button.enabled is not value and NOT_PERMITTED not in button.classes:
        button.set_enabled(value)


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

"""The frame of every page: head with navigation and operator, notice of a lost connection, foot."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from typing import final

from nicegui import ui

from cellctl.console.guarding import session_of
from cellctl.console.look import command_button, escaped
from cellctl.console.sessions import Session
from cellctl.console.shared import console
from cellctl.engine import Operator

NAVIGATION = (
    ("Analyse", "/analyse"),
    ("Cell", "/cell"),
    ("Start", "/start"),
    ("Run", "/run"),
    ("Runs", "/runs"),
    ("Daily checks", "/daily"),
    ("Tables", "/tables"),
    ("API", "/api"),
)
NO_SAFETY = (
    "No button of this console is a safety stop. Use the emergency stop of the cell: it works without this computer."
)

_LOST = """<script>
addEventListener("DOMContentLoaded", () => {
  const popup = document.getElementById("popup");
  new MutationObserver(() => {
    for (const part of document.querySelectorAll("#app, .q-dialog, .q-menu")) part.inert = popup.ariaHidden === "false";
  }).observe(popup, { attributes: true });
});
</script>"""
"""While the connection is lost nothing on the page can be pressed; the notice says so (`#popup` in console.css)."""


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
    ui.page_title(f"{title} · cellctl")
    ui.add_head_html(_LOST)
    with ui.element("header").classes("top"):
        ui.link("cellctl", "/").classes("name").style("color: inherit; text-decoration: none")
        with ui.element("nav").props('aria-label="Pages"'):
            for name, target in NAVIGATION:
                link = ui.link(name, target)
                if target == here:
                    link.props("aria-current=page")
        with ui.element("div").classes("who"):
            _who()
    with ui.element("main").classes("page"):
        ui.html(tag="h1", content=escaped(title), sanitize=False)
        yield
    with ui.element("footer").classes("bottom"):
        ui.label(NO_SAFETY)


@ui.refreshable
def _who() -> None:
    found = operator()
    if found:
        ui.icon("person").props("aria-hidden=true")
        ui.label(found.name).props('aria-label="Operator"')
        command_button("Leave", _leave)
    else:
        ui.label("read only")
        command_button("Give commands", lambda: TokenDialog().open())


def _leave() -> None:
    session().operator = None
    _who.refresh()


@final
class TokenDialog:
    """Asks for token and name; then calls `then`."""

    def __init__(self, then: Callable[[Operator], Awaitable[None] | None] | None = None) -> None:
        self._then = then
        with ui.dialog() as self._dialog, ui.card():
            ui.label("Commands need the console's token").classes("section-title")
            ui.label("The console printed it at its start, with its address.").classes("note")
            self._name = ui.input("Your name (for the record)").props("outlined dense autofocus").classes("wide")
            self._token = ui.input("Token", password=True).props("outlined dense").classes("wide")
            self._token.on("keydown.enter", self._given)
            with ui.element("div").classes("row"):
                command_button("Give commands", self._given, important=True)
                command_button("Cancel", self._dialog.close)

    def open(self) -> None:
        """Show the dialog."""
        self._dialog.open()

    async def _given(self) -> None:
        here = session()
        if not console().sessions.open(here, self._token.value.strip(), self._name.value):
            self._token.props("error error-message='This is not the token of this console.'")
            return
        self._dialog.close()
        _who.refresh()
        if self._then and here.operator:
            waiting = self._then(here.operator)
            if waiting is not None:
                await waiting


async def with_operator(work: Callable[[Operator], Awaitable[None] | None]) -> None:
    """Call `work` with the operator; asks for the token first if this browser has not given it."""
    known = operator()
    if known is None:
        TokenDialog(work).open()
        return
    waiting = work(known)
    if waiting is not None:
        await waiting

"""How the console looks: colours, words for states, verdicts and times, and the parts that pages share."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Literal, TypeAlias, final

from nicegui import ui

from cellctl.clock import calendar_time
from cellctl.console.access import least_role
from cellctl.console.guarding import nonce_of, session_of
from cellctl.console.live import Snapshot
from cellctl.console.shared import console
from cellctl.files import Problem, grouped
from cellctl.operations.run_list import RunEnd, RunSummary

State = Literal["good", "working", "waiting", "warning", "bad", "off", "unknown"]

CSS = (Path(__file__).parent / "console.css").read_text(encoding="utf-8")
"""Style of all pages; its classes replace utility classes, which are not loaded."""

COLOURS: Mapping[State, str] = {
    "good": "#00775a",
    "working": "#0b5394",
    "waiting": "#8a5a00",
    "warning": "#8a5a00",
    "bad": "#b03a00",
    "off": "#5f6368",
    "unknown": "#5f6368",
}
"""Dark shades of the Okabe-Ito palette: contrast of 4.5 : 1 or more on white (WCAG 2.2, 1.4.3). For charts, whose
colours are inverted in dark mode."""

INKS: Mapping[State, str] = {
    "good": "var(--good)",
    "working": "var(--accent)",
    "waiting": "var(--wait)",
    "warning": "var(--wait)",
    "bad": "var(--bad)",
    "off": "var(--off)",
    "unknown": "var(--off)",
}
"""The same in CSS: light shades in dark mode, by `console.css`."""

ICONS: Mapping[State, str] = {
    "good": "check_circle",
    "working": "play_circle",
    "waiting": "pending",
    "warning": "warning",
    "bad": "error",
    "off": "radio_button_unchecked",
    "unknown": "help_outline",
}
"""The icon of each state."""


@final
@dataclass(frozen=True, slots=True)
class StateWord:
    """A word with icon and colour; `show` changes it."""

    icon: ui.icon
    label: ui.label

    def show(self, state: State, word: str) -> None:
        """Show `word` as `state`; an unchanged one sends nothing."""
        if self.label.text != word:
            self.label.set_text(word)
        if self.icon.name != ICONS[state]:
            self.icon.set_name(ICONS[state])
        style = {"color": INKS[state]}
        if dict(self.icon.style) != style:
            self.icon.style(replace=f"color: {INKS[state]}")
            self.label.style(replace=f"color: {INKS[state]}")


def state_word(state: State, word: str, *, large: bool = False) -> StateWord:
    """A state as icon, colour and word: never the colour alone."""
    with ui.element("span").classes("state-word large" if large else "state-word"):
        icon = ui.icon(ICONS[state]).props("aria-hidden=true").style(f"color: {INKS[state]}")
        label = ui.label(word).style(f"color: {INKS[state]}")
    return StateWord(icon, label)


def head_script(code: str) -> None:
    """Add a script to the head of the page."""
    ui.add_head_html(f'<script nonce="{_nonce()}">{code}</script>')


def head_style(css: str) -> None:
    """Add styles to the head of the page."""
    ui.add_head_html(f'<style nonce="{_nonce()}">{css}</style>')


def _nonce() -> str:
    try:
        return nonce_of(ui.context.client.request.scope)
    except RuntimeError:  # a client that no browser asked for
        return ""


def section(title: str, *, note: str = "") -> ui.element:
    """A part of a page with its heading; use as a context."""
    part = ui.element("section").classes("section")
    with part:
        ui.html(tag="h2", content="", sanitize=False).classes("section-title").set_content(escaped(title))
        if note:
            ui.label(note).classes("note")
    return part


def facts(rows: Mapping[str, str] | Iterable[tuple[str, str]]) -> dict[str, ui.label]:
    """Name and value in two columns; the labels of the values by name."""
    labels: dict[str, ui.label] = {}
    with ui.element("dl").classes("facts"):
        for name, value in rows.items() if isinstance(rows, Mapping) else rows:
            with ui.element("dt"):
                ui.label(name)
            with ui.element("dd"):
                labels[name] = ui.label(value)
    return labels


Cell: TypeAlias = str | Callable[[], object]
"""Content of a table's cell: its text, or what draws it."""


def words(*titles: str) -> list[tuple[str, str]]:
    """Columns of a table that hold text."""
    return [(title, "words") for title in titles]


def numbers(*titles: str) -> list[tuple[str, str]]:
    """Columns of a table that hold numbers."""
    return [(title, "") for title in titles]


def figures(
    columns: Sequence[tuple[str, str]],
    rows: Iterable[Sequence[Cell]],
    *,
    label: str,
    marked: Collection[int] = (),
) -> ui.element:
    """A table that scrolls in itself. columns: title and class (`words` for text, empty for numbers).

    marked: rows, from 0, with a coloured ground; a word in the row says the same.
    """
    scrolling = ui.element("div").classes("scrolling").props(f'tabindex=0 role=region aria-label="{label}"')
    with scrolling, ui.element("table").classes("figures"):
        with ui.element("thead"), ui.element("tr"):
            for title, kind in columns:
                with ui.element("th").classes(kind).props("scope=col"):
                    ui.label(title)
        with ui.element("tbody"):
            for number, row in enumerate(rows):
                with ui.element("tr").classes("differs" if number in marked else ""):
                    for cell, (_, kind) in zip(row, columns, strict=True):
                        with ui.element("td").classes(kind):
                            ui.label(cell) if isinstance(cell, str) else cell()
    return scrolling


def problem_list(problems: Iterable[Problem], line_of: Callable[[Problem], str] | None = None) -> ui.element:
    """Errors, each with place, text and cure. line_of: the line of the file at which a problem is, shown below it."""
    with ui.element("div").props("role=alert") as listed, ui.element("ul").classes("problems"):
        for problem in grouped(problems):
            place = f"{problem.file}:{problem.line}" if problem.line else problem.file
            with ui.element("li"):
                ui.label(place).classes("place")
                ui.label(in_page_words(problem.what)).classes("what")
                if line_of and (line := line_of(problem)):
                    ui.label(line.strip()).classes("line")
                if problem.cure:
                    ui.label(in_page_words(problem.cure)).classes("cure")
    return listed


NOT_PERMITTED = "not-permitted"
"""Class of a button whose command the role does not cover."""


def command_button(
    text: str,
    on_click: Callable[..., Any],
    *,
    icon: str = "",
    important: bool = False,
    dangerous: bool = False,
    gives: str = "",
) -> ui.button:
    """A button that gives the command `gives` (of `access.COMMANDS`; empty: none): whose role does not cover that sees
    it disabled, with the role that it needs. At most one important one in a view; a dangerous one asks before it acts.
    """
    button = ui.button(text, on_click=on_click, icon=icon or None, color=None).props("no-caps unelevated")
    button.classes("command" + " important" * important + " dangerous" * dangerous)
    if gives and (why := why_not(gives)):
        with button.classes(NOT_PERMITTED).props(f'title="This {why}."'):
            ui.label(f"for role {least_role(gives)}").classes("needs-role")
        button.set_enabled(False)
    return button


def why_not(command: str) -> str:
    """Why the user of this page may not give `command`; empty if there is no such reason."""
    try:
        operator = session_of(ui.context.client.request.scope).operator
    except RuntimeError:  # a client that no browser asked for
        return ""
    return console().sessions.why_not(operator, command)


def link_button(text: str, target: str, *, icon: str = "", download: bool = False) -> ui.link:
    """A link that looks like a button: it changes the page or downloads a file, and commands nothing."""
    with ui.link(target=target).classes("command linked") as link:
        if icon:
            ui.icon(icon).props("aria-hidden=true")
        ui.label(text)
    return link.props("download") if download else link


_AGAIN = re.compile(r"`cellctl run [^`]*--resume [^`]*`")
_COMMAND = re.compile(r"`cellctl ([a-z]+)[^`]*`")
_IN_PAGES = {
    **dict.fromkeys(("run", "check"), "the page Start"),
    **dict.fromkeys(("runs", "compare"), "the page Runs"),
    **dict.fromkeys(("show", "status", "events"), "the page of the run"),
    **dict.fromkeys(("report", "replay", "export"), "the result of the run"),
    **dict.fromkeys(("fit", "import", "analyse", "robots", "compensate"), "the page Analyse"),
    **dict.fromkeys(("doctor", "cell"), "the page Cell"),
    "table": "the page Tables",
    "continue": "the button Continue",
    "retry": "the button Retry",
    "confirm": "the button Confirm",
    "abort": "the button Abort",
}


def in_page_words(text: str) -> str:
    """A text with pages and buttons in place of commands: `` `cellctl table show` `` is the page Tables."""
    again = _AGAIN.sub("the button Retry", text)
    plain = _COMMAND.sub(lambda found: _IN_PAGES.get(found[1], found[0]), again)
    return plain.replace("say so with --acknowledge", "say so at the button Retry")


def escaped(text: str) -> str:
    """A text as HTML."""
    return text.replace("&", "&amp;").replace("<", "&lt;")


_STATES: dict[str, State] = {
    "finished": "good",
    "aborted": "off",
    "failed": "bad",
    "uncertain": "bad",
    "unreadable": "bad",
    "paused": "waiting",
}
_VERDICTS: dict[str, State] = {
    "better": "good",
    "in control": "good",
    "agree": "good",
    "not known": "warning",
    "disagree": "bad",
    "measured": "good",
    "accepted": "good",
    "rejected": "bad",
    "no decision": "warning",
    "baseline": "off",
    "no better": "warning",
    "not met": "warning",
    "measure again": "warning",
    "worse": "bad",
    "recalibrate": "bad",
}


def look_of_state(row: RunSummary) -> State:
    """How the state of a run looks."""
    return _STATES.get(row.state) or ("bad" if row.state.startswith("cut off") else "working")


def look_of_verdict(word: object, other: State = "unknown") -> State:
    """How a verdict looks; other: a word that is none."""
    return _VERDICTS.get(str(word), other)


def shown_time(utc: object, form: str = "%Y-%m-%d %H:%M %Z") -> str:
    """`2026-11-21 20:24 CET`: the local time of the console's computer, from UTC, ISO 8601; a dash without it."""
    try:
        return f"{datetime.fromisoformat(str(utc)).astimezone():{form}}" if utc else "–"
    except ValueError:  # what another program wrote
        return str(utc)


def local_zone() -> str:
    """The zone of the console's computer: `CET`."""
    return shown_time(calendar_time(), "%Z")


_ENDS: dict[str, State] = {"aborted": "warning"}
_NOW: dict[str, tuple[State, str]] = {
    "idle": ("working", "Beginning"),
    "checking": ("working", "Checking"),
    "connecting": ("working", "Connecting to the devices"),
    "running": ("working", "Running"),
    "paused": ("waiting", "Paused"),
    "cleaning": ("working", "Cleaning up"),
}


def sentence_of(now: Snapshot) -> tuple[State, str]:
    """State and sentence of a run: its verdict once there is one, else what it does or how it ended."""
    if now.problem and not now.events:
        return "bad", in_page_words(now.problem.what)
    if now.active:
        return _active(now)
    if end := RunEnd.of(now.folder, now.state, running=False):
        return _ENDS.get(end.state, "bad"), in_page_words(end.sentence)
    if now.sentence:
        return look_of_verdict(now.verdict, "good"), now.sentence
    return "good", "Finished."


def _active(now: Snapshot) -> tuple[State, str]:
    status = now.status
    state, word = _NOW.get(status.state, ("unknown", status.state))
    if status.state == "paused":
        return state, f"{word}: {status.held_by}" if status.held_by else f"{word}."
    if status.confirm:
        return "waiting", "Waits for a confirmation."
    if is_pausing(now):
        return "waiting", f"Pauses before the next step. Now: {status.phase or status.step}."
    if now.sentence:
        return look_of_verdict(now.verdict, "working"), f"{word}. So far: {now.sentence}"
    return state, f"{word}: {status.phase}." if status.phase else f"{word} …"


def is_pausing(now: Snapshot) -> bool:
    """Whether an operator has asked for a pause that has not begun: the step in progress ends first."""
    if not now.active or now.status.state != "running":
        return False
    for line in reversed(now.log):
        if line.kind == "state":
            return False
        if line.kind == "operator" and ", refused: " not in line.text and line.text.startswith(("pause", "resume")):
            return line.text.startswith("pause")
    return False


def progress_of(now: Snapshot) -> tuple[float, str]:
    """Share of the finished steps, from 0 to 1, and the progress in words."""
    status = now.status
    if not status.total:
        return 0.0, "The number of steps is not known yet." if now.active else ""
    share = min(1.0, status.done / status.total)
    left = f" · {about(status.left_s)} left" if status.left_s is not None and now.active else ""
    return share, f"{status.done} of {status.total} steps · {100 * status.done // status.total} %{left}"


def about(seconds: float) -> str:
    """A time that is estimated, no finer than it is known: `about 8 min`, `about 40 s`, `less than 10 s`."""
    if seconds < 10.0:
        return "less than 10 s"
    if seconds < 55.0:
        return f"about {round(seconds, -1):.0f} s"
    hours, minutes = divmod(round(seconds / 60.0), 60)
    return f"about {hours} h {minutes:02d} min" if hours else f"about {minutes} min"

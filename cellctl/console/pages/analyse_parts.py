"""Parts of the page of an analysis: verdict, figures, what was understood, options, downloads, programs, report."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from typing import Any, final

from nicegui import ui

from cellctl.console.look import Cell, facts, figures, link_button, numbers, problem_list, section, state_word, words
from cellctl.console.pages.analyse import STATES
from cellctl.files import Problem
from cellctl.operations.analyses import RESULTS, FitSettings
from cellctl.report.numbers import fixed
from cellctl.robots import library

MODELS = {
    "auto": "chosen by held-out rows (auto)",
    "geometry": "geometry: links, joint zeros, tool",
    "geometry+compliance": "geometry and flexible joints",
    "zeros": "joint zeros only",
    "registration": "base and tool only",
}
JUDGING = {
    "": "column set, else five parts",
    "0.2": "20 % of the rows, at random",
    "0.3": "30 % of the rows, at random",
    "0.5": "half of the rows, at random",
    "session": "each session in turn",
}
_LISTED = 200


def headline(state: dict[str, Any], *, busy: bool) -> None:
    """The verdict in one sentence, and the figures before and after."""
    outcome = state["outcome"] or {}
    verdict = outcome.get("verdict")
    if busy:
        state_word("working", "At work", large=True)
    elif verdict:
        first, _, rest = str(outcome["sentence"]).partition(". ")
        kind, word = STATES[verdict]
        state_word(kind, f"{word.capitalize()}. {first}.", large=True)
        with ui.element("div").classes("two"):
            if state["figures"]:
                _errors(state["figures"])
            ui.label(rest.replace("Better than nominal. ", "")).classes("note").style("max-width: 50rem")
    elif state["state"] == "new" and (state["understood"] or {}).get("problems"):
        state_word("bad", "The data and the robot file do not go together", large=True)
    elif state["state"] == "new" and (state["understood"] or {}).get("doubt"):
        state_word("warning", "Read, but hardly of this robot", large=True)
    elif state["state"] == "new" and state["robot"]:
        state_word("good", "Read and understood: ready to fit", large=True)
    elif state["state"] == "new":
        state_word("waiting", "Read: choose the robot", large=True)
    else:
        kind, word = STATES[state["state"]]
        state_word(kind, word.capitalize(), large=True)


def _errors(found: dict[str, Any]) -> None:
    """Mean, RMS and maximum, held-out rows before and after."""
    tested = f"{found['n_test']} held-out rows"
    shown = {
        f"{tested}, nominal": found["nominal"],
        f"{tested}, identified": found["test"],
        f"{found['n_fit']} rows of the fit, identified": found["fit"],
    }
    columns = [*words("Distance from the measured place"), *numbers("mean, mm", "RMS, mm", "max, mm")]
    rows = [[name, *(fixed(values[key]) for key in ("mean", "rms", "max"))] for name, values in shown.items()]
    figures(columns, rows, label="Errors")


def understood(state: dict[str, Any]) -> None:
    """What the data were understood as; problems, rejected rows, decisions of an import."""
    found = state["understood"]
    with section("What was understood"):
        if found is None:
            ui.label("Not read yet.").classes("note")
            return
        facts([(name, value) for name, value in found["facts"]])
        if found.get("doubt"):
            state_word("warning", found["doubt"]).label.style("white-space: normal")
        if found["problems"]:
            problem_list(Problem(**each) for each in found["problems"])
            if found["note"]:
                ui.label(found["note"]).classes("note")
        _listed("How the files were read", found["decided"])
        rejected = [f"{row.get('file', found['file'])}:{row['line']}: {row['reason']}" for row in found["rejected"]]
        _listed(f"Rows that cannot be used: {len(rejected)}", rejected)


def _listed(title: str, lines: Sequence[str]) -> None:
    if not lines:
        return
    with (
        ui.expansion(title).props("dense").classes("unfolding").style("width: 100%"),
        ui.element("ul").classes("short-list mono"),
    ):
        for line in lines[:_LISTED]:
            with ui.element("li"):
                ui.label(line)
        if len(lines) > _LISTED:
            with ui.element("li"):
                ui.label(f"… and {len(lines) - _LISTED} more")


def robot_choice(state: dict[str, Any], choose: Callable[[str], Awaitable[None]], *, enabled: bool) -> None:
    """The robot of the library with search, and the suggestion."""
    found = (state["understood"] or {}).get("suggestions")
    titles = {each["name"]: f"{each['robot']} ({each['name']})" for each in (found or {}).get("robots", ())}
    options = {**{name: titles[name] for name in titles}, **{name: titles.get(name, name) for name in library()}}
    label = "Robot of the library (type to search)"
    if state["robot"] and not state["library"]:
        ui.label(f"Own robot file: {state['robot']}")
        label = f"{label} in its place"

    async def chosen(event: Any) -> None:
        if event.value and event.value != state["library"]:
            await choose(event.value)

    field = ui.select(options, label=label, with_input=True, value=state["library"] or None, on_change=chosen)
    field.props("outlined dense").style("max-width: 28rem").set_enabled(enabled)
    if found:
        ui.label(found["sentence"]).classes("note")


@final
class Options:
    """The options of a fit, hidden until they are wanted."""

    def __init__(self, given: FitSettings) -> None:
        how = given.by or (f"{given.holdout:g}" if given.holdout else "")
        with (
            ui.expansion("Options").props("dense").classes("unfolding").style("width: 100%"),
            ui.element("div").classes("answers"),
        ):
            self._model = ui.select(_with(MODELS, given.model), value=given.model, label="Model").props(
                "outlined dense"
            )
            judged = "Rows held out for the verdict"
            self._how = ui.select(_with(JUDGING, how), value=how, label=judged).props("outlined dense")
            self._seed = ui.number("Seed of the random choice", value=given.seed, min=0, precision=0)
            self._seed.props("outlined dense")
            self._check = ui.checkbox("Check for set-up errors first", value=given.check)

    def settings(self) -> FitSettings:
        """The options as chosen."""
        how = str(self._how.value or "")
        share = float(how) if how.replace(".", "", 1).isdigit() else None
        return FitSettings(
            model=str(self._model.value),
            holdout=share,
            by=how if how and share is None else None,
            seed=int(self._seed.value or 0),
            check=bool(self._check.value),
        )


@final
class ProgramOptions:
    """What a program may leave open."""

    def __init__(self) -> None:
        with (
            ui.expansion("Options").props("dense").classes("unfolding").style("width: 100%"),
            ui.element("div").classes("answers"),
        ):
            self._tool = ui.input("Tool X,Y,Z,A,B,C (without $config.dat)").props("outlined dense")
            self._base = ui.input("Base X,Y,Z,A,B,C (without $config.dat)").props("outlined dense")
            self._arm = ui.checkbox("Another tool: correct the arm only")
            self._insert = ui.checkbox("Add points on LIN and CIRC that leave 0.05 mm")

    def request(self) -> dict[str, Any]:
        """The options as chosen."""
        texts = {"tool": self._tool.value.strip(), "base": self._base.value.strip()}
        return {**texts, "arm_only": bool(self._arm.value), "insert": bool(self._insert.value)}


def downloads(state: dict[str, Any]) -> None:
    """Links to the results, and what a URDF cannot hold."""
    with ui.element("div").classes("row"):
        for file in state["files"]:
            link_button(f"Download {RESULTS[file]}", _file(state, file), icon="download", download=True)
        link_button("Download data set", _file(state, state["dataset"]), icon="download", download=True)
    for note in (state["outcome"] or {}).get("notes", ()):
        ui.label(note).classes("note")


def programs(state: dict[str, Any], field: Callable[[], None]) -> None:
    """A field for a program, and the programs compensated so far."""
    with section("Compensate a program"):
        ui.label(
            "A KRL program (.src, with its .dat and $config.dat), or targets as CSV (X, Y, Z, A, B, C in the frame of "
            "the measurements) or of a RAPID, FANUC or UR program. Only for points made off-line: points taught by "
            "hand with this robot contain its error already."
        ).classes("note").style("max-width: 60rem")
        field()
        if state["programs"]:
            columns = [*words("Program"), *numbers("points", "left as they were", "predicted before, mean, mm")]
            columns += [*numbers("after, mean, mm", "after, max, mm"), *words("Download")]
            figures(columns, [_program(state, each) for each in reversed(state["programs"])], label="Programs")
            left = [
                f"{one['file']}:{one['line']}: {one['name']}: {one['reason']}"
                for each in state["programs"]
                for one in each["left"]
            ]
            _listed(f"Points left as they were: {len(left)}", left)


def _program(state: dict[str, Any], each: dict[str, Any]) -> list[Cell]:
    def files() -> None:
        with ui.element("div").classes("row"):
            for file in each["files"]:
                place = f"/api/analyses/{state['name']}/programs/{each['id']}/{file}"
                link_button(file, place, icon="download", download=True)

    before, after = (each.get(f"{key}_mm") or each[f"predicted_{key}_mm"] for key in ("before", "after"))
    counts = (str(each["compensated"]), str(len(each["left"])))
    return [each["name"], *counts, *map(fixed, (before["mean"], after["mean"], after["max"])), files]


def report(state: dict[str, Any]) -> None:
    """The report of the fit in a frame."""
    place = f"/api/analyses/{state['name']}/report"
    with section("Report"):
        ui.link("Open it alone, to print it", place, new_tab=True)
        ui.element("iframe").props(f'src="{place}" title="Report of the fit"').classes("report-frame")


def _file(state: dict[str, Any], file: str) -> str:
    return f"/api/analyses/{state['name']}/files/{file}"


def _with(options: dict[str, str], value: str) -> dict[str, str]:
    """The options, and the value that was chosen elsewhere."""
    return options if value in options else {**options, value: value}

"""`/run/NAME/result`: what a run came to, its report, files, export and replay."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any, final
from urllib.parse import quote

from nicegui import ui

from cellctl.console.appearance import (
    Cell,
    command_button,
    facts,
    figures,
    in_page_words,
    link_button,
    look_of_state,
    look_of_verdict,
    numbers,
    section,
    shown_time,
    state_word,
    words,
)
from cellctl.console.commands import recompute
from cellctl.console.frame import JobView, frame, not_there, with_operator
from cellctl.console.pages.run_parts import RunNotes
from cellctl.console.shared import console
from cellctl.engine import Operator
from cellctl.files import InputError
from cellctl.operations.export import Form
from cellctl.operations.replay import Agreement, ArtefactReplay, Replay
from cellctl.operations.results import from_json
from cellctl.operations.run_folder import RunFile, run_files, run_named
from cellctl.operations.run_list import RunSummary, run_row
from cellctl.report.figures import acceptance_words, fixed

_REPORT = "report.html"
_FORMS = {
    Form.ZIP: "everything, as one zip",
    Form.CSV: "samples as CSV",
    Form.PARQUET: "samples as Parquet",
    Form.JSONL: "events as JSON lines",
    Form.BLUESKY: "bluesky event-model documents",
    Form.FIGURES: "pictures of the report as SVG and PNG",
    Form.DCC: "Digital Calibration Certificate (DCC)",
}


@ui.page("/run/{name}/result")
async def result(name: str) -> None:
    """What a run came to."""
    with frame(f"Result of {name}", "/runs"):
        try:
            place = run_named(console().runs, name)
        except InputError as error:
            not_there(error.problems)
            return
        row, files = await asyncio.to_thread(lambda: (run_row(place), run_files(place)))
        _verdict(row)
        with ui.element("div").classes("columns"):
            _facts(row)
            _errors(row)
        RunNotes(place)
        _Files(place, files)
        _Replay(place)
        _Report(place, any(file.name == _REPORT for file in files))


def _verdict(row: RunSummary) -> None:
    with ui.element("div").classes("row"):
        state_word(look_of_state(row), row.state, large=True)
        if row.verdict:
            state_word(look_of_verdict(row.verdict), row.verdict, large=True)
        if row.accepted:
            state_word(look_of_verdict(row.accepted), row.accepted, large=True)
    with ui.element("div"):
        ui.label(in_page_words(row.sentence or row.reason or "This run has no verdict."))
        if row.acceptance:
            ui.label(f"Acceptance by ISO 14253-1: {acceptance_words(row.acceptance)}")
        for line in row.lines:
            ui.label(line).classes("note")


def _facts(row: RunSummary) -> None:
    devices = {name: f"{each.get('model', '')}, serial {each.get('serial', '')}" for name, each in row.devices.items()}
    known = {
        "Began": shown_time(row.began),
        "Procedure": row.procedure_name or "–",
        "Cell": Path(row.cell or "–").stem,
        "Operator": row.operator or "–",
        **devices,
        "Points": "–" if row.points is None else str(row.points),
        "Time of the cell": f"{row.cell_s / 60.0:.1f} min" if row.cell_s else "–",
        "Table": in_page_words(row.table_words or "none was pushed"),
    }
    with section("Run"):
        facts(known)
        with ui.element("div").classes("row"):
            link_button("Steps and log", f"/run/{quote(row.run)}", icon="list")
            link_button("Compare with another run", f"/compare?a={quote(row.run)}", icon="compare_arrows")


def _errors(row: RunSummary) -> None:
    rows = [
        [name, *(fixed(getattr(found, key, None)) for key in ("mean", "rms", "max"))]
        for name, found in (("before", row.before), ("after", row.after))
    ]
    with section("Measured held-out errors", note="After: with the table in force on the controller."):
        figures([*words("When"), *numbers("mean, mm", "RMS, mm", "max, mm")], rows, label="Errors")


@final
class _Files:
    """Files of the folder, and exports."""

    def __init__(self, place: Path, files: list[RunFile]) -> None:
        self._place = f"/api/runs/{quote(place.name)}"
        with section("Files and export"), ui.element("div").classes("columns"):
            columns = [*words("File", "Content"), *numbers("Size")]
            figures(columns, [(self._link_to(file), file.what, _size(file.size)) for file in files], label="Files")
            with ui.element("div").classes("row").style("align-content: flex-start"):
                options = {form.value: words for form, words in _FORMS.items()}
                chosen = ui.select(options, label="Export", value=Form.ZIP.value, on_change=self._choose)
                chosen.props("outlined dense").style("min-width: 17rem")
                self._link = link_button("Download", "", icon="download", download=True)
        self._set(Form.ZIP.value)

    def _choose(self, event: Any) -> None:
        self._set(event.value)

    def _set(self, form: str) -> None:
        self._link.props["href"] = f"{self._place}/export?form={form}"

    def _link_to(self, file: RunFile) -> Cell:
        return lambda: ui.link(file.name, f"{self._place}/files/{quote(file.name)}").props("download")


@final
class _Replay:
    """Replay of the run, with its progress and outcome."""

    def __init__(self, place: Path) -> None:
        self._place = place
        note = "Computes data set, model and table again from the journal alone, and compares them with the record."
        with section("Replay", note=note):
            with ui.element("div").classes("row"):
                self._button = command_button(
                    "Replay", lambda: with_operator(self._start), icon="replay", gives="replay"
                )
            self._view = JobView(self._show)

    async def _start(self, operator: Operator) -> None:
        job = await recompute(operator, "replay", self._place)
        self._button.disable()
        self._view.follow(job, self._button.enable)

    @staticmethod
    def _show(result: object) -> None:
        found = from_json(Replay, result)
        state_word("bad" if found.agreement is Agreement.DIFFERENT else "good", found.agreement, large=True)
        for text in found.changed:
            ui.label(f"Changed since the run: {text}").classes("note")
        for text in found.edited:
            ui.label(f"The journal was changed after the run: {text}").classes("note")
        rows = [_artefact(each) for each in found.artefacts]
        rows += [[each.step, each.agreement, "; ".join((*each.differences[:3], *each.why))] for each in found.steps]
        figures(words("File or step", "Outcome", "Difference and reason"), rows, label="Replay")


def _artefact(each: ArtefactReplay) -> list[str]:
    where = f"first at byte {each.first.byte}" if each.first else ""
    hashes = f"sha256 {(each.replayed or 'not made')[:12]}"
    return [each.name, each.agreement, "; ".join(part for part in (hashes, where, *each.why) if part)]


@final
class _Report:
    """The report in a frame; a run without one can get it."""

    def __init__(self, place: Path, there: bool) -> None:
        self._place = place
        with section("Report"):
            self._area = ui.element("div").classes("section")
            with self._area:
                show = self._shown if there else self._missing
                show()

    def _missing(self) -> None:
        ui.label("This run has no report yet.").classes("note")
        with ui.element("div").classes("row"):
            command_button("Write the report", lambda: with_operator(self._start), icon="description", gives="report")
        self._view = JobView(self._written)

    async def _start(self, operator: Operator) -> None:
        self._view.follow(await recompute(operator, "report", self._place))

    def _written(self, _: object) -> None:
        self._area.clear()
        with self._area:
            self._shown()

    def _shown(self) -> None:
        target = f"/api/runs/{quote(self._place.name)}/report"
        with ui.element("div").classes("row"):
            link_button("Open the report alone, to print", target, icon="print")
        frame_ = ui.element("iframe").classes("report-frame")
        frame_.props["src"], frame_.props["title"] = target, f"Calibration report of {self._place.name}"


def _size(size: int) -> str:
    return f"{size / 1e6:.1f}\N{NO-BREAK SPACE}MB" if size >= 1e6 else f"{max(size / 1e3, 0.1):.1f}\N{NO-BREAK SPACE}kB"

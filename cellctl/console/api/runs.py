"""Finished and running runs: list, search, result, comparison, drift, histories, files, report, export, replay."""

from __future__ import annotations

import asyncio
import shutil
from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter, Query, Response
from fastapi import Path as PathParameter
from fastapi.responses import FileResponse
from pydantic import BaseModel, ConfigDict, Field
from starlette.background import BackgroundTask

from cellctl.console.api.answers import COMMANDS, READS, Commander, Refused, RunName
from cellctl.console.commands import REPORT_CONTENT, exported, found_rows, indexed, recompute
from cellctl.console.shared import console
from cellctl.files import InputError
from cellctl.installed import History, histories
from cellctl.operations.comparing_runs import compare_runs, parameter_drift
from cellctl.operations.export import Form
from cellctl.operations.fleet import Fleet, FleetReading, RobotCharts
from cellctl.operations.fleet import fleet as fleet_of
from cellctl.operations.results import as_json
from cellctl.operations.run_folder import RunFile, run_file, run_files, run_named
from cellctl.operations.run_indexing import history_page, summary_of
from cellctl.operations.run_list import run_row
from cellctl.run_index import RunFilter

router = APIRouter(prefix="/api", tags=["runs"])

_REPORT = "report.html"
_FileName = Annotated[str, PathParameter(description="Name of the file, see `files`")]


def _text(words: str) -> Any:
    """A parameter of the query: a text."""
    return Query(max_length=200, description=words)


_Offset = Annotated[int, Query(ge=0, le=1_000_000_000, description="Number of the first one, from 0")]


class ErrorFigures(BaseModel):
    """Errors of a set of measurements, mm; null without errors."""

    mean: float | None
    rms: float | None
    max: float | None


class RunOut(BaseModel):
    """A run, as `cellctl show --json` has it: with the fields of its kind of campaign besides these."""

    model_config = ConfigDict(extra="allow")
    run: str = Field(description="Name")
    began: str | None = Field(default=None, description="UTC, ISO 8601")
    procedure: str | None = Field(default=None, description="Procedure file")
    cell: str | None = Field(default=None, description="Cell file")
    operator: str | None = None
    state: str = Field(
        description="idle, checking, … finished, aborted, failed, uncertain, cut off while …, unreadable"
    )
    points: int | None = Field(default=None, description="Measurements that count")
    verdict: str | None = None
    sentence: str | None = Field(
        default=None, description="The verdict in a sentence, or how the run ended without one"
    )
    problem: str | None = Field(default=None, description="Why it ended early")
    cure: str | None = Field(default=None, description="What to do about that")
    before: ErrorFigures | None = Field(default=None, description="Measured held-out errors with nominal joints, mm")
    after: ErrorFigures | None = Field(default=None, description="The same with compensated joints, mm")
    table_state: str | None = Field(default=None, description="proved, taken back, or not proved, may be in force")


class JobOut(BaseModel):
    """A process that the console started."""

    job: str = Field(description="`GET /api/jobs/{job}` shows its progress and outcome")


@router.get("/runs", responses=READS)
async def list_runs(
    response: Response,
    text: Annotated[str, _text("Words that are all in name, files, operator, devices or verdict")] = "",
    state: Annotated[str, _text("State; empty: all")] = "",
    verdict: Annotated[str, _text("Verdict; empty: all")] = "",
    serial: Annotated[str, _text("Serial number of the robot; empty: all")] = "",
    procedure: Annotated[str, _text("Name of the procedure; empty: all")] = "",
    since: Annotated[str, _text("First day of the begin, ISO 8601")] = "",
    until: Annotated[str, _text("Last day of the begin, ISO 8601")] = "",
    offset: _Offset = 0,
    limit: Annotated[int, Query(ge=1, le=1000, description="Number of runs at most")] = 200,
) -> list[RunOut]:
    """The runs, newest first; a page of them, `X-Total-Count` says of how many."""
    asked = RunFilter(text, state, verdict, serial, procedure, since, until)
    response.headers["x-total-count"] = str(await indexed(lambda index: index.count(asked)))
    return [RunOut(**as_json(row)) for row in await found_rows(asked, offset=offset, limit=limit)]


@router.get("/runs/{name}/result", responses=READS)
async def result(name: RunName) -> RunOut:
    """A run in figures."""
    return RunOut(**as_json(await asyncio.to_thread(run_row, run_place(name))))


@router.get("/runs/{name}/files", responses=READS)
async def files(name: RunName) -> list[RunFile]:
    """The files of a run."""
    return list(await asyncio.to_thread(run_files, run_place(name)))


@router.get("/runs/{name}/files/{file}", response_class=FileResponse, responses=READS)
async def download(name: RunName, file: _FileName) -> FileResponse:
    """A file of a run, to save."""
    return FileResponse(_file(run_place(name), file), media_type="application/octet-stream", filename=f"{name}-{file}")


@router.get("/runs/{name}/report", response_class=FileResponse, responses=READS)
async def report(name: RunName) -> FileResponse:
    """The calibration report of a run, as a page."""
    headers = {"content-security-policy": REPORT_CONTENT}
    return FileResponse(_file(run_place(name), _REPORT), media_type="text/html; charset=utf-8", headers=headers)


@router.get("/runs/{name}/export", response_class=FileResponse, responses=READS)
async def export(name: RunName, form: Annotated[Form, Query(description="What to export")] = Form.ZIP) -> FileResponse:
    """A run for other programs. csv, parquet: samples; jsonl: events; bluesky: documents; figures: pictures;
    dcc: Digital Calibration Certificate; zip: everything."""
    file, saved_as = await exported(run_place(name), form)
    removed = BackgroundTask(shutil.rmtree, file.parent, ignore_errors=True)
    return FileResponse(file, media_type="application/octet-stream", filename=saved_as, background=removed)


@router.post("/runs/{name}/replay", status_code=202, responses=COMMANDS)
async def replay(operator: Commander, name: RunName) -> JobOut:
    """Compute the run again from its journal alone, and compare byte for byte; changes nothing in the run folder."""
    return JobOut(job=(await recompute(operator, "replay", run_place(name))).id)


@router.post("/runs/{name}/report", status_code=202, responses=COMMANDS)
async def rewrite_report(operator: Commander, name: RunName) -> JobOut:
    """Write the report of a run again."""
    return JobOut(job=(await recompute(operator, "report", run_place(name))).id)


@router.get("/jobs/{number}", responses=READS)
async def job(
    number: Annotated[str, PathParameter(description="`job` of the answer that started it")],
) -> dict[str, Any]:
    """A process that the console started: state, progress, result or failure."""
    found = console().jobs.find(number)
    if found is None:
        raise Refused(404, f"there is no job {number[:80]}", "the console keeps the last 100 that it started")
    return found.to_json()


@router.get("/compare", responses=READS)
async def compare(a: Annotated[str, _text("First run")], b: Annotated[str, _text("Second run")]) -> dict[str, Any]:
    """Two runs side by side: facts, errors (mm), and parameters of their models with the difference and its 1 σ."""
    first, second = run_place(a), run_place(b)
    return as_json(await asyncio.to_thread(compare_runs, first, second))


@router.get("/drift", responses=READS)
async def drift(
    serial: Annotated[str, _text("Serial number of the robot")],
    parameter: Annotated[list[str], Query(max_length=200, description="Names of parameters")] = [],  # noqa: B006
) -> dict[str, Any]:
    """Parameters of one robot's models over its runs, with their trends for 30 days; by default all determined ones."""
    rows = [summary_of(found) for found in await indexed(lambda index: index.with_model(serial))]
    return as_json(await asyncio.to_thread(parameter_drift, console().runs, rows, serial, parameter))


@router.get("/fleet", responses=READS)
async def fleet(
    type: Annotated[str, _text("Type of the robot; empty: all")] = "",  # noqa: A002
    site: Annotated[str, _text("Site of the robot; empty: all")] = "",
) -> Fleet:
    """Which robots need a calibration, and why, the most urgent first; what moved in robots of a type or site together;
    parameters whose stated σ is too small.
    """
    runs = console().runs
    return await indexed(lambda index: fleet_of(index, runs, robot_type=type, site=site))


@router.get("/fleet/{serial}", responses=READS)
async def robot_charts(
    serial: Annotated[str, PathParameter(max_length=200, description="Serial number of the robot")],
) -> RobotCharts:
    """The charts of a robot's parameters over its runs since its calibration, the one furthest outside first."""
    runs = console().runs
    try:
        return await indexed(lambda index: FleetReading(index, runs).charts(serial))
    except LookupError:
        cure = "GET /api/fleet lists the robots; a robot has charts after a calibration with a model"
        raise Refused(404, f"there are no charts of robot '{serial[:80]}'", cure) from None


def _add(history: History) -> None:
    """The route of a history that a package of campaigns brings."""

    @router.get(f"/{history.name}", name=history.name, description=history.about, responses=READS)
    async def compared(
        baseline_runs: Annotated[int | None, Query(ge=2, le=1000, description="Number of the first checks")] = None,
        offset: _Offset = 0,
        limit: Annotated[int, Query(ge=1, le=100, description="Number of histories at most")] = 1,
    ) -> dict[str, Any]:
        return await indexed(
            lambda index: history_page(index, history, baseline_runs, offset=offset, limit=limit).to_json()
        )


for _history in histories():
    _add(_history)


def run_place(name: str) -> Path:
    """The folder of the run `name`. Raises Refused."""
    try:
        return run_named(console().runs, name)
    except InputError as error:
        raise Refused(404, f"there is no run '{name[:80]}'", error.problems[0].cure) from None


def _file(place: Path, name: str) -> Path:
    try:
        return run_file(place, name)
    except InputError:
        raise Refused(404, f"run {place.name} has no file '{name[:80]}'", "its list of files has the names") from None

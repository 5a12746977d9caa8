"""The runs of this console's folder, for pages and API."""

from __future__ import annotations

import asyncio
import shutil
import tempfile
from pathlib import Path

from cellctl.console.command_jobs import result_of
from cellctl.console.shared import console
from cellctl.operations.export import Form
from cellctl.operations.run_list import RunRow, run_rows

REPORT_CONTENT = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; font-src data:; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'self'; sandbox"
)
"""Content-Security-Policy of a report: a page without scripts, which loads nothing."""


def live_rows() -> list[RunRow]:
    """The runs that are known by now, newest first."""
    rows = console().live.rows
    return [{**row.summary, **({"sentence": str(row.problem.what)} if row.problem else {})} for row in rows]


async def known_rows() -> list[RunRow]:
    """All runs, newest first; read from their journals while the console has not followed all of them yet."""
    if console().live.reading:
        return await asyncio.to_thread(run_rows, console().runs)
    return live_rows()


async def exported(place: Path, form: Form) -> tuple[Path, str]:
    """A new file with the export of the run in `place`, made by a process of its own, and the name to save it by.

    The caller removes the file's folder. Raises InputError if the run cannot be exported.
    """
    folder = Path(await asyncio.to_thread(tempfile.mkdtemp, prefix="cellctl-export-"))
    target = folder / f"{place.name}-{form.file_name}"
    request = {"place": str(place), "form": form.value, "target": str(target)}
    job = console().jobs.start(f"export of {place.name}", "export", request, "")
    try:
        await result_of(job)
    except BaseException:
        job.cancel()
        await asyncio.to_thread(shutil.rmtree, folder, ignore_errors=True)
        raise
    return target, target.name

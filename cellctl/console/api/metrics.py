"""`/metrics`: runs, progress, devices and memory of the console in Prometheus' text format; read free, no commands.

Format: https://prometheus.io/docs/instrumenting/exposition_formats (0.0.4). Names end in their unit.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from fastapi import APIRouter
from fastapi.responses import PlainTextResponse

from cellctl.console.commands import indexed
from cellctl.console.live import Snapshot
from cellctl.console.shared import console
from cellctl.version import __version__

router = APIRouter(tags=["console"], include_in_schema=False)

CONTENT_TYPE: Final = "text/plain; version=0.0.4; charset=utf-8"

_LABELS: Final = ("procedure", "state", "verdict", "acceptance")
"""Of the runs that are counted: columns of the index."""

_Value = tuple[Mapping[str, str], float]
"""Labels and value of one sample."""


@router.get("/metrics", response_class=PlainTextResponse)
async def metrics() -> PlainTextResponse:
    """All gauges of this console."""
    live = console().live
    active = [await live.snapshot(name) for name in live.active]
    counts = await indexed(lambda index: index.counts(*_LABELS), wait=False)
    return PlainTextResponse("".join(_text(active, counts)), media_type=CONTENT_TYPE)


def _text(active: Iterable[Snapshot], counts: Iterable[tuple[Any, ...]]) -> Iterator[str]:
    """active: the runs in progress. counts: of all runs, see `RunIndex.counts`."""
    running = list(active)
    yield from _gauge("cellctl_info", "Version of cellctl.", [({"version": __version__}, 1.0)])
    yield from _gauge("cellctl_runs", "Runs of the folder that have been read.", _runs(counts))
    yield from _gauge(
        "cellctl_console_reading",
        "Whether runs of the folder are not read yet: cellctl_runs is not complete.",
        [({}, float(console().live.reading))],
    )
    yield from _gauge(
        "cellctl_run_steps_done", "Steps done of a run in progress.", [(_of(run), run.status.done) for run in running]
    )
    yield from _gauge(
        "cellctl_run_steps", "Steps of a run in progress, as far as known.", [(_of(r), r.status.total) for r in running]
    )
    yield from _gauge(
        "cellctl_run_left_seconds",
        "Time left of a run in progress.",
        [(_of(run), run.status.left_s) for run in running if run.status.left_s is not None],
    )
    yield from _gauge(
        "cellctl_run_waits",
        "Whether a run waits for a person.",
        [(_of(run), float(bool(run.status.confirm or run.status.held_by))) for run in running],
    )
    yield from _gauge(
        "cellctl_run_repeated_attempts",
        "Repeated attempts at steps of a run in progress.",
        [(_of(run), sum(step.attempt - 1 for step in run.state.steps.values())) for run in running],
    )
    yield from _devices(running)
    if (memory := _resident_bytes()) is not None:
        yield from _gauge(
            "process_resident_memory_bytes", "Resident memory of the console's process.", [({}, float(memory))]
        )


def _runs(counts: Iterable[tuple[Any, ...]]) -> list[_Value]:
    return [(dict(zip(_LABELS, each, strict=True)), float(number)) for *each, number in counts]


def _of(run: Snapshot) -> dict[str, str]:
    procedure = Path(run.state.started.procedure.path).stem if run.state.started else ""
    return {"run": run.run, "procedure": procedure}


def _devices(running: Iterable[Snapshot]) -> Iterator[str]:
    reported = [(run.run, health) for run in running for health in run.state.health.values()]
    yield from _gauge(
        "cellctl_device_ok",
        "Whether a device of a run in progress reported that it is well.",
        [({"run": run, "device": each.device}, float(each.ok)) for run, each in reported],
    )
    yield from _gauge(
        "cellctl_device_latency_seconds",
        "Time of the cell from a request to a device until its answer.",
        [
            ({"run": run, "device": each.device}, each.latency_ms * 1e-3)
            for run, each in reported
            if each.latency_ms is not None
        ],
    )


def _gauge(name: str, words: str, samples: Iterable[_Value]) -> Iterator[str]:
    yield f"# HELP {name} {words}\n# TYPE {name} gauge\n"
    for labels, value in samples:
        inner = ",".join(f'{label}="{_escaped(text)}"' for label, text in labels.items())
        yield f"{name}{f'{{{inner}}}' if inner else ''} {value:.10g}\n"


def _escaped(text: str) -> str:
    return text.replace("\\", r"\\").replace('"', r"\"").replace("\n", r"\n")


def _resident_bytes() -> int | None:
    """Of this process; None where the system has no /proc."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError, IndexError, AttributeError):
        return None

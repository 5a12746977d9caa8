"""The events of a run as JSON lines, and as documents of bluesky's event model.

Event model: `event_model/schemas` of the package event-model. A stream is a kind of samples (`touch`, `pose`).
"""

from __future__ import annotations

import datetime
import json
from collections.abc import Iterator, Mapping
from typing import Any, final
from uuid import UUID, uuid5

from cellctl.files import InputError, Problem, canonical_json
from cellctl.journal import Entry, ReadableJournal, RunResumed, RunStarted, RunState
from cellctl.operations.export.samples import Samples, is_sample


def event_lines(journal: ReadableJournal) -> str:
    """One JSON object per line: `seq`, `time_ns` (the cell's time), `kind`, `step`, `attempt`, `data`.

    `data` has all fields of the journal, also those that this version of cellctl does not know.
    """
    names = ("seq", "time_ns", "kind", "step", "attempt", "data")
    lines = (dict(zip(names, (*row[:-1], json.loads(row[-1])), strict=True)) for row in journal.rows)
    return "".join(f"{canonical_json(line)}\n" for line in lines)


Document = tuple[str, dict[str, Any]]
"""The name of a document (`start`, `descriptor`, `event`, `stop`) and its content."""

_NAMESPACE = UUID("6c2c3e5c-4b0e-5f0b-9f4e-63656c6c6374")
_STATUS = {"finished": "success", "aborted": "abort"}


def bluesky(name: str, entries: tuple[Entry, ...], state: RunState, *, alive: bool) -> str:
    """JSON lines `[name, document]` of the run `name`; a run that is still running (`alive`) has no stop document.

    Raises InputError if the event that began the run cannot be read.
    """
    return "".join(f"{json.dumps(each, ensure_ascii=False)}\n" for each in documents(name, entries, state, alive=alive))


def documents(name: str, entries: tuple[Entry, ...], state: RunState, *, alive: bool) -> Iterator[Document]:
    """The documents in order. Times are Unix times: the calendar time of the start, and the cell's time from then on.
    The same run gives the same uids.
    """
    if state.started is None:
        what = "the event that began the run cannot be read: bluesky documents begin with it"
        raise InputError(Problem(name, 0, 0, what, "export --as jsonl: it has the events that can be read"))
    run = _Run(name, entries, state.started)
    yield "start", run.start(state)
    counts: dict[str, int] = {}
    for kind in dict.fromkeys(row.event.row_kind for row in state.rows if is_sample(row)):
        samples = Samples.of((row for row in state.rows if row.event.row_kind == kind), state)
        counts[kind] = samples.count
        yield from run.stream(kind, samples)
    if state.ended is not None or not alive:
        yield "stop", run.stop(state, counts)


@final
class _Run:
    """Makes the documents of one run."""

    def __init__(self, name: str, entries: tuple[Entry, ...], started: RunStarted) -> None:
        self._name, self._started = name, started
        self._times = dict(_unix_times(entries))
        self._start = self._uid("start")

    def start(self, state: RunState) -> dict[str, Any]:
        started = self._started
        return {
            "uid": self._start,
            "time": next(iter(self._times.values())),
            "run": self._name,
            "procedure": started.procedure.path,
            "cell": started.cell.path,
            "operator": started.operator,
            "seed": started.seed,
            "clock": started.clock,
            "plan_name": started.procedure.path.rpartition("/")[2].removesuffix(".yaml"),
            "plan_args": dict(started.parameters),
            "devices": [{"name": device, **who} for device, who in state.identities.items()],
            "versions": [f"{package} {version}" for package, version in started.versions.items()],
        }

    def stream(self, kind: str, samples: Samples) -> Iterator[Document]:
        columns = [column for column in samples.columns if column.name not in ("seq", "kind")]
        numbers = next(column.values for column in samples.columns if column.name == "seq")
        descriptor = self._uid(f"descriptor {kind}")
        keys = {column.name: self._key(kind, column.kind, column.unit) for column in columns}
        yield (
            "descriptor",
            {
                "uid": descriptor,
                "run_start": self._start,
                "time": self._times[numbers[0]],
                "name": kind,
                "data_keys": keys,
                "object_keys": {kind: list(keys)},
                "configuration": {},
                "hints": {},
            },
        )
        for index, seq in enumerate(numbers):
            time = self._times[seq]
            data = {column.name: column.values[index] for column in columns}
            event = {"uid": self._uid(f"event {seq}"), "descriptor": descriptor, "seq_num": index + 1, "time": time}
            yield "event", {**event, "data": data, "timestamps": dict.fromkeys(data, time), "filled": {}}

    def stop(self, state: RunState, counts: Mapping[str, int]) -> dict[str, Any]:
        reason = state.ended.reason if state.ended else state.state_if(running=False)
        return {
            "uid": self._uid("stop"),
            "run_start": self._start,
            "time": list(self._times.values())[-1],
            "exit_status": _STATUS.get(state.state, "fail") if state.ended else "fail",
            "reason": reason,
            "num_events": dict(counts),
        }

    def _key(self, kind: str, dtype: str, unit: str) -> dict[str, Any]:
        units = {"units": unit} if unit else {}
        return {"source": f"cellctl:{kind}", "dtype": dtype, "shape": [], "object_name": kind, **units}

    def _uid(self, what: str) -> str:
        return str(uuid5(_NAMESPACE, f"{self._name} {self._started.calendar} {what}"))


def _unix_times(entries: tuple[Entry, ...]) -> Iterator[tuple[int, float]]:
    """Number and Unix time of each event, s: a process that resumes the run states the calendar time anew."""
    unix_s, cell_ns = 0.0, entries[0].time_ns
    for entry in entries:
        if isinstance(entry.event, RunStarted | RunResumed):
            unix_s, cell_ns = datetime.datetime.fromisoformat(entry.event.calendar).timestamp(), entry.time_ns
        yield entry.seq, unix_s + (entry.time_ns - cell_ns) * 1e-9

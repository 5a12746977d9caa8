"""A run in figures, from its folder: the JSON of `cellctl show`."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from cellctl.journal import RunResult, RunState, writer_of
from cellctl.operations.results import table_line
from cellctl.operations.run_end import RunEnd

_SIMULATE = re.compile(r"^simulate\s*:", re.MULTILINE)


def is_simulated(state: RunState) -> bool:
    """Whether a device of the run reported that it is simulated, or its cell file has simulation settings."""
    reported = any(identity.get("simulated") for identity in state.identities.values())
    return reported or bool(state.started and _SIMULATE.search(state.started.cell.text))


def run_summary(place: Path, state: RunState) -> dict[str, Any]:
    """The run in folder `place`, whose journal has the state `state`."""
    result = RunResult.of(place.name, state)
    content = result.to_json()
    writer = writer_of(place)
    end = RunEnd.of(place, state, running=bool(writer))
    return {
        "run": place.name,
        "began": state.started.calendar if state.started else None,
        "procedure": state.started.procedure.path if state.started else None,
        "cell": state.started.cell.path if state.started else None,
        "simulated": is_simulated(state),
        "operator": state.started.operator if state.started else None,
        "devices": {name: dict(identity) for name, identity in state.identities.items()},
        "state": state.state_if(running=bool(writer)),
        "points": result.points,
        "attempts": sum(step.attempt for step in state.steps.values()),
        **{name: content[name] for name in ("verdict", "before", "after", "table")},
        "sentence": content["sentence"] or (end.sentence if end else None),
        "problem": end.problem if end else None,
        "cure": end.cure if end else None,
        "table_state": result.table.state if result.table else None,
        "table_words": table_line(state, place) or None,
        "process": writer.pid if writer else None,
        **result.section,
        "lines": result.lines,
        "reason": state.ended.reason if state.ended else None,
        "cell_s": round((state.last_ns - state.first_ns) * 1e-9, 3),
        "seed": state.started.seed if state.started else None,
        "clock": state.started.clock if state.started else None,
    }

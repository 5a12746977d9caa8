"""Presets of the start of a run: named settings of a procedure, in `RUNS/presets/PROCEDURE.json`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import final

from cellctl.clock import calendar_time
from cellctl.files import InputError, Problem, write_atomically

FOLDER = "presets"
_LONGEST_NAME = 60


@final
@dataclass(frozen=True, slots=True)
class Preset:
    """Settings of a procedure (parameter → its text; others have their defaults), kept by `operator` at `time`, UTC."""

    name: str
    settings: Mapping[str, str]
    operator: str
    time: str


def presets_of(runs: Path, procedure: str) -> dict[str, Preset]:
    """The presets of the procedure of this name, by their name. Raises InputError where their file is damaged."""
    file = _file(runs, procedure)
    try:
        found = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else []
        return {each["name"]: Preset(**each) for each in found}
    except (OSError, ValueError, TypeError, KeyError) as error:
        cure = "restore it from a copy, or delete it: its presets are lost then"
        raise InputError(Problem(str(file), 0, 0, f"holds no presets ({type(error).__name__})", cure)) from error


def keep_preset(runs: Path, procedure: str, name: str, settings: Mapping[str, str], operator: str) -> Preset:
    """Keep `settings` as the preset `name`, in place of one of this name. Raises InputError, OSError."""
    plain = " ".join(name.split())
    if not 0 < len(plain) <= _LONGEST_NAME:
        raise InputError(Problem("preset", 0, 0, "has no name", f"give it one of 1 to {_LONGEST_NAME} letters"))
    preset = Preset(plain, dict(settings), operator, calendar_time())
    _write(runs, procedure, {**presets_of(runs, procedure), plain: preset})
    return preset


def delete_preset(runs: Path, procedure: str, name: str) -> None:
    """Delete the preset `name`; nothing where there is none. Raises InputError, OSError."""
    _write(runs, procedure, {known: each for known, each in presets_of(runs, procedure).items() if known != name})


def _write(runs: Path, procedure: str, presets: Mapping[str, Preset]) -> None:
    file = _file(runs, procedure)
    file.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(file, json.dumps([asdict(each) for each in presets.values()], indent=1, ensure_ascii=False) + "\n")


def _file(runs: Path, procedure: str) -> Path:
    return runs / FOLDER / f"{Path(procedure).stem}.json"

"""The controller on which a model was identified: from the run beside it, or stated by a person."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import final

from cellctl.files import InputError, Problem
from cellctl.formats import ModelFile
from cellctl.journal import fold, read_journal

SIMULATED_SERIAL = "SIM-"
"""Prefix of a simulated controller's serial (docs/reference/eki-channel.md)."""


@final
@dataclass(frozen=True, slots=True)
class LearntOn:
    """The controller that a table is for, whether its model was identified on a simulator, and in which run."""

    serial: str
    simulated: bool
    run: str | None


def learnt_on(path: Path | None, model: ModelFile, serial: str | None) -> LearntOn:
    """The controller of the model in file `path` (None: it is in no file): from its provenance, else the journal in its
    folder, else `serial`.

    Raises InputError if none of these states it, or if `serial` differs from the model's controller: a model is valid
    only for the robot, or simulator, on which it was identified.
    """
    if serial is not None and not serial.strip():
        raise InputError(Problem("--serial", 0, 0, "is empty", "give the serial number that the controller shows"))
    found = stated_on(path, model)
    name = str(path or "the model")
    if found is None and serial is None:
        what = "does not say on whose controller it was learnt"
        raise InputError(Problem(name, 0, 0, what, "give its serial with --serial"))
    if found is None:
        assert serial is not None
        return LearntOn(serial, serial.startswith(SIMULATED_SERIAL), None)
    if serial is not None and serial != found.serial:
        what = f"'{serial}', but {name} was learnt on controller '{found.serial}'"
        raise InputError(Problem("--serial", 0, 0, what, "leave --serial out, or give this robot's own model"))
    return found


def stated_on(path: Path | None, model: ModelFile) -> LearntOn | None:
    """The controller that the model's provenance states, else the journal in its folder; None if neither does."""
    return _by_provenance(model, path) or (_by_journal(path.parent) if path else None)


def _by_provenance(model: ModelFile, path: Path | None) -> LearntOn | None:
    serial = model.provenance.get("robot_serial")
    if serial is None:
        return None
    run = model.provenance.get("run") or (_run_of(path.parent) if path else None)
    return LearntOn(serial, serial.startswith(SIMULATED_SERIAL), run)


def _by_journal(folder: Path) -> LearntOn | None:
    """The only device with axes of the run in `folder`; every step calls it robot."""
    if not (folder / "journal.sqlite").exists():
        return None
    identity = fold(read_journal(folder)).identities.get("robot")
    return LearntOn(str(identity["serial"]), bool(identity["simulated"]), _run_of(folder)) if identity else None


def _run_of(folder: Path) -> str | None:
    return folder.resolve().name if (folder / "journal.sqlite").exists() else None

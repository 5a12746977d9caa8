"""A prior of a type from runs, or from model files: one model of each robot."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

from cellctl.files import InputError, Problem
from cellctl.formats import ModelFile
from cellctl.formats.type_prior import LeftOut, TypePriorFile, why_not
from cellctl.journal import run_place
from cellctl.operations.run_indexing import MODEL


def prior_of_type(given: Sequence[Path], runs: Path, without: Collection[str] = ()) -> TypePriorFile:
    """The prior of the robots of these runs: their folders, or names in the folder `runs`, or model files.

    Of several runs of one robot (by its serial) the last one given counts. without: serials of robots, or names, that
    are left out. Raises InputError where a run has no model, the robots are of different types, or fewer than three are
    left.
    """
    models, left_out, problems = {}, [], []
    for place in [run_place(each, runs) for each in given]:
        file = place / MODEL if place.is_dir() else place
        name = place.name if place.is_dir() else str(place)
        if not file.is_file():
            problems.append(
                Problem(str(place), 0, 0, "has no model", "give runs that identified a robot, or model files")
            )
            continue
        try:
            models[name] = ModelFile.load(file)
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    serials = {name: model.provenance.get("robot_serial", "") for name, model in models.items()}
    last = {serial: name for name, serial in serials.items() if not why_not(models[name])}
    for name, serial in serials.items():
        why = why_not(models[name])
        if {name, serial} & set(without):
            why = "as asked for by --without"
        elif not why and serial and last[serial] != name:
            why = f"the run {last[serial]} is of the same robot, {serial}"
        if why:
            left_out.append(LeftOut(run=name, why=why))
            del models[name]
    try:
        return TypePriorFile.of(models, left_out)
    except ValueError as error:
        why = "; ".join([str(error), *(f"{each.run} is left out: {each.why}" for each in left_out)])
        cure = "give runs of three robots or more of one type"
        raise InputError(Problem("RUN…", 0, 0, why, cure)) from error

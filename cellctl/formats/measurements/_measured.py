"""The usable rows of a data set as a task for the identification."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from cellctl.calibration import Measured, MotorTorsion, Postures, RobotModel, Session, Task, Tolerances
from cellctl.files import InputError, Problem
from cellctl.formats.artefact import Artefact
from cellctl.formats.dataset import DataSet, Rejected, Sieve, joint_readings
from cellctl.formats.description import in_poe
from cellctl.formats.load import two_centres
from cellctl.formats.measurements._conditions import (
    Conditions,
    posture_numbers,
    reject_copies,
    reject_lone,
    reject_lone_zeros,
)
from cellctl.formats.measurements._model_choice import POE, ModelChoice, ModelTerms
from cellctl.formats.measurements._rows import Reading, reject_point_names
from cellctl.formats.measurements._sessions import (
    OWN_BASE,
    Points,
    Spacing,
    known_spacings,
    refuse_planes,
    rough_places,
    session_names,
    sessions_of,
    spacing_rows,
)
from cellctl.formats.measurements.columns import has_own_sigma, zero_sigmas
from cellctl.formats.measurements.kinds import (
    KINDS,
    Kind,
    check_columns,
    kinds_of,
    noun_of,
    reject_zeros,
)
from cellctl.kinematics import Floats
from cellctl.robot_file import RobotFile

SCATTERED = 5.0
"""Places within this many of their σ of one place are that place."""

_NAMED = 10


@final
@dataclass(frozen=True, eq=False)
class Measurements:
    """Usable rows, ready for the identification, in the order of the task's rows: by session, then by kind.

    task: model and rows. readings (N, n): controller readings, deg. lines (N,): each row's line in the file. sets (N,):
    the `set` column, empty where there is none. kinds (N,): kind of each row. own_sigma: whether the rows state their
    own σ, rather than the robot file. data, robot: their sources.
    """

    task: Task
    readings: Floats
    lines: tuple[int, ...]
    sets: tuple[str, ...]
    kinds: tuple[Kind, ...]
    rejected: tuple[Rejected, ...]
    data: DataSet
    robot: RobotFile
    own_sigma: bool = False

    @property
    def measure(self) -> str:
        """The kinds present, joined by `+`: `position`, `sphere+position`."""
        return "+".join(kind for kind in KINDS if kind in self.kinds)

    @property
    def noun(self) -> str:
        """The noun for such rows in messages."""
        return noun_of(self.measure)

    def postures(self) -> list[int]:
        """The number of each row's posture (N,): the same for rows of the same readings."""
        return posture_numbers(self.readings)

    def sightings(self) -> list[int]:
        """A number for each row's measurement (N,): the same for repeats of one kind, session, point, zero and
        posture.
        """
        blocks = self.task.rows.blocks
        number = np.repeat(np.arange(len(blocks)), [len(block) for block in blocks])
        point, datum = (
            np.concatenate([np.zeros(0, int), *each])
            for each in zip(*((b.visited, b.zeros) for b in blocks), strict=True)
        )
        return posture_numbers(np.column_stack([self.readings, number, point, datum]))

    def texts(self, column: str) -> list[str]:
        """A column's cells (N,), in the order of the rows here."""
        at = dict(zip(self.data.lines, self.data.texts(column), strict=True))
        return [at[line] for line in self.lines]


def measurements(
    robot: RobotFile,
    data: DataSet,
    *,
    measure: Kind | None = None,
    model: ModelChoice = "auto",
    artefact: Artefact | None = None,
    use_distances: bool = True,
    spacings: Sequence[Spacing] = (),
    own: frozenset[str] = OWN_BASE,
) -> Measurements:
    """The usable rows of `data` as a task for `cellctl.calibration.verdict.fit`.

    measure: the one kind to be used; by default each row's filled cells decide. artefact: for touches; its
    certified distances are used unless `use_distances` is false. spacings: further known distances. own: what each
    session has to itself, `base` and `tool`. Raises InputError where the columns do not allow it, or no row is left.
    """
    sieve, terms = Sieve(data), ModelTerms.parse(model, robot.n)
    robot = in_poe(robot) if POE in terms.terms else robot
    kinds = kinds_of(sieve, measure)
    reject_zeros(sieve, kinds)
    check_columns(data, {measure} if measure else set(kinds), artefact)
    readings = joint_readings(sieve, robot)
    conditions = Conditions(sieve, robot, readings)
    rows = _Rows(conditions, _read(sieve, robot, kinds, artefact), kinds, session_names(sieve), own)
    sets = _sets(sieve)
    on_plane = [KINDS[kind].rows.of_planes for kind in kinds]
    reject_point_names(sieve, on_plane, [name for name, _ in rows.points()])
    reject_copies(sieve, readings, sieve.kept())
    reject_lone_zeros(sieve, rows.zeros(), sieve.kept())
    known = known_spacings(artefact if use_distances else None, spacings)
    reject_lone(sieve, rows.points(), kinds, Counter(name for each in known for name in each.between), sieve.kept())
    found = rows.arranged(sieve.kept())
    refuse_planes([name for row, (name, _) in enumerate(rows.points()) if on_plane[row]], spacings)
    at, points = conditions.at(found.order), found.points
    _refuse_two_centres(data, at, found.order)
    _refuse_missing_currents(data, terms, at, found.order)
    touched = any(KINDS[kinds[row]].touching for row in found.order)
    given = {
        "points": points.names,
        "datums": found.datums,
        "datum_sigmas": zero_sigmas(sieve, rows.zeros(), found.datums),
        "rough": rough_places(points, artefact),
        "spacings": spacing_rows(points, artefact, spacings, use_artefact=use_distances),
        "tolerances": tolerances_of(robot),
        "sessions": found.sessions,
        "candidates": terms.candidates(robot, at),
    }
    return Measurements(
        task=_task(terms.model(robot, at, touched=touched), terms, found.blocks, given),
        readings=readings[found.order],
        lines=tuple(data.lines[row] for row in found.order),
        sets=tuple(sets[row] for row in found.order),
        kinds=tuple(kinds[row] for row in found.order),
        rejected=tuple(sieve.rejected()),
        data=data,
        robot=robot,
        own_sigma=has_own_sigma(data),
    )


def _refuse_two_centres(data: DataSet, at: Postures, order: Sequence[int]) -> None:
    """A fit knows one centre of gravity of its payload, and predicts for that one."""
    if found := two_centres(at):
        one, other = (data.lines[order[row]] for row in found)
        what = f"the payload's centre of gravity is another one than in line {one}"
        cure = "identify each centre of gravity from a data set of its own"
        raise InputError(Problem(data.file, other, 0, what, cure))


def _refuse_missing_currents(data: DataSet, terms: ModelTerms, at: Postures, order: Sequence[int]) -> None:
    """A model with motor currents needs them in every row, those that judge it included."""
    motor = MotorTorsion.group
    if motor not in terms.terms or at.currents is None:
        return
    without = np.flatnonzero(np.isnan(at.currents).any(axis=1)).tolist()
    if without:
        some = ", ".join(str(data.lines[order[row]]) for row in without[:10]) + (" …" if len(without) > 10 else "")
        what = f"{len(without)} of {len(order)} rows lack a motor current, and --model names {motor}: lines {some}"
        cure = f"fill I1…I{at.q.shape[1]} there, remove these rows, or leave {motor} out of --model"
        raise InputError(Problem(data.file, data.lines[order[without[0]]], 0, what, cure))


def tolerances_of(robot: RobotFile) -> Tolerances:
    """The tolerances stated in the robot file; the estimator's defaults for the rest."""
    said = robot.tolerances.model_dump(exclude_none=True) if robot.tolerances else {}
    return Tolerances(**said)


@final
@dataclass(frozen=True, eq=False)
class _Arranged:
    """Rows, points and sessions in the order of the task."""

    order: list[int]
    blocks: list[Measured]
    points: Points
    sessions: tuple[Session, ...]
    datums: tuple[str, ...]


@final
@dataclass(frozen=True, eq=False)
class _Rows:
    """The values read from all rows of a data set, usable or not. kinds, sessions (N); parts: the readings of each
    kind.
    """

    conditions: Conditions
    parts: Mapping[Kind, Reading]
    kinds: Sequence[Kind]
    sessions: Sequence[str]
    own: frozenset[str]

    def arranged(self, kept: list[int]) -> _Arranged:
        """Blocks of the rows `kept`, each of one session and kind."""
        instrument = any(KINDS[self.kinds[row]].rows.of_instrument for row in kept)
        of_rows = [self.sessions[row] for row in kept]
        sessions = sessions_of(of_rows, self.own, instrument=instrument)
        points = Points.of([self._point(row) for row in kept], of_rows, apart=self._apart)
        datums = tuple(sorted({zero for row in kept if (zero := self._zero(row))}))
        order: list[int] = []
        blocks: list[Measured] = []
        for number, session in enumerate(sessions):
            mine = [row for row in kept if len(sessions) == 1 or self.sessions[row] == session.name]
            for kind in KINDS:
                rows = [row for row in mine if self.kinds[row] == kind]
                if rows:
                    order += rows
                    blocks.append(self._block(kind, rows, number, points, datums))
        return _Arranged(order, blocks, points, sessions, datums)

    def points(self) -> list[tuple[str, str]]:
        """Name and session of each row's point (N): "" for none, and for a session that does not matter."""
        return [(self._point(row), self.sessions[row] if self._apart else "") for row in range(len(self.kinds))]

    def zeros(self) -> list[str]:
        """The zero of each row's (N) length, "" where that is known or there is none."""
        return [self._zero(row) for row in range(len(self.kinds))]

    @property
    def _apart(self) -> bool:
        """Whether points of different sessions are different points."""
        return bool(self.own & OWN_BASE)

    def _point(self, row: int) -> str:
        return self.parts[self.kinds[row]].point_name(row)

    def _zero(self, row: int) -> str:
        return self.parts[self.kinds[row]].zero_name(row)

    def _block(self, kind: Kind, rows: list[int], session: int, points: Points, datums: tuple[str, ...]) -> Measured:
        named = [(self._point(row), self.sessions[row]) for row in rows]
        numbers = np.array([points.number(name, session) if name else -1 for name, session in named])
        return self.parts[kind].block(rows, self.conditions.at(rows), session, numbers, datums)


def _read(sieve: Sieve, robot: RobotFile, kinds: Sequence[Kind], artefact: Artefact | None) -> dict[Kind, Reading]:
    """The columns of each kind present."""
    rows = {kind: {row for row, of in enumerate(kinds) if of == kind} for kind in set(kinds)}
    return {name: kind.read(sieve, robot, rows[name], artefact) for name, kind in KINDS.items() if name in rows}


def _task(model: RobotModel, terms: ModelTerms, blocks: list[Measured], given: dict[str, Any]) -> Task:
    return Task(model, blocks, groups=terms.groups(), **given)  # type: ignore[arg-type]  # a task makes row blocks


def _sets(sieve: Sieve) -> list[str]:
    """The `set` column; once it is used, each row must have `fit` or `test`."""
    sets = sieve.data.texts("set")
    if any(sets):
        for row, value in enumerate(sets):
            if value not in ("fit", "test"):
                sieve.reject(row, f"set '{value}' is neither fit nor test")
    return sets


def refuse_alike(measured: Measurements) -> None:
    """Raise InputError with fewer different rows than registration needs, or with only one place from an instrument."""
    rows, least = len(measured.lines), measured.task.rows_at_least
    different = len(set(measured.sightings()))
    if different < least:
        repeated = f", but {different} different: the others repeat their postures" if different < rows else ""
        what = f"too few rows to fit where even the registration takes {least}: {rows}{repeated}"
        problem = Problem(measured.data.file, 0, 0, what, "measure in other postures")
        some = [Problem(problem.file, row.line, 0, row.reason) for row in measured.rejected[:_NAMED]]
        raise InputError([problem, *some])
    _refuse_one_place(measured)


def _refuse_one_place(measured: Measurements) -> None:
    """Refuse an instrument's rows with one TCP place at all joints: they cannot register the robot."""
    task = measured.task
    if "base" not in task.registered:
        return
    for number, session in enumerate(task.sessions):
        blocks = [block for block in task.rows.blocks if block.session == number and len(block)]
        mine = [(block, places) for block in blocks if (places := block.positions) is not None]
        if not mine:
            continue
        xyz = np.concatenate([places for _, places in mine])
        sigma = np.concatenate([block.sigma[:, :3] for block, _ in mine])
        if len(xyz) > 1 and np.all(np.abs(xyz - np.median(xyz, axis=0)) <= SCATTERED * sigma):
            where = f" of session '{session.name}'" if session.name else ""
            what = f"X, Y, Z{where} are the same place in all {len(xyz)} rows, though the joints differ"
            cure = "measure the tool at other places; a tool held in one place is a socket (column socket)"
            raise InputError(Problem(measured.data.file, 1, 0, what, cure))

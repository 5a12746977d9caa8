"""Paths of a compensated program between its points, and points inserted on them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from cellctl.compensation.paths import SINGULAR, Arc, Between, Deviations, Line, Segment, deviations, divided
from cellctl.formats.table_making import valid_region
from cellctl.kinematics import Floats, pose
from cellctl.operations.programs._compensated import Changed, CompensatedProgram
from cellctl.operations.programs._goals import Arrival, Robots
from cellctl.operations.programs._language import Insertion, Move


@final
@dataclass(frozen=True, eq=False)
class Path:
    """One LIN or CIRC. before_mm, bound_mm: upper bound of the deviation from the wanted way with the original points
    and with the new ones; sampled_mm: largest sample of it, at `share` of the way. NaN where `reason` says why it is
    not computed. remarks: joints outside their limits or the model's region, singularities on the way. between: the
    parts, where points are inserted. undivided: why no points are inserted although the bound is above the tolerance.
    """

    move: Move
    reason: str = ""
    before_mm: float = np.nan
    bound_mm: float = np.nan
    sampled_mm: float = np.nan
    share: float = np.nan
    remarks: tuple[str, ...] = ()
    between: Between | None = None
    undivided: str = ""

    @property
    def final_mm(self) -> float:
        """The bound that remains, with the inserted points."""
        return self.bound_mm if self.between is None else float(self.between.bound_mm.max())


@final
@dataclass(frozen=True, eq=False)
class _Judged:
    """A segment that can be judged: where the controller is sent, and from which joints."""

    move: Move
    robots: Robots
    wanted: Segment
    sent: Segment
    nominal_start: Floats
    sent_start: Floats


def program_paths(found: CompensatedProgram) -> list[Path]:
    """The deviations of all LIN and CIRC of a program, in its order."""
    judged, paths = dict[int, _Judged](), dict[int, Path]()
    for number, one in _segments(found):
        if isinstance(one, Path):
            paths[number] = one
        else:
            judged[number] = one
    tools = {one.robots.nominal.tool.tobytes() for one in judged.values()}
    for tool in sorted(tools):
        alike = {number: one for number, one in judged.items() if one.robots.nominal.tool.tobytes() == tool}
        paths |= dict(zip(alike, _with_deviations(found, list(alike.values())), strict=True))
    return [paths[number] for number in sorted(paths)]


def with_points_between(
    found: CompensatedProgram, path: Path, tolerance_mm: float, method: str = "pseudo-target"
) -> Path:
    """`path` divided, if its bound is above the tolerance and it can be divided."""
    if path.reason or not path.bound_mm > tolerance_mm:
        return path
    if path.move.angle_deg is not None:
        return replace(path, undivided="a circle with a circular angle is not divided")
    if reason := path.move.undivided or found.goals.no_positions or next(iter(path.remarks), ""):
        return replace(path, undivided=reason)
    number = found.program.moves.index(path.move)
    start, robots = _start(found, path.move), _changed(found, path.move)[-1].parts[-1].goal.robots
    assert start is not None
    wanted = found.goals.segments[number]
    between = divided(robots.nominal, robots.identified, wanted, start.q, tolerance_mm=tolerance_mm, method=method)
    return replace(path, between=between if between.sent else None, undivided=between.reason)


def _segments(found: CompensatedProgram) -> Iterator[tuple[int, _Judged | Path]]:
    finishes = dict[int, tuple[Floats, Floats]]()
    for number, move in enumerate(found.program.moves):
        points = _changed(found, move)
        one = _segment(found, number, move, points, finishes)
        if len(points) == len(move.uses) and move.target and not move.fault:
            last = points[-1].parts[-1]
            if move.angle_deg is None:
                finishes[number] = last.sent, last.q
            elif isinstance(one, _Judged):
                finishes[number] = one.sent.finish, last.q
        if move.kind in ("LIN", "CIRC", "SPL"):
            yield number, one


def _segment(
    found: CompensatedProgram,
    number: int,
    move: Move,
    points: Sequence[Changed],
    finishes: dict[int, tuple[Floats, Floats]],
) -> _Judged | Path:
    """The segment, or the path with the reason why it is not judged."""
    start = _start(found, move)
    if move.kind not in ("LIN", "CIRC"):
        return Path(move, "a spline: the curve between its points is not computed")
    if move.fault or len(points) < len(move.uses):
        return Path(move, "a point of it stays as it was")
    if start is None or move.start is None or number not in found.goals.segments:
        return Path(move, "its start is not certain")
    if move.start not in finishes:
        return Path(move, "the point where it starts stays as it was")
    if move.other_way:
        return Path(move, move.other_way)
    wanted, (sent_start, q) = found.goals.segments[number], finishes[move.start]
    end = points[-1].parts
    target = pose(end[-1].sent[:3, :3], end[0].sent[:3, 3])
    try:
        sent = Line(sent_start, target) if isinstance(wanted, Line) else _arc(sent_start, points, target, wanted)
    except ValueError as error:
        return Path(move, str(error))
    return _Judged(move, end[0].goal.robots, wanted, sent, start.q, q)


def _arc(start: Floats, points: Sequence[Changed], target: Floats, wanted: Arc) -> Arc:
    return Arc.of(start, points[0].parts[0].sent[:3, 3], target, wanted.angle)


def _start(found: CompensatedProgram, move: Move) -> Arrival | None:
    return None if move.start is None else found.goals.arrivals.get(move.start)


def _changed(found: CompensatedProgram, move: Move) -> list[Changed]:
    return [found.changed[written.key] for written in move.uses if written.key in found.changed]


def _with_deviations(found: CompensatedProgram, judged: Sequence[_Judged]) -> Iterator[Path]:
    robots = judged[0].robots
    wanted, sent = [one.wanted for one in judged], [one.sent for one in judged]
    starts = np.stack([one.nominal_start for one in judged]), np.stack([one.sent_start for one in judged])
    before = deviations(robots.nominal, robots.identified, wanted, wanted, starts[0])
    after = deviations(robots.nominal, robots.identified, wanted, sent, starts[1])
    for row, one in enumerate(judged):
        if not after.followed[row] or not before.followed[row]:
            yield Path(one.move, "the robot cannot follow it without a change of its configuration")
            continue
        yield Path(
            one.move,
            before_mm=float(before.bound_mm[row]),
            bound_mm=float(after.bound_mm[row]),
            sampled_mm=float(after.sampled_mm[row]),
            share=float(after.share[row]),
            remarks=tuple(_remarks(found, after, row)),
        )


def _remarks(found: CompensatedProgram, after: Deviations, row: int) -> Iterator[str]:
    model = found.goals.model
    ends = np.sort(model.robot.joint_map().readings([after.low[row], after.high[row]]), axis=0)
    region = valid_region(model)
    for low, high, what in (
        (*model.robot.limits().T, "the joint's limits"),
        (np.array(region.min), np.array(region.max), "the measured region of the model"),
    ):
        beyond = [f"A{axis + 1}" for axis in np.flatnonzero((ends[0] < low) | (ends[1] > high))]
        if beyond:
            yield f"{', '.join(beyond)} leaves {what} on the way"
    if after.singular[row] < SINGULAR:
        yield "it passes a singularity"


def program_texts(found: CompensatedProgram, paths: Sequence[Path]) -> dict[str, bytes]:
    """The program's files with the compensated points, and with the points inserted on `paths`."""
    numbers = {key: changed.numbers for key, changed in found.changed.items()}
    return found.program.texts(numbers, [each for path in paths if (each := _insertion(found, path))])


def _insertion(found: CompensatedProgram, path: Path) -> Insertion | None:
    if path.between is None or len(path.between.sent) < 2:
        return None
    base = found.changed[path.move.uses[-1].key].parts[0].goal.base
    base = np.eye(4) if base is None else base  # joints
    return Insertion(path.move, path.between.sent, base, float(path.between.bound_mm.max()))

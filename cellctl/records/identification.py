"""Rows about an identification: the residuals of its measurements, and the other data of its report."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, final

from cellctl.records.row import Json, Row

Number = float | None
"""A number; None where there is none."""

Vectors = tuple[tuple[Number, ...], ...]
"""An array of N rows."""


@final
@dataclass(frozen=True, kw_only=True)
class ResidualsRow(Row):
    """N measurement rows: residuals of the registered nominal robot and of the identified one, in row order.

    line (N,): of the data set. number (N,): of the touch, "" where it has none. row (N,): of the identification, from
    0. session (N,): number. point (N,): sphere or socket, "" where there is none; on_sphere (N,): whether a sphere was
    touched. held_out (N,): the fit did not use it. outlier (N,): left out of the fit, or held out and far from its
    prediction. readings (N, n): of the controller, deg.

    tip (N, 3): TCP by the identified robot, mm, in the measuring frame; tip_base (N, 3): in the robot's base frame.
    before, after (N, 3): model less measurement by the nominal and by the identified robot, mm, measuring frame; of a
    distance, along the line to the TCP. signed_before, signed_after (N,), normal (N, 3): such a distance, mm, positive
    outside a sphere, and that line; None for other rows. turn (N, 3): after, of the orientation, rad; None if it was
    not measured. joint_before, joint_after (N, n): the part along the way on which each joint moves the TCP, mm.
    scaled (N, 6): each number after, in its predicted σ; None if a row has fewer, or without a prediction.
    p_value (N,): of a held-out row; None for others.
    """

    KIND: ClassVar[str] = "residuals"
    line: tuple[int, ...]
    number: tuple[str, ...]
    row: tuple[int, ...]
    session: tuple[int, ...]
    point: tuple[str, ...]
    on_sphere: tuple[bool, ...]
    held_out: tuple[bool, ...]
    outlier: tuple[bool, ...]
    readings: Vectors
    tip: Vectors
    tip_base: Vectors
    before: Vectors
    after: Vectors
    signed_before: tuple[Number, ...]
    signed_after: tuple[Number, ...]
    normal: Vectors
    turn: Vectors
    joint_before: Vectors
    joint_after: Vectors
    scaled: Vectors
    p_value: tuple[Number, ...]


@final
@dataclass(frozen=True, kw_only=True)
class IdentificationRow(Row):
    """The report data of an identification besides its residuals. Texts are as the report shows them.

    head: verdict, figures and set-up. joints, sessions: names. one_frame: whether all sessions measured in one frame;
    base_turns (S, 3, 3): rotation of the robot's base in each session's frame. before, after (M,): errors that the
    distribution shows, mm, of held-out rows where `held_out`, else of the fit's rows. parameters: table, placements and
    points. correlation (F, F): of the parameters `correlated` (F,). unobservable: reasons, with combinations.
    sigma_rms_mm, sigma_max_mm: 1 σ of the TCP, 3-D, over the joints of the fit, `frame` in the measuring frame, `among`
    of points among themselves. along_joint: for each joint its readings, deg, and σ there (`among`), mm.
    hints, advice: what to measure next. left_out: rows that were not used, with reasons.
    """

    KIND: ClassVar[str] = "identification"
    head: Mapping[str, Json]
    joints: tuple[str, ...]
    sessions: tuple[str, ...]
    one_frame: bool
    base_turns: tuple[Vectors, ...]
    before: tuple[float, ...]
    after: tuple[float, ...]
    held_out: bool
    parameters: Mapping[str, Json]
    correlated: tuple[str, ...]
    correlation: Vectors
    unobservable: tuple[Mapping[str, Json], ...]
    sigma_rms_mm: Mapping[str, float]
    sigma_max_mm: Mapping[str, float]
    along_joint: tuple[tuple[tuple[float, ...], tuple[float, ...]], ...]
    hints: tuple[str, ...]
    advice: Mapping[str, Json] | None
    left_out: tuple[Mapping[str, Json], ...]

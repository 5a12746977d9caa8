"""The verdict of a test by ISO 9283, in sentences."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict

import numpy as np

from cellctl.calibration import ErrorFigures, paired_verdict
from cellctl.procedure import StepContext
from cellctl.records import Figures, TableStateRow
from procedures.steps.iso9283.rows import (
    CubeRow,
    IsoFigures,
    IsoPoseRow,
    IsoResult,
    IsoRow,
    IsoVerdict,
    RegistrationRow,
)
from procedures.steps.tracker.measuring import NEAR_SHARE
from procedures.steps.tracker.rows import ReadModelRow, SetUpRow


def verdict_of(context: StepContext, speed_percent: float, reflectors: int) -> IsoVerdict:
    """`better` if AP of the five points is smaller with the table by a paired test; `measured` without a table."""
    tests = {row.when: row.figures for row in context.recorded(IsoRow)}
    before, after = tests["before"], tests.get("after")
    setup, models = context.recorded(SetUpRow)[-1], context.recorded(ReadModelRow)
    point, registration = context.recorded(IsoPoseRow)[0].point, context.recorded(RegistrationRow)[-1]
    result = IsoResult(
        before=before,
        after=after,
        edge=context.recorded(CubeRow)[-1].edge,
        speed_percent=speed_percent,
        arrival_percent=speed_percent * NEAR_SHARE,
        load=setup.load,
        payload_kg=setup.payload_kg,
        reflectors=reflectors,
        model_from=models[-1].run if models else None,
    )
    tables = context.recorded(TableStateRow)
    verdict = "measured" if after is None else paired_verdict(_accuracy(before), _accuracy(after))
    return IsoVerdict(
        verdict=verdict,
        sentence=_sentence(before, after, verdict),
        before=_of_points(before),
        after=_of_points(after) if after else None,
        table=tables[-1] if tables else None,
        lines=tuple(_lines(result, registration, point.accuracy, noise_only=point.noise_only)),
        iso9283=result,
        accuracy=point.accuracy,
        noise_only=point.noise_only,
    )


def _accuracy(test: IsoFigures) -> np.ndarray:
    return np.array([each.accuracy for each in test.points])


def _of_points(test: IsoFigures) -> Figures:
    return Figures(**asdict(ErrorFigures.of(_accuracy(test))))


def _sentence(before: IsoFigures, after: IsoFigures | None, verdict: str) -> str:
    def range_of(values: list[float]) -> str:
        return f"{min(values):.3f} to {max(values):.3f} mm"

    def words(test: IsoFigures) -> str:
        accuracy, repeatability = ([getattr(p, name) for p in test.points] for name in ("accuracy", "repeatability"))
        return f"AP {range_of(accuracy)}, RP {range_of(repeatability)}"

    if after is None:
        return f"ISO 9283 by nominal joints: {words(before)} at P1 to P5."
    ends = {"better": "AP is better with the table.", "worse": "AP is worse with the table: it was rolled back."}
    end = ends.get(verdict, "AP is no better with the table: it was rolled back.")
    return f"ISO 9283 at P1 to P5, before: {words(before)}; after: {words(after)}. {end}"


def _lines(result: IsoResult, by: RegistrationRow, accuracy: str, *, noise_only: bool) -> Iterator[str]:
    for when, test in (("before", result.before), ("after", result.after)):
        if test is None:
            continue
        variation = ", ".join(f"{each.position:.3f}" for each in test.variation)
        more = f", vAP at P1, P2, P4: {variation} mm" if variation else ""
        line = f"AD {test.distance_accuracy:+.3f} mm, RD ± {test.distance_repeatability:.3f} mm"
        yield f"{when.capitalize()}: {line}{more}; {test.cycles} cycles."
        if not test.complete:
            yield f"The standard asks for 30 cycles: the figures {when} are of fewer."
        if test.left_out:
            yield f"{test.left_out} cycles {when} were left out: the station moved."
    orientation = "with orientation" if result.reflectors >= 3 else "position only: three reflectors give orientation"
    yield (
        f"Cube of {result.edge:g} mm; {result.speed_percent:g} % of axis speed, {result.arrival_percent:g} % on "
        f"arrival; load {result.load}, {result.payload_kg:g} kg; {orientation}."
    )
    yield (
        f"Base frame registered on {by.poses} other poses by the {by.by} robot (residual {by.residual:.3f} mm RMS), "
        "not on the judged points."
    )
    note = " (noise of such an instrument only)" if noise_only else ""
    most = max(each.instrument_rp for each in result.before.points)
    yield f"Instrument: accuracy profile {accuracy}{note}; its noise alone gives RP {most:.3f} mm."

"""What an identification step makes of its rows, written into the run folder and recorded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from cellctl.calibration import Split
from cellctl.files import sha256_of
from cellctl.formats import Measurements
from cellctl.procedure import StepContext
from cellctl.records import Row, VerdictRow
from procedures.steps.judged import Judged
from procedures.steps.setup_errors import WrongSetup


@final
@dataclass(frozen=True, slots=True)
class Found:
    """The texts of data set and model file, the verdict on the held-out rows, and other rows for the journal.

    rows: residuals and other report data.
    """

    data: str
    model: str
    verdict: VerdictRow
    rows: tuple[Row, ...]


async def write_and_record(context: StepContext, found: Found | WrongSetup) -> Judged:
    """Write `dataset.csv` and `model.json`, and record the rows. Raises the InputError of a wrong set-up."""
    await context.write_artefact("dataset.csv", found.data)
    if isinstance(found, WrongSetup):
        raise found.error
    await context.write_artefact("model.json", found.model)
    for row in (*found.rows, found.verdict):
        await context.record(row)
    return Judged.of(found.verdict)


def held_out_split(measured: Measurements) -> Split:
    """The rows of the set `test` judge."""
    return Split.by_column(np.array([of == "test" for of in measured.sets]))


def provenance(context: StepContext, data: str) -> dict[str, str]:
    """Of a model file that this run makes; data: the text of its data set."""
    return {
        "cell_sha256": sha256_of(context.cell.text),
        "data_sha256": sha256_of(data),
        "robot_serial": context.identity("robot").serial,
        "run": context.run_name,
    }

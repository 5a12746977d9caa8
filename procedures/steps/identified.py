"""What an identification step makes of its rows, written and recorded; set-up errors end a campaign before it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import final

import numpy as np

from cellctl.calibration import Split
from cellctl.files import InputError, load_yaml, sha256_of
from cellctl.formats import Measurements
from cellctl.operations.campaign_services import SetupFiles, refuse_setup_errors
from cellctl.procedure import StepContext
from cellctl.records import Row, VerdictRow
from procedures.steps.judged import Judged


@final
@dataclass(frozen=True, slots=True)
class WrongSetup:
    """The rows show a set-up error: the text of their data set, so that no new measurement is needed; the error.

    error: what is wrong, where, and the cure, with the data set in the run folder.
    """

    data: str
    error: InputError


def wrong_setup(context: StepContext, measured: Measurements, options: str) -> WrongSetup | None:
    """Check robot file and cell file against the rows, as `cellctl fit` does; None if they agree.

    options: of `cellctl fit` on the data set in the run folder, for the message.
    """
    data = context.run_folder / "dataset.csv"
    files = SetupFiles(load_yaml(context.robot_file), data, Path(context.cell.file))
    again = f"cellctl fit {context.robot_file} {data} {options} --column set"
    note = f"no model was made and no table was pushed; after the correction identify from these {measured.noun}: "
    try:
        refuse_setup_errors(measured, files, note + again)
    except InputError as error:
        return WrongSetup(measured.data.text(), error)
    return None


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

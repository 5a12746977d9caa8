"""Set-up errors end a campaign before its identification."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import final

from cellctl.files import InputError, load_yaml
from cellctl.formats import Measurements
from cellctl.operations.setup_refusals import SetupFiles, refuse_setup_errors
from cellctl.procedure import StepContext


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

"""Set-up errors end a campaign before it identifies anything."""

from __future__ import annotations

from pathlib import Path

from cellctl.files import InputError, load_yaml
from cellctl.formats import Measurements
from cellctl.formats.setup_refusals import SetupFiles, refuse_setup_errors
from cellctl.procedure import StepContext


def refuse_wrong_setup(context: StepContext, measured: Measurements) -> None:
    """Check robot file and cell file against the touches, as `cellctl fit` does.

    Where they do not agree, writes `dataset.csv`, so that nothing has to be measured again, and raises InputError: what
    is wrong, where, and the cure.
    """
    data = context.run_folder / "dataset.csv"
    files = SetupFiles(load_yaml(context.robot_file), data, Path(context.cell.file))
    again = f"cellctl fit {context.robot_file} {data} --artefact {context.cell.file} --column set"
    note = f"no model was made and no table was pushed; after the correction identify from these touches: {again}"
    try:
        refuse_setup_errors(measured, files, note)
    except InputError:
        measured.data.write(data)
        raise

"""The Python front door: robots, data, fits, models, runs for notebooks and other programs (docs/python.md).

`import cellctl` offers these names. Results and errors are those of the command line: both call `cellctl.operations`.
"""

from cellctl.facade.data_sets import Data, read
from cellctl.facade.fits import fit
from cellctl.facade.models import Model, load
from cellctl.facade.predictions import Prediction
from cellctl.facade.programs import CompensatedProgram
from cellctl.facade.robots import Robot, robot
from cellctl.facade.runs import Run, open_run
from cellctl.facade.targets import Compensation
from cellctl.files import InputError

__all__ = [
    "CompensatedProgram",
    "Compensation",
    "Data",
    "InputError",
    "Model",
    "Prediction",
    "Robot",
    "Run",
    "fit",
    "load",
    "open_run",
    "read",
    "robot",
]

"""The Python front door: robots, data, fits, models, runs for notebooks and other programs (docs/python.md).

`import cellctl` offers these names. Results and errors are those of the command line: both call `cellctl.operations`.
"""

from cellctl.facade._fits import Comparison, compare, fit
from cellctl.facade._inputs import Data, Robot, read, robot
from cellctl.facade._models import Model, Prediction, load
from cellctl.facade._runs import Run, open_run
from cellctl.facade._targets import CompensatedProgram, Compensation
from cellctl.files import InputError

__all__ = [
    "Comparison",
    "CompensatedProgram",
    "Compensation",
    "Data",
    "InputError",
    "Model",
    "Prediction",
    "Robot",
    "Run",
    "compare",
    "fit",
    "load",
    "open_run",
    "read",
    "robot",
]

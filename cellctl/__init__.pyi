from cellctl.facade import Comparison as Comparison
from cellctl.facade import CompensatedProgram as CompensatedProgram
from cellctl.facade import Compensation as Compensation
from cellctl.facade import Data as Data
from cellctl.facade import InputError as InputError
from cellctl.facade import Model as Model
from cellctl.facade import Prediction as Prediction
from cellctl.facade import Robot as Robot
from cellctl.facade import Run as Run
from cellctl.facade import compare as compare
from cellctl.facade import fit as fit
from cellctl.facade import load as load
from cellctl.facade import open_run as open_run
from cellctl.facade import read as read
from cellctl.facade import robot as robot

__version__: str

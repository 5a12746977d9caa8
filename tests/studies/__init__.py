"""Long studies: `python -m tests.studies` lists them, `python -m tests.studies NAME` runs one."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "helpers"))

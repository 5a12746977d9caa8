"""The model of the real UR10 (ipa-robot-accuracy data set), by way of the documented snippet and the command line."""

from __future__ import annotations

import re
import runpy
import shutil
from pathlib import Path

import pytest

from cellctl.cli import ends
from cellctl.cli.verbs import app
from cellctl.formats import ModelFile

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data" / "ur10_tracker" / "measurements_grid.csv"


def fitted_ur10(folder: Path, terms: str = "geometry") -> ModelFile:
    """Fitted in `folder`, which then has `ur10.csv` and `m.json`."""
    document = (ROOT / "docs" / "reference" / "data-sets.md").read_text()
    (folder / "snippet.py").write_text(re.search(r"```python\n(.*?)```", document, re.DOTALL).group(1))
    shutil.copy(DATA, folder / DATA.name)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        runpy.run_path("snippet.py")
    words = ["fit", "ur10", str(folder / "ur10.csv"), "--measure", "position", "--model", terms]
    code = ends.exit_code_of(lambda: app([*words, "--out", str(folder / "m.json")], standalone_mode=False))
    assert code == 0
    return ModelFile.load(folder / "m.json")

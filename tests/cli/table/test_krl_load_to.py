"""`cellctl krl --load-to`: the generated files are written to a controller that can take files, and only there."""

import json
from pathlib import Path

CELLS = Path(__file__).parents[3] / "procedures" / "cells"
FOLDER = "KRC:\\R1\\PROGRAM"


def test_the_files_are_written_to_the_controller_and_read_back(cellctl, folder):
    command = ("krl", CELLS / "varproxy_cell.yaml", "-o", "krc", "--load-to", FOLDER, "--json", "told.json")
    assert cellctl(*command) == 0
    told = json.loads((folder / "told.json").read_text())
    assert told["sent"] == [f"{FOLDER}\\cellctl_kvp.src", f"{FOLDER}\\cellctl_kvp.dat"]
    assert {path.name for path in (folder / "krc").iterdir()} == set(told["files"])


def test_kukavarproxy_takes_no_files_and_the_cure_says_how_else(cellctl, folder, capsys):
    cell = folder / "cell.yaml"
    text = (CELLS / "varproxy_cell.yaml").read_text().replace("../robots", str(CELLS.parent / "robots"))
    cell.write_text(text.replace("c3_bridge", "kukavarproxy"))
    assert cellctl("krl", cell, "-o", "krc", "--load-to", FOLDER) == 3
    assert "load them by hand" in capsys.readouterr().err
    assert (folder / "krc" / "cellctl_kvp.src").exists()


def test_a_controller_without_file_access_is_refused_before_anything_is_written(cellctl, folder, capsys):
    assert cellctl("krl", CELLS / "sphere_cell.yaml", "-o", "krc", "--load-to", FOLDER) == 2
    assert "cannot write files to its controller" in capsys.readouterr().err
    assert not (folder / "krc").exists()

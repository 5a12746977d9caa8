"""`cellctl table export`: what is written, where its words send the user, and what is refused."""

import json

import pytest

from cellctl.formats import TableFile
from cellctl.krl import KrlFile


def test_a_krl_module_is_written_with_the_place_of_each_file(cellctl, table, folder, capsys):
    assert cellctl("table", "export", table, "--krl", "-o", "krc", "--json", "done.json") == 0
    said = capsys.readouterr().out
    file = TableFile.load(table)
    name = f"CT_{file.id[:12].upper()}"
    assert f"{name}.dat and {name}.src in krc" in said
    assert "KRC:\\R1\\Program\\" in said
    assert "SIMULATED" in said
    data = (folder / "krc" / f"{name}.dat").read_bytes()
    assert data.count(b"\r\n") == data.count(b"\n")
    point = KrlFile.parse(data, name).point("COMPENSATED[1]")
    assert list(point.values.values()) == file.rows[0].compensated
    assert json.loads((folder / "done.json").read_text())["files"] == [f"{name}.dat", f"{name}.src"]


def test_a_csv_goes_to_a_file_or_to_stdout(cellctl, table, folder, capsys):
    assert cellctl("table", "export", table, "--csv", "-o", "targets_out.csv") == 0
    capsys.readouterr()
    assert cellctl("table", "export", table, "--csv") == 0
    assert capsys.readouterr().out == (folder / "targets_out.csv").read_text()


def test_a_changed_table_is_not_exported(cellctl, table, folder, capsys):
    content = json.loads(table.read_text())
    content["rows"][4]["compensated"][1] += 0.5
    table.write_text(json.dumps(content))
    assert cellctl("table", "export", table, "--krl", "-o", "krc") == 2
    assert "was changed after it was made" in capsys.readouterr().err
    assert not (folder / "krc").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "give --krl or --csv"),
        (("--krl", "--csv"), "give --krl or --csv"),
        (("--krl", "-o", "model.json"), "give -o a folder"),
        (("--krl", "-o", "-"), "give -o a folder"),
        (("--csv", "--json", "-"), "goes to stdout"),
        (("--csv", "-o", "model.json", "--json", "model.json"), "as well"),
    ],
)
def test_contradicting_options_are_refused_and_nothing_is_written(cellctl, table, folder, capsys, words, said):
    before = sorted(folder.iterdir())
    assert cellctl("table", "export", table, *words) == 2
    assert said in capsys.readouterr().err
    assert sorted(folder.iterdir()) == before

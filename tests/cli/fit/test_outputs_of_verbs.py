"""Where results go is looked at before the work: no verb writes over what it reads, or two results into one file."""

import errno
import os
import shutil
import sqlite3

import pytest

TARGETS = "X,Y,Z,A,B,C\n700,0,600,0,0,0\n"


@pytest.fixture
def folder(cellctl, files, capsys):
    """A folder with all kinds of files that verbs read, a folder, and a run that is none."""
    assert cellctl("fit", "robot.yaml", "positions.csv", "--model", "geometry", "--out", "model.json") == 0
    (files / "targets.csv").write_text(TARGETS)
    (files / "folder").mkdir()
    (files / "runs" / "one").mkdir(parents=True)
    sqlite3.connect(files / "runs" / "one" / "journal.sqlite").execute("create table t (x)").connection.close()
    capsys.readouterr()
    return files


def _content(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


FIT = ("fit", "robot.yaml", "positions.csv", "--model", "registration")
PREDICT = ("predict", "model.json", "positions.csv")
COMPENSATE = ("compensate", "model.json", "targets.csv", "--serial", "K1")
IMPORT = ("import", "positions.csv", "--robot", "robot.yaml")


@pytest.mark.parametrize(
    "words",
    [
        (*FIT[:3], "--report", "model.json", "--prior", "model.json"),
        (*PREDICT, "-o", "model.json"),
        (*PREDICT, "-o", "./positions.csv"),
        (*PREDICT, "-o", "link.csv"),
        (*COMPENSATE, "-o", "targets.csv"),
        (*COMPENSATE, "-o", "table.json", "--json", "model.json"),
        (*IMPORT, "-o", "robot.yaml"),
        (*IMPORT, "-o", "data.csv", "--json", "positions.csv"),
        ("show", "one", "--json", "runs/one/journal.sqlite"),
        ("runs", "--json", "runs/one/journal.sqlite"),
        ("report", "one", "-o", "runs/one/journal.sqlite"),
        ("table", "show", "model.json", "--json", "model.json"),
        ("table", "push", "model.json", "--cell", "robot.yaml", "--json", "robot.yaml"),
        ("table", "verify", "model.json", "--cell", "robot.yaml", "--json", "model.json"),
        ("table", "rollback", "--cell", "robot.yaml", "--json", "robot.yaml"),
        ("sim", "robot.yaml", "--ready", "robot.yaml"),
        ("run", "robot.yaml", "--json", "robot.yaml"),
    ],
)
def test_what_is_read_is_not_written_over(cellctl, folder, capsys, words):
    (folder / "link.csv").symlink_to("positions.csv")
    before = _content(folder)
    assert cellctl(*words) == 2
    assert "is read here: it would be written over" in capsys.readouterr().err
    assert _content(folder) == before


@pytest.mark.parametrize(
    "words",
    [
        (*PREDICT, "-o"),
        (*COMPENSATE, "-o"),
        (*IMPORT, "-o"),
        (*IMPORT, "-o", "data.csv", "--json"),
        ("convert", "robot.yaml", "--to", "urdf", "-o"),
        ("runs", "--json"),
        ("show", "one", "--json"),
        ("report", "one", "-o"),
        ("table", "show", "model.json", "--json"),
    ],
)
@pytest.mark.parametrize("target", ["folder", "missing/file"])
def test_where_a_result_cannot_go_is_reported_before_anything_is_written(cellctl, folder, capsys, words, target):
    before = _content(folder)
    assert cellctl(*words, target) == 2
    assert f"{target}: " in capsys.readouterr().err
    assert _content(folder) == before


@pytest.mark.long
def test_an_output_that_fails_costs_no_other_and_not_the_verdict(cellctl, folder, capsys, monkeypatch):
    monkeypatch.setattr("cellctl.formats.ModelFile.save", _full)
    written = ("--report", "p.html", "--json", "r.json")
    assert cellctl(*FIT[:3], "--model", "geometry", "--out", "m.json", *written) == 2
    said = capsys.readouterr()
    assert "m.json: could not be written: No space left on device" in said.err
    assert "Better than nominal." in said.out
    assert all((folder / name).exists() for name in written[1::2])


def _full(_, path):
    raise OSError(errno.ENOSPC, "No space left on device", str(path))


@pytest.mark.parametrize("words", [(*COMPENSATE, "-o", "one", "--json", "one"), (*IMPORT, "-o", "a", "--json", "./a")])
def test_two_results_do_not_go_to_one_file(cellctl, folder, capsys, words):
    assert cellctl(*words) == 2
    assert "is written by --out as well" in capsys.readouterr().err


def test_a_minus_is_no_file_called_minus(cellctl, folder, capsys):
    assert cellctl(*PREDICT, "-o", "-") == 2
    assert "--json" in capsys.readouterr().err
    assert not (folder / "-").exists()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_and_a_file_that_may_not_be_written_are_reported_before_the_work(cellctl, folder, capsys):
    (folder / "folder").chmod(0o555)
    shutil.copy(folder / "model.json", folder / "kept.json")
    (folder / "kept.json").chmod(0o444)
    for target in ("folder/m.json", "kept.json"):
        assert cellctl(*FIT, "--out", target) == 2
        assert f"{target}: may not be written" in capsys.readouterr().err
    (folder / "folder").chmod(0o755)

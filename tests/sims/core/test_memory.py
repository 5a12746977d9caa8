"""The memory's file: whole or not at all, and no reason for a robot to stop."""

import json
import os
import shutil

import pytest

from sims.memory import BadMemory, Memory, sole_user


def test_what_was_told_last_is_recalled(tmp_path):
    angle = [1.0]
    memory = Memory(tmp_path / "state.json", {"seed": 1})
    memory.keep("robot", lambda: {"angle": angle[0]})
    memory.save()
    angle[0] = 2.0
    memory.save()
    back = Memory(tmp_path / "state.json", {"seed": 1})
    assert back.recall("robot", lambda told: told["angle"]) == 2.0
    assert back.recall("table", lambda told: told["rows"]) is None
    assert [path.name for path in tmp_path.iterdir()] == ["state.json"]


def test_a_part_that_cannot_be_made_out_is_damage_told_with_file_and_part(tmp_path):
    (tmp_path / "state.json").write_text('{"cell": {}, "robot": {}}')
    memory = Memory(tmp_path / "state.json")
    with pytest.raises(BadMemory, match=r"state\.json is damaged: robot: KeyError\('angle'\)"):
        memory.recall("robot", lambda told: told["angle"])


def test_a_half_written_file_of_a_process_that_was_killed_is_not_read(tmp_path):
    memory = Memory(tmp_path / "state.json")
    memory.save()
    (tmp_path / ".state.json.new").write_text('{"cell": {}, "rob')
    assert Memory(tmp_path / "state.json").recall("robot", lambda told: told) is None
    memory.save()
    assert json.loads((tmp_path / "state.json").read_text()) == {"cell": {}}


def test_where_it_cannot_be_written_any_more_that_is_reported_once_and_nothing_stops(tmp_path, capsys):
    folder = tmp_path / "run"
    folder.mkdir()
    memory = Memory(folder / "state.json")
    memory.save()
    shutil.rmtree(folder)
    memory.save()
    memory.save()
    assert capsys.readouterr().err.count("No such file or directory") == 1
    with pytest.raises(FileNotFoundError):
        memory.write()


def test_without_a_file_nothing_is_remembered(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Memory().save()
    assert list(tmp_path.iterdir()) == []


def test_who_has_the_memory_is_named_to_the_next(tmp_path, monkeypatch):
    monkeypatch.setattr("sims.memory.PATIENCE_S", 0.0)
    path = tmp_path / "state.json"
    refused = pytest.raises(BadMemory, match=f"runs: process {os.getpid()}, .*python")
    with sole_user(path), refused, sole_user(path):
        pass


def test_another_seed_is_named_with_the_one_that_fits(tmp_path):
    path = tmp_path / "memory.json"
    path.write_text('{"cell": {"name": "c", "seed": 3}}')
    with pytest.raises(BadMemory, match="with seed 3, not with seed 4: leave --seed out, or give --seed 3"):
        Memory(path, {"name": "c", "seed": 4})

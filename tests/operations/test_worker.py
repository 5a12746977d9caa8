"""Computing in another process: results and failures come back as data."""

from __future__ import annotations

import asyncio
import importlib
from pathlib import Path

import pytest

from cellctl.operations.checking import check, checked
from cellctl.operations.worker import OPERATIONS, OperationFailed, result_of
from tests.helpers.runs import CELL, ROOT

SELFCAL = ROOT / "procedures" / "sphere_selfcal.yaml"


@pytest.mark.parametrize("operation", OPERATIONS)
def test_every_operation_of_the_table_exists(operation):
    module, name = OPERATIONS[operation].split(":")
    assert callable(getattr(importlib.import_module(module), name))


@pytest.mark.long
@pytest.mark.parametrize("settings", [(), ("touches_fit=25",), ("touches_fit=3", "no_such=1")])
def test_a_check_in_another_process_finds_what_one_here_finds(settings):
    assert asyncio.run(check(SELFCAL, CELL, settings)) == checked(SELFCAL, CELL, settings)


def test_what_an_operation_refuses_comes_back_with_place_and_cure(tmp_path: Path):
    cell = tmp_path / "cell.yaml"
    cell.write_text(CELL.read_text().replace("devices:", "devises:"))
    with pytest.raises(OperationFailed) as failed:
        asyncio.run(result_of("examine", {"cell": str(cell)}))
    assert failed.value.failure.code == 2
    assert any(problem.file == str(cell) and problem.line for problem in failed.value.failure.problems)


def test_an_operation_that_is_not_in_the_table_fails_in_words():
    with pytest.raises(OperationFailed, match="internal error"):
        asyncio.run(result_of("frobnicate", {}))

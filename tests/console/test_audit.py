"""The audit log: each command of the console with who, when, and how it ended."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from cellctl.console.server import new_console
from cellctl.console.sessions import operator_named
from cellctl.console.shared import FILE_NAME, Settings


def test_a_command_is_recorded_with_who_when_and_outcome(tmp_path: Path) -> None:
    console = new_console(Settings(tmp_path))
    before = []

    async def work() -> str:
        before.extend(console.audit.read())
        return "done"

    result = asyncio.run(console.command(operator_named("Ada"), "pause", "run-1", work, reason="lunch"))
    (line,) = console.audit.read()
    assert result == "done"
    assert [one["outcome"] for one in before] == ["cut off"]  # on the disk before the work begins
    assert (line["command"], line["target"], line["operator"], line["via"]) == ("pause", "run-1", "Ada", "console")
    assert (line["outcome"], line["details"]) == ("done", {"reason": "lunch"})
    assert line["time"].endswith("Z")


def test_a_command_that_fails_is_recorded_with_its_reason(tmp_path: Path) -> None:
    console = new_console(Settings(tmp_path))

    async def work() -> None:
        raise ValueError("the robot is not in automatic mode")

    with pytest.raises(ValueError, match="automatic"):
        asyncio.run(console.command(operator_named(""), "push", "table", work))
    assert console.audit.read()[0]["reason"] == "the robot is not in automatic mode"


def test_a_command_is_not_begun_if_it_cannot_be_recorded(tmp_path: Path) -> None:
    (tmp_path / FILE_NAME).mkdir()
    console = new_console(Settings(tmp_path))
    begun = []

    async def work() -> None:
        begun.append(1)

    with pytest.raises(OSError, match="directory"):
        asyncio.run(console.command(operator_named(""), "push", "table", work))
    assert not begun


def test_the_newest_commands_come_first_and_a_damaged_line_hides_no_other(tmp_path: Path) -> None:
    audit = new_console(Settings(tmp_path)).audit
    for number in range(5):
        audit.ended(audit.asked(operator_named("Ada"), "confirm", f"run-{number}", {}))
    with (tmp_path / FILE_NAME).open("a") as stream:
        stream.write('{"id": "cut')
    assert [one["target"] for one in audit.read(3)] == ["run-4", "run-3", "run-2"]


def test_a_command_that_the_end_of_the_console_cancels_has_no_outcome(tmp_path: Path) -> None:
    console = new_console(Settings(tmp_path))

    async def go() -> None:
        begun = asyncio.Event()

        async def work() -> None:
            begun.set()
            await asyncio.Event().wait()

        command = asyncio.create_task(console.command(operator_named("Ada"), "fit", "data", work))
        await begun.wait()
        command.cancel()
        await asyncio.gather(command, return_exceptions=True)

    asyncio.run(go())
    (line,) = console.audit.read()
    assert (line["command"], line["outcome"]) == ("fit", "cut off")

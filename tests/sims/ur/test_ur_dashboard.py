"""The Dashboard server's commands and their answers, as the maker lists them."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.sims.ur.conftest import CELL, DASHBOARD, program


@pytest.mark.parametrize(
    ("command", "answer"),
    [
        ("running", "Program running: false"),
        ("robotmode", "Robotmode: RUNNING"),
        ("safetymode", "Safetymode: NORMAL"),
        ("safetystatus", "Safetystatus: NORMAL"),
        ("programState", "STOPPED <unnamed>"),
        ("get loaded program", "No program loaded"),
        ("isProgramSaved", "false <unnamed>"),
        ("PolyscopeVersion", "URSoftware 5.12.4.0 (simulated)"),
        ("version", "5.12.4.0"),
        ("is in remote control", "true"),
        ("get robot model", "UR10"),
        ("popup hello there", "showing popup"),
        ("close popup", "closing popup"),
        ("close safety popup", "closing safety popup"),
        ("addToLog text", "Added log message"),
        ("addToLog", "No log message to add"),
        ("load nothing.urp", "File not found: nothing.urp"),
        ("play", "Failed to execute: play"),
        ("pause", "Failed to execute: pause"),
        ("stop", "Stopped"),
        ("unlock protective stop", "Protective stop releasing"),
        ("restart safety", "Restarting safety"),
        ("power on", "Powering on"),
        ("power off", "Powering off"),
        ("brake release", "Brake releasing"),
        ("shutdown", "Shutting down"),
        ("quit", "Disconnected"),
        ("get operational mode", "NONE"),
        ("set operational mode manual", "Operational mode MANUAL is set"),
        ("set operational mode other", "could not understand: 'set operational mode other'"),
        ("clear operational mode",
         "No longer controlling the operational mode. Current operational mode: AUTOMATIC"),
        ("make tea", "could not understand: 'make tea'"),
    ],
)  # fmt: skip
def test_a_command_has_its_answer(bench, command, answer):
    assert bench().command(command) == answer


def test_the_serial_number_has_digits_alone_and_is_the_seed_s(bench):
    serial = bench().command("get serial number")
    assert serial.isdigit()
    assert bench().command("get serial number") == serial


def test_power_and_brakes_take_their_time(bench):
    begun = bench(power="off")
    assert begun.command("robotmode") == "Robotmode: POWER_OFF"
    begun.command("power on")
    assert begun.command("robotmode") == "Robotmode: BOOTING"
    begun.let_pass(5.1)
    assert begun.command("robotmode") == "Robotmode: IDLE"
    begun.command("brake release")
    begun.let_pass(2.1)
    assert begun.command("robotmode") == "Robotmode: RUNNING"
    begun.command("power off")
    assert begun.command("robotmode") == "Robotmode: POWER_OFF"
    begun.command("brake release")
    begun.let_pass(7.1)
    assert begun.command("robotmode") == "Robotmode: RUNNING"


def test_a_program_is_loaded_played_paused_and_stopped(bench, tmp_path):
    (tmp_path / "programs").mkdir()
    (tmp_path / "programs/touch.script").write_text(
        "def touch():\n  while True:\n    write_output_integer_register(1, read_output_integer_register(1) + 1)\n"
        "    sync()\n  end\nend\n"
    )
    begun = bench(folder=tmp_path, programs="programs")
    assert begun.command("load touch.urp") == "Loading program: touch.urp"
    assert begun.command("get loaded program") == "Loaded program: touch.urp"
    assert begun.command("play") == "Starting program"
    begun.let_pass(0.1)
    assert begun.command("programState") == "PLAYING touch.urp"
    assert begun.command("running") == "Program running: true"
    assert begun.command("play") == "Failed to execute: play"
    assert begun.command("pause") == "Pausing program"
    begun.let_pass(0.5)
    count = begun.board.outputs.ints[1]
    begun.let_pass(0.5)
    assert count == begun.board.outputs.ints[1]
    assert begun.command("programState") == "PAUSED touch.urp"
    assert begun.command("play") == "Starting program"
    begun.let_pass(0.1)
    assert begun.board.outputs.ints[1] > count
    assert begun.command("stop") == "Stopped"
    assert begun.command("programState") == "STOPPED touch.urp"


def test_a_file_outside_the_folder_of_programs_is_not_found(bench, tmp_path):
    (tmp_path / "programs").mkdir()
    (tmp_path / "other.script").write_text("def other():\nend\n")
    begun = bench(folder=tmp_path, programs="programs")
    assert begun.command("load ../other.urp") == "File not found: ../other.urp"


def test_no_program_plays_without_power(bench, tmp_path):
    (tmp_path / "a.script").write_text("def a():\n  sync()\nend\n")
    begun = bench(folder=tmp_path, programs=".", power="off")
    begun.command("load a.urp")
    assert begun.command("play") == "Failed to execute: play"


def test_in_local_control_only_questions_are_answered(bench):
    begun = bench(control="local")
    assert begun.command("is in remote control") == "false"
    assert begun.command("robotmode") == "Robotmode: RUNNING"
    assert begun.command("power off").startswith("Command is not allowed due to safety reasons")
    assert begun.command("robotmode") == "Robotmode: RUNNING"
    begun.controller.requests["by_hand"]({"action": "remote control"})
    assert begun.command("power off") == "Powering off"


def test_commands_come_in_pieces_and_several_at_once(bench):
    begun = bench()
    client = begun.call(DASHBOARD)
    begun.line(client)
    client.sendall(b"robot")
    begun.let_pass(0.01)
    client.sendall(b"mode\nsafetymode\n")
    assert [begun.line(client), begun.line(client)] == ["Robotmode: RUNNING", "Safetymode: NORMAL"]


def test_the_cell_s_program_runs_from_the_start_and_again_after_a_reset(bench, tmp_path):
    (tmp_path / "waits.script").write_text(program("while True:\n  sync()\nend", "waits"))
    one = bench(folder=tmp_path, programs=".", program="waits.urp")
    assert one.command("running") == "Program running: true"
    one.controller.protective_stop(153, 0, "Protective Stop")
    assert one.command("programState") == "PAUSED waits.urp"
    one.controller.acknowledge()
    assert one.command("programState") == "PLAYING waits.urp"


def test_settings_of_the_driver_stay_in_the_address(bench):
    cell = replace(CELL, addresses={"robot": "ur+rtde://10.0.0.1:30004?contact_input=0&dashboard=29999"})
    one = bench(cell=cell)
    assert one.servers.address == f"ur+rtde://{one.servers.host}?contact_input=0"

"""The program on the controller, by its variables alone: what it does, refuses, and stops for."""

from __future__ import annotations

import pytest

from sims.memory import Memory

HOME = (0, -90, 90, 0, 45, 0)
ELSEWHERE = (60, -60, 60, 30, 30, 90)


def job(number, joints=HOME, percent=20, row=0, off=0):
    values = [number, row, percent, *(round(angle * 10_000) for angle in joints)]
    check = off + sum(weight * value for weight, value in enumerate(values, 1))
    names = ["NUMBER", "ROW", "PERCENT", *(f"A{axis}" for axis in range(1, 7)), "CHECK"]
    return "{KV_JOB_T: " + ", ".join(f"{n} {v}" for n, v in zip(names, [*values, check], strict=True)) + "}"


def begin(one, number, *given, silence_ms=60_000, **named):
    assert one.write("$TIMER[20]", str(-silence_ms))
    assert one.write("$TIMER_STOP[20]", "FALSE")
    assert one.write("KV_JOB", job(number, *given, **named))
    assert one.write("KV_GO", str(number))


def end(one, number):
    """The outcome, when the job has ended."""
    one.until(lambda: one.controller.data.done.get() == number)
    assert one.read("$ROB_STOPPED") == "TRUE"
    return int(one.read("KV_OUTCOME"))


def test_a_job_moves_the_robot_to_its_target(bench):
    one = bench()
    begin(one, 1, ELSEWHERE, 100)
    assert one.read("KV_DONE") == "0"
    assert one.read("$ROB_STOPPED") == "FALSE"
    assert end(one, 1) == 0
    assert one.scene.arm.joints() == pytest.approx(ELSEWHERE)


@pytest.mark.parametrize(
    ("named", "outcome"),
    [
        ({"off": 1}, 22),
        ({"percent": 0}, 21),
        ({"percent": 101}, 21),
        ({"joints": (0, -90, 90, 0, 400, 0)}, 20),
        ({"row": 1}, 42),
        ({"silence_ms": 0}, 30),
    ],
)
def test_a_job_that_must_not_be_is_refused_and_nothing_moves(bench, named, outcome):
    one = bench()
    begin(one, 1, **named)
    assert end(one, 1) == outcome
    assert one.scene.arm.joints() == pytest.approx(HOME)


def test_the_stop_flag_brakes_and_a_new_job_with_the_flag_set_is_not_begun(bench):
    one = bench()
    begin(one, 1, ELSEWHERE, 20)
    one.let_pass(0.5)
    assert one.write("$FLAG[413]", "TRUE")
    assert end(one, 1) == 30
    rest = one.scene.arm.joints()
    assert rest != pytest.approx(ELSEWHERE)
    begin(one, 2)
    assert end(one, 2) == 30
    assert one.scene.arm.joints() == rest


def test_the_timer_brakes_when_nobody_sets_it_again(bench):
    one = bench()
    begin(one, 1, ELSEWHERE, 5, silence_ms=1000)
    for _ in range(3):
        one.let_pass(0.5)
        assert one.write("$TIMER[20]", "-1000")
    assert one.read("$ROB_STOPPED") == "FALSE"
    assert end(one, 1) == 30
    assert one.scene.arm.joints() != pytest.approx(ELSEWHERE)


def test_the_flag_of_a_timer_is_set_from_zero_on(bench):
    one = bench()
    assert one.write("$TIMER[7]", "-1000")
    assert one.read("$TIMER_STOP[7]") == "TRUE"
    assert one.read("$TIMER_FLAG[7]") == "FALSE"
    assert one.write("$TIMER[7]", "0")
    assert one.read("$TIMER_FLAG[7]") == "TRUE"
    assert one.write("$TIMER_STOP[7]", "FALSE")
    one.let_pass(0.1)
    assert int(one.read("$TIMER[7]")) >= 100
    assert one.write("$TIMER_STOP[7]", "TRUE")
    assert one.read("$TIMER[7]") == one.read("$TIMER[7]")


def test_the_programs_count_shows_that_it_waits(bench):
    one = bench()
    before = int(one.read("KV_BEAT"))
    one.let_pass(1.2)
    assert 99 <= int(one.read("KV_BEAT")) - before <= 103
    begin(one, 1, ELSEWHERE, 5)
    one.let_pass(0.1)
    assert one.read("KV_BEAT") == one.read("KV_BEAT")


def test_a_message_holds_the_program_until_it_is_acknowledged(bench):
    one = bench()
    begin(one, 1, ELSEWHERE, 20)
    one.let_pass(0.5)
    one.fault("varproxy.stop")
    one.let_pass(1.0)
    assert (one.read("$STOPMESS"), one.read("$PRO_STATE1"), one.read("$ROB_STOPPED")) == ("TRUE", "#P_STOP", "TRUE")
    assert one.read("KV_DONE") == "0"
    one.controller.acknowledge()
    assert one.read("KV_DONE") == "1"
    begin(one, 2)
    assert end(one, 2) == 0


def test_the_safety_chain_stops_the_robot_and_stands_as_a_message(bench):
    one = bench()
    begin(one, 1, ELSEWHERE, 20)
    one.let_pass(0.5)
    one.fault("safety.guard_open", for_ms=2000)
    one.let_pass(1.0)
    assert one.read("$STOPMESS") == "TRUE"
    assert one.read("$PERI_RDY") == "FALSE"
    assert one.scene.arm.joints() != pytest.approx(ELSEWHERE)


def test_without_the_plcs_enable_no_job_is_begun(bench):
    one = bench()
    one.kernel.at(one.kernel.now, lambda: one.scene.safety.enable_motion(False))
    begin(one, 1, ELSEWHERE)
    assert end(one, 1) == 12
    assert one.scene.arm.joints() == pytest.approx(HOME)


def test_tables_outlive_the_process_and_their_rows_are_moved_to(bench, tmp_path):
    path = tmp_path / "memory.json"
    one = bench(Memory(path))
    assert one.write("KV_TAB[2,7]", "{KV_ROW_T: C1 10000000, C2 -80500000, C3 90000000, C5 45000000}")
    assert one.write("KV_BANK[2]", '{ID[] "abc", SUM[] "01234567", ROWS 7, TAKEN 7}')
    assert one.write("KV_ROLES", "210")
    again = bench(Memory(path))
    assert again.read("KV_ROLES") == "210"
    assert again.read("KV_BANK[2].ID[]") == '"abc"'
    assert again.read("$STOPMESS") == "FALSE"
    begin(again, 1, row=7)
    assert end(again, 1) == 0
    assert again.scene.arm.joints() == pytest.approx((10.0, -80.5, 90.0, 0.0, 45.0, 0.0))
    begin(again, 2, row=8)
    assert end(again, 2) == 42

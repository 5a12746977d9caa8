"""The line's behaviour against requests and replies written by hand: identity, errors, time on the line, abort."""

import pytest

from sims.geocom._protocol import crc16

MS, S = 1_000_000, 1_000_000_000


@pytest.fixture
def line(bench):
    return bench()


def test_the_instrument_says_that_it_is_simulated(line):
    assert line.say("%R1Q,5004,1:\r\n") == ['%R1P,0,1:0,"SIM-TDRA6000"']
    assert line.say("%R1Q,5003,2:\r\n") == ["%R1P,0,2:0,900001"]
    assert line.say("%R1Q,110,3:\r\n") == ["%R1P,0,3:0,4,20,0"]


def test_its_board_is_warmer_than_the_air_and_its_supply_is_full(line):
    air_c = line.station.instrument.sight.air_c()
    assert line.ask(5011) == (0, [pytest.approx(air_c + 9.5)])
    assert line.ask(5039) == (0, [95, 1, 1])


def test_a_request_without_transaction_is_answered_with_0(line):
    assert line.say("%R1Q,0:\r\n%R1Q,1:\r\n") == ["%R1P,0,0:0"] * 2


def test_a_blank_line_is_ignored_and_a_leading_line_feed_clears_what_has_begun(line):
    assert line.say("\r\n\n\r\n") == []
    assert line.say("%R1Q,50\n%R1Q,0,4:\r\n") == ["%R1P,0,4:0"]


def test_a_checked_request_gets_a_checked_reply(line):
    check = crc16(b"%R1Q,0,8:")
    assert line.say(f"%R1Q,0,8,{check}:\r\n") == [f"%R1P,0,8,{crc16(b'%R1P,0,8:0')}:0"]
    assert line.say(f"%R1Q,0,8,{check ^ 1}:\r\n") == [f"%R1P,3101,0,{crc16(b'%R1P,3101,0:0')}:0"]


@pytest.mark.parametrize(
    ("request_line", "reply"),
    [
        ("%R1Q,4242,5:", "%R1P,3081,5:0"),  # no such procedure
        ("hello", "%R1P,3078,0:0"),
        ("%R1Q,2008,5:1", "%R1P,0,5:2"),  # too few parameters
        ("%R1Q,2008,5:1,1,1", "%R1P,0,5:2"),
        ("%R1Q,2008,5:1,x", "%R1P,0,5:2"),
        ("%R1Q,17008,5:77", "%R1P,0,5:2"),  # no such prism
        ("%R1Q,9027,5:nan,1.5,0,0,0", "%R1P,0,5:2"),
    ],
)
def test_what_cannot_be_done_is_refused_with_its_code(line, request_line, reply):
    assert line.say(request_line + "\r\n") == [reply]


def test_whole_numbers_may_be_hexadecimal(line):
    assert line.say("%R1Q,17008,1:0xC\r\n%R1Q,17009,2:\r\n") == ["%R1P,0,1:0", "%R1P,0,2:0,12"]


def test_a_request_longer_than_the_buffer_is_discarded_and_reported(line):
    assert line.say("%R1Q,0,1:" + "x" * 600 + "\r\n") == ["%R1P,3100,0:0"]
    assert line.say("%R1Q,0,2:\r\n") == ["%R1P,0,2:0"]


def test_requests_that_come_during_work_wait_their_turn_until_the_buffer_is_full(line):
    turn = "%R1Q,9027,1:3.0,1.5,0,0,0\r\n"
    many = "".join(f"%R1Q,0,{number}:\r\n" for number in range(2, 62))
    replies = line.say(turn + many)
    done = [one for one in replies if one.startswith("%R1P,0,")]
    lost = [one for one in replies if one.startswith("%R1P,3100,")]
    assert len(done) + len(lost) == 61
    assert len(lost) > 5
    assert [one.split(",")[2].split(":")[0] for one in done] == [str(number) for number in range(1, len(done) + 1)]


def test_a_line_feed_forgets_the_requests_that_wait_but_not_the_running_one(line):
    replies = line.say("%R1Q,9027,1:1.0,1.5,0,0,0\r\n%R1Q,0,2:\r\n\n%R1Q,0,3:\r\n")
    assert replies == ["%R1P,0,1:0", "%R1P,0,3:0"]


def test_c_breaks_off_a_movement_and_is_answered_by_a_question_mark_alone(line):
    line.say("%R1Q,9027,1:3.0,1.5,0,0,0\r\n", 1 * S)
    assert line.say("c") == ["?"]
    code, (hz, _, *_) = line.ask(2107, 1)
    assert code == 0
    assert 0.5 < hz < 1.0  # a second at 45 deg/s
    assert line.say("c\r\n") == ["?"]  # nothing to break off, and the blank line is ignored


def test_it_says_nothing_on_its_own(bench, line):
    assert line.say("", 600 * S) == []


def test_characters_take_their_time_on_the_line(bench):
    slow = bench(baud=9_600)
    slow.station.feed(b"%R1Q,0,1:\r\n")
    slow.wait(1 * S)
    on_the_line = (len("%R1Q,0,1:\r\n") + len("%R1P,0,1:0\r\n")) * 10 * S // 9_600
    assert slow.times[0] == pytest.approx(on_the_line + 4 * MS, abs=10)


def test_doubles_have_the_number_of_decimals_that_is_set(line):
    line.set(107, 3)
    assert line.ask(108) == (0, [3])
    assert line.say("%R1Q,2029,9:\r\n") == ["%R1P,0,9:0,0.658,1013.250,12.000,8.200"]


@pytest.mark.parametrize(("mode", "com"), [(0, 3109), (1, 3108)])
def test_off_or_asleep_it_refuses_until_it_is_switched_on(line, mode, com):
    line.set(112, mode)
    assert line.say("%R1Q,5004,1:\r\n") == [f"%R1P,{com},1:0"]
    taken, answer = line.timed(111, 1)
    assert (answer, round(taken)) == ((0, []), 3)
    assert line.ask(5004)[0] == 0


def test_each_fault_of_the_line_shows_on_the_line(bench):
    line = bench()
    line.fault(fault="tracker.doubled", for_ms=100)
    assert line.say("%R1Q,0,1:\r\n") == ["%R1P,0,1:0"] * 2
    line.fault(fault="tracker.missing", for_ms=100)
    assert line.say("%R1Q,0,2:\r\n") == []
    line.fault(fault="tracker.late", by_ms=5000, for_ms=100)
    before = line.kernel.now
    assert line.say("%R1Q,0,3:\r\n") == ["%R1P,0,3:0"]
    assert (line.times[-1] - before) * 1e-9 == pytest.approx(5.0, abs=0.05)
    line.fault(fault="tracker.garbled", every=2, for_ms=100)
    right, wrong = line.say("%R1Q,0,4:\r\n%R1Q,0,4:\r\n", 1 * S)
    assert right == "%R1P,0,4:0"
    assert sum(a != b for a, b in zip(wrong, right, strict=True)) == 1


@pytest.mark.parametrize(("rpc", "code"), [(2107, 1293), (6021, 1793), (9013, 13), (17009, 13), (17017, 786)])
def test_a_busy_instrument_says_so_by_subsystem_and_still_identifies_itself(line, rpc, code):
    line.fault(fault="tracker.busy", for_ms=1000)
    assert line.ask(rpc, *([1] if rpc in (2107, 17017) else [])) == (code, [])
    assert line.ask(5003)[0] == 0


def test_sleep_comes_as_a_fault_too(line):
    line.fault(fault="tracker.sleep")
    assert line.say("%R1Q,5003,1:\r\n") == ["%R1P,3108,1:0"]


def test_settings_read_as_they_were_set(line):
    for write, read, values in [
        (17008, 17009, [4]),
        (17019, 17018, [1]),
        (17021, 17022, [0]),
        (2020, 2021, [2]),
        (2024, 2023, [-0.0038]),
        (2028, 2029, [0.658, 998.0, 23.5, 16.0]),
        (2006, 2007, [0]),
        (2010, 2009, [1.0, 2.0, 3.0, 0.24]),
        (2148, 2151, [12.5]),
        (2153, 2154, [0, 1.0, 0.0, 0.0, 7.0]),
        (9007, 9008, [0.001, 0.002]),
        (9011, 9012, [6.0, 7.0]),
        (9041, 9040, [0.05, 0.06]),
        (9043, 9042, [0.1, 1.4, 0.3, 0.2, 1]),
        (18005, 18006, [1]),
        (18007, 18008, [1]),
        (9018, 9019, [0]),
        (9020, 9021, [1]),
    ]:
        line.set(write, *values)
        assert line.ask(read) == (0, pytest.approx(values)), write


def test_a_user_prism_is_defined_by_name_and_number(line):
    line.set(17024, 5, '"SMR 1.5"', -0.0038, 1)
    assert line.ask(17023, 5) == (0, ["SMR 1.5", -0.0038, 1])
    line.set(17032, '"glass"', 0.0112, 1, '"me"')
    assert line.ask(17033, '"glass"') == (0, [0.0112, 1, "me"])
    line.set(17008, 9)
    assert line.ask(2023) == (0, [0.0112])
    assert line.ask(17033, '"unknown"') == (2, [])
    assert line.ask(17024, 0, '"round"', 0.0, 1) == (2, [])


def test_a_program_sets_the_distance_meters_mode(line):
    line.set(17019, 11)
    assert line.ask(2021) == (0, [13])

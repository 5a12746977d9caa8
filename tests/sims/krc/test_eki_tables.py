"""Compensation tables on the transfer channel, byte for byte, against docs/reference/eki-channel.md."""

from __future__ import annotations

import binascii
import re

import pytest

HOME = (0.0, -90.0, 90.0, 0.0, 45.0, 0.0)


def rows(count, shift=0.0123456):
    """Nominal and compensated joints, as texts: six decimals, what the channel carries."""
    nominal = [[f"{n / 10:.6f}", "-90.000000", "90.000000", "0.000000", "45.000000", "-0.000000"] for n in range(count)]
    return [(q, [f"{float(a) + shift:.6f}" for a in q]) for q in nominal]


def lines(table, first=1):
    return "".join(f"{n};{';'.join(q)};{';'.join(c)}\n" for n, (q, c) in enumerate(table, first))


def crc(text):
    return f"{binascii.crc32(text.encode()) & 0xFFFFFFFF:08X}"


def axes(values):
    return " ".join(f'A{i}="{value}"' for i, value in enumerate(values, 1))


def block(table, first=1, total=None):
    body = "".join(f'<R N="{n}"><Q {axes(q)}/><C {axes(c)}/></R>' for n, (q, c) in enumerate(table, first))
    return f'<Block First="{first}" Count="{len(table)}" Sum="{total or crc(lines(table, first))}"/>{body}'


def serial_of(pc):
    return re.search(r'Serial="([^"]*)"', pc.command("HELLO")[3])[1]


def stage(pc, table, table_id="ab12", **attributes):
    told = {"Id": table_id, "Serial": serial_of(pc), "Rows": len(table), "Sum": crc(lines(table)), **attributes}
    return pc.command("TSTAGE", 20, "<Table " + " ".join(f'{key}="{value}"' for key, value in told.items()) + "/>")


def blocks(pc, table):
    for first in range(0, len(table), 10):
        reply = pc.command("TBLOCK", 21 + first, block(table[first : first + 10], first + 1))
        assert reply[:2] == (str(21 + first), 0)


def activate(pc, table, table_id="ab12"):
    return pc.command("TACTIVATE", 40, f'<Table Id="{table_id}" Sum="{crc(lines(table))}"/>')


def push(pc, table, table_id="ab12"):
    assert stage(pc, table, table_id)[1] == 0
    blocks(pc, table)
    assert activate(pc, table, table_id)[1] == 0


def state(pc):
    """Name → attributes of each table the controller tells of."""
    text = pc.command("TSTATE", 42)[3]
    return {
        name: dict(re.findall(r'(\w+)="([^"]*)"', inner))
        for name, inner in re.findall(r"<(Active|Previous|Staged) ([^>]*)/>", text)
    }


def read(pc, first, count):
    return pc.command("TREAD", 31, f'<Block First="{first}" Count="{count}"/>')


def test_a_table_goes_in_in_blocks_reads_back_as_it_was_and_is_active_only_when_told_so(bench):
    pc, table = bench(), rows(25)
    assert stage(pc, table)[1] == 0
    assert state(pc) == {"Staged": {"Id": "ab12", "Rows": "25", "Taken": "0"}}
    blocks(pc, table)
    assert state(pc) == {"Staged": {"Id": "ab12", "Rows": "25", "Taken": "25"}}
    assert block(table[20:25], 21) in read(pc, 21, 5)[3]
    assert pc.command("PTPT", 50, '<Vel P="50.0"/><Row N="1"/>')[1] == 42
    assert activate(pc, table)[1] == 0
    assert state(pc) == {"Active": {"Id": "ab12", "Rows": "25", "Sum": crc(lines(table))}}
    assert block(table[:10]) in read(pc, 1, 10)[3]


def test_the_reply_to_a_read_is_written_as_the_document_shows_it(bench):
    pc = bench()
    push(pc, rows(1))
    expected = (  # the sum as gzip makes it of the row's line
        '<Rep Id="31" Code="0" Text=""><Block First="1" Count="1" Sum="785D7451"/><R N="1">'
        '<Q A1="0.000000" A2="-90.000000" A3="90.000000" A4="0.000000" A5="45.000000" A6="-0.000000"/>'
        '<C A1="0.012346" A2="-89.987654" A3="90.012346" A4="0.012346" A5="45.012346" A6="0.012346"/></R>'
        '<Q A1="0.0000" A2="-90.0000" A3="90.0000" A4="0.0000" A5="45.0000" A6="0.0000"/></Rep>'
    )
    assert read(pc, 1, 1)[3] == expected


def test_a_row_is_where_the_robot_goes(bench):
    pc, table = bench(), rows(3)
    push(pc, table)
    number, code, joints, _ = pc.command("PTPT", 50, '<Vel P="50.0"/><Row N="3"/>')
    assert (number, code) == ("50", 0)
    assert joints == pytest.approx([float(angle) for angle in table[2][1]], abs=5e-5)


@pytest.mark.parametrize(
    ("inner", "code"),
    [
        ('<Vel P="50.0"/><Row N="4"/>', 42),
        ('<Vel P="50.0"/><Row N="0"/>', 42),
        ('<Vel P="50.0"/><Row N="-1"/>', 42),
        ('<Vel P="0.0"/><Row N="1"/>', 21),
        ('<Vel P="50.0"/><Row N="2"/>', 20),
        ('<Vel P="50.0"/><Row N="1.0"/>', 11),
        ('<Vel P="50.0"/>', 11),
    ],
)
def test_a_row_that_cannot_be_gone_to_is_refused_and_nothing_moves(bench, inner, code):
    pc, table = bench(), rows(3)
    table[1] = (table[1][0], ["0.000000", "66.000000", "90.000000", "0.000000", "45.000000", "0.000000"])
    push(pc, table)
    assert pc.command("PTPT", 50, inner)[:3] == ("50", code, HOME)


def test_a_table_for_another_controller_is_refused(bench):
    pc = bench()
    assert stage(pc, rows(3), Serial="KRC-1")[1] == 40
    assert state(pc) == {}


@pytest.mark.parametrize(("count", "code"), [(0, 43), (-1, 43), (1, 0), (500, 0), (501, 43), ("many", 11)])
def test_a_table_has_1_to_500_rows(bench, count, code):
    assert stage(bench(), rows(1), Rows=count)[1] == code


def test_what_cannot_be_staged_leaves_what_is_staged(bench):
    pc, table = bench(), rows(3)
    stage(pc, table)
    blocks(pc, table)
    assert stage(pc, table, Serial="KRC-1")[1] == 40
    assert stage(pc, table, Rows=0)[1] == 43
    assert activate(pc, table)[1] == 0


def test_staging_anew_forgets_what_was_staged(bench):
    pc, table = bench(), rows(12)
    stage(pc, table)
    blocks(pc, table)
    stage(pc, table)
    assert state(pc)["Staged"]["Taken"] == "0"


def test_a_block_whose_sum_does_not_fit_is_not_taken(bench):
    pc, table = bench(), rows(3)
    stage(pc, table)
    assert pc.command("TBLOCK", 21, block(table, total="00000000"))[1] == 41
    assert pc.command("TBLOCK", 21, block(table, total=crc(lines(table)).lower().replace("0", "o")))[1] == 41
    assert state(pc)["Staged"]["Taken"] == "0"


def test_blocks_come_in_order_and_one_that_is_there_counts_as_taken(bench):
    pc, table = bench(), rows(25)
    stage(pc, table)
    send = lambda part, first: pc.command("TBLOCK", 21, block(part, first))[1]  # noqa: E731
    assert send(table[10:20], 11) == 42
    assert send(table[:10], 1) == 0
    assert send(table[:10], 1) == 0
    assert send(table[3:7], 4) == 0
    assert send(rows(10, shift=0.02), 1) == 42
    assert send(table[5:15], 6) == 42
    assert send(table[:10], 0) == 42
    assert send(table[10:20], 11) == 0
    assert send([*table[20:25], *rows(1)], 21) == 42  # one more than announced
    assert state(pc)["Staged"]["Taken"] == "20"


def test_rows_that_do_not_run_on_are_out_of_order(bench):
    pc, table = bench(), rows(2)
    stage(pc, table)
    swapped = block(table).replace('<R N="2">', '<R N="3">')
    assert pc.command("TBLOCK", 21, swapped)[1] == 42


def test_a_block_without_a_staged_table_is_refused(bench):
    pc = bench()
    assert pc.command("TBLOCK", 21, block(rows(2)))[1] == 42
    push(pc, rows(2))
    assert pc.command("TBLOCK", 21, block(rows(2)))[1] == 42


@pytest.mark.parametrize(
    "inner",
    [
        "",
        block(rows(11)),
        block(rows(2)).replace('Count="2"', 'Count="3"'),
        block(rows(2)).replace("<C ", "<D "),
        block(rows(2)).replace('A6="-0.000000"', 'A6="inf"'),
        block([]),
    ],
)
def test_a_block_that_cannot_be_read_is_answered_11(bench, inner):
    pc = bench()
    stage(pc, rows(11))
    assert pc.command("TBLOCK", 21, inner)[:2] == ("21", 11)
    assert state(pc)["Staged"]["Taken"] == "0"


def test_a_block_of_ten_rows_fits_however_wide_they_are_written(bench):
    pc = bench()
    table = [(["-123.456789"] * 6, ["-123.456789"] * 6) for _ in range(10)]
    stage(pc, table)
    spread = block(table).replace("><", ">\n" + " " * 60 + "<")
    assert len(spread) > 4096
    assert pc.command("TBLOCK", 21, spread)[1] == 0


@pytest.mark.parametrize(("first", "count", "code"), [(1, 10, 0), (16, 10, 0), (17, 10, 42), (0, 5, 42), (1, 11, 11)])
def test_only_rows_that_are_there_are_read_back(bench, first, count, code):
    pc = bench()
    push(pc, rows(25))
    assert read(pc, first, count)[1] == code


def test_without_any_table_there_is_nothing_to_read_or_roll_back(bench):
    pc = bench()
    assert read(pc, 1, 1)[1] == 42
    assert pc.command("TROLLBACK")[1] == 42
    assert activate(pc, rows(1))[1] == 42
    assert state(pc) == {}


def test_an_incomplete_table_does_not_become_active(bench):
    pc, table = bench(), rows(25)
    push(pc, rows(2), "old")
    stage(pc, table)
    pc.command("TBLOCK", 21, block(table[:10]))
    assert activate(pc, table)[1] == 42
    assert state(pc)["Active"]["Id"] == "old"


def test_activation_checks_id_and_sum_of_the_whole(bench):
    pc, table = bench(), rows(5)
    push(pc, rows(2), "old")
    stage(pc, table)
    blocks(pc, table)
    assert activate(pc, table, "other")[1] == 41
    assert activate(pc, rows(4))[1] == 41
    stage(pc, table, Sum=crc("another table"))
    blocks(pc, table)
    assert pc.command("TACTIVATE", 40, f'<Table Id="ab12" Sum="{crc("another table")}"/>')[1] == 41
    assert state(pc)["Active"]["Id"] == "old"


def test_activating_again_is_done_already_and_keeps_the_table_before_it(bench):
    pc, table = bench(), rows(5)
    push(pc, rows(2), "old")
    push(pc, table)
    assert activate(pc, table)[1] == 0
    push(pc, table)  # the whole push once more, as after a lost answer
    assert {name: one["Id"] for name, one in state(pc).items()} == {"Active": "ab12", "Previous": "old"}
    assert activate(pc, rows(4))[1] == 41


def test_rollback_changes_active_and_previous_and_back(bench):
    pc = bench()
    push(pc, rows(2), "one")
    assert pc.command("TROLLBACK")[1] == 0
    assert {name: one["Id"] for name, one in state(pc).items()} == {"Previous": "one"}
    assert pc.command("PTPT", 50, '<Vel P="50.0"/><Row N="1"/>')[1] == 42
    assert pc.command("TROLLBACK")[1] == 0
    push(pc, rows(3), "two")
    assert pc.command("TROLLBACK")[1] == 0
    assert {name: one["Id"] for name, one in state(pc).items()} == {"Active": "one", "Previous": "two"}


def test_tables_are_not_touched_while_something_moves_but_asked_for(bench):
    pc, table = bench(), rows(2)
    push(pc, table)
    pc.put('<Cmd Id="50" Op="PTP"><Vel P="0.1"/><Q A1="90" A2="-90" A3="90" A4="0" A5="45" A6="0"/></Cmd>')
    pc.state(['Prog="MOVING"'])
    bodies = {"TBLOCK": block(table), "TREAD": '<Block First="1" Count="1"/>', "TROLLBACK": ""}
    assert [pc.command(op, 60, inner)[1] for op, inner in bodies.items()] == [10, 10, 10]
    assert stage(pc, table)[1] == 10
    assert activate(pc, table)[1] == 10
    assert state(pc)["Active"]["Id"] == "ab12"
    assert pc.command("HALT", 70)[:2] == ("50", 30)
    assert pc.reply()[:2] == ("70", 0)


def test_a_lost_connection_takes_no_table_away(bench):
    pc, table = bench(), rows(12)
    push(pc, rows(2), "old")
    stage(pc, table)
    pc.command("TBLOCK", 21, block(table[:10]))
    pc.tcp.close()
    pc.connect()
    assert pc.command("TBLOCK", 22, block(table[10:], 11))[1] == 0
    assert state(pc)["Active"]["Id"] == "old"
    assert activate(pc, table)[1] == 0

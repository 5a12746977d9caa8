"""`python -m sims run --state`: kill -9 at any moment, and the next process goes on from there."""

from __future__ import annotations

import json
import re
import select
import socket
import subprocess
import sys
import zlib
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from urllib.parse import parse_qs, urlsplit

import pytest

PATIENCE_S = 90
HOME = ["0.0000", "-90.0000", "90.0000", "0.0000", "45.0000", "0.0000"]


class Pc:
    """A simulated cell in a process of its own, and the PC on its transfer channel."""

    def __init__(self, root, *arguments):
        command = [sys.executable, "-m", "sims", "run", "procedures/cells/sphere_cell.yaml", *map(str, arguments)]
        self.process = subprocess.Popen(command, cwd=root, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert select.select([self.process.stdout], [], [], PATIENCE_S)[0], "the simulator does not get ready"
        ready = json.loads(self.process.stdout.readline())
        host, port = parse_qs(urlsplit(ready["robot"]).query)["eki"][0].split(":")
        self.line = socket.create_connection((host, int(port)), PATIENCE_S)
        self.stream = ""

    def put(self, op, inner="", number=1):
        self.line.sendall(f'<Cmd Id="{number}" Op="{op}">{inner}</Cmd>'.encode())

    def document(self, kind):
        while not (found := re.search(rf"<{kind} .*?</{kind}>", self.stream)):
            data = self.line.recv(65536)
            assert data, "the controller hung up"
            self.stream += data.decode()
        self.stream = self.stream[found.end() :]
        return found.group()

    def rest(self, kind):
        """The documents that had come until the end, not read yet."""
        with suppress(ConnectionResetError):
            while data := self.line.recv(65536):
                self.stream += data.decode()
        return re.findall(rf"<{kind} .*?</{kind}>", self.stream)

    def ask(self, op, inner=""):
        self.put(op, inner)
        reply = self.document("Rep")
        assert 'Code="0"' in reply, reply
        return reply

    def kill(self):
        self.process.kill()
        self.process.communicate(timeout=PATIENCE_S)

    def close(self):
        self.line.close()
        self.process.terminate()
        self.process.communicate(timeout=PATIENCE_S)


@pytest.fixture
def start(request, tmp_path):
    """Starts the cell with the state file `state.json`."""
    started = []

    def begin(*arguments):
        started.append(Pc(request.config.rootpath, "--state", tmp_path / "state.json", *arguments))
        return started[-1]

    yield begin
    for pc in started:
        pc.close()


def joints(document):
    return re.findall(r'A\d="([^"]*)"', document)[-6:]


def axes(values):
    return " ".join(f'A{i}="{value}"' for i, value in enumerate(values, 1))


def move(pc, a1, percent):
    pc.put("PTP", f'<Vel P="{percent}"/><Q {axes([a1, *HOME[1:]])}/>')


def test_killed_in_mid_move_it_stands_somewhere_on_the_way(start):
    pc = start("--clock", "realtime")
    move(pc, "90.0", "5.0")
    while float(joints(seen := pc.document("Stat"))[0]) < 6.0:  # the first second, with its two savings, is over
        assert 'Prog="MOVING"' in seen or 'A1="0.0000"' in seen
    pc.kill()
    *_, seen = seen, *pc.rest("Stat")
    back = start("--clock", "realtime")
    held = joints(back.ask("HELLO"))
    assert 0.0 < float(held[0]) <= float(joints(seen)[0]) + 2.0
    assert held[1:] == HOME[1:]
    assert 'Prog="READY"' in back.document("Stat")
    assert joints(back.ask("HELLO")) == held


def test_killed_after_an_arrival_was_reported_it_stands_there(start):
    pc = start()
    move(pc, "30.0", "100.0")
    assert 'Code="0"' in pc.document("Rep")
    pc.kill()
    assert joints(start().ask("HELLO")) == ["30.0000", *HOME[1:]]


def test_killed_after_an_activation_was_answered_the_table_is_active(start):
    pc = start()
    row = ["1.500000", "-90.000000", "90.000000", "0.000000", "45.000000", "0.000000"]
    total = f"{zlib.crc32((';'.join(['1', *row, *row]) + chr(10)).encode()):08X}"
    serial = re.search(r'Serial="([^"]*)"', pc.ask("HELLO"))[1]
    pc.ask("TSTAGE", f'<Table Id="ab" Serial="{serial}" Rows="1" Sum="{total}"/>')
    pc.ask("TBLOCK", f'<Block First="1" Count="1" Sum="{total}"/><R N="1"><Q {axes(row)}/><C {axes(row)}/></R>')
    pc.ask("TACTIVATE", f'<Table Id="ab" Sum="{total}"/>')
    pc.ask("TSTAGE", f'<Table Id="cd" Serial="{serial}" Rows="1" Sum="{total}"/>')
    pc.kill()
    back = start()
    state = back.ask("TSTATE")
    assert f'<Active Id="ab" Rows="1" Sum="{total}"/>' in state
    assert "Staged" not in state
    assert joints(back.ask("PTPT", '<Vel P="100.0"/><Row N="1"/>'))[0] == "1.5000"


def test_ended_well_in_mid_move_it_stands_where_it_was_then(start):
    pc = start("--clock", "realtime")
    move(pc, "90.0", "5.0")
    while float(joints(seen := pc.document("Stat"))[0]) < 1.0:
        pass
    pc.process.terminate()
    pc.process.communicate(timeout=PATIENCE_S)
    held = float(joints(start().ask("HELLO"))[0])
    assert float(joints(seen)[0]) <= held < 90.0


def test_the_one_that_comes_next_waits_for_the_one_that_is_ending(start, tmp_path):
    pc = start("--clock", "realtime")
    with ThreadPoolExecutor() as pool:
        following = pool.submit(start)
        move(pc, "30.0", "100.0")
        assert 'Code="0"' in pc.document("Rep")
        pc.process.terminate()
        pc.process.communicate(timeout=PATIENCE_S)
        assert joints(following.result(PATIENCE_S).ask("HELLO")) == ["30.0000", *HOME[1:]]


@pytest.mark.long
def test_two_processes_do_not_share_a_memory(start, request, tmp_path):
    start()
    assert "in use" in refusal(request, str(tmp_path / "state.json"))


def refusal(request, state, *arguments):
    done = subprocess.run(
        [sys.executable, "-m", "sims", "run", "procedures/cells/sphere_cell.yaml", "--state", state, *arguments],
        cwd=request.config.rootpath, capture_output=True, text=True, timeout=PATIENCE_S, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    return done.stderr


def test_the_memory_of_another_robot_is_refused_and_left_alone(start, request, tmp_path):
    start().kill()
    before = (tmp_path / "state.json").read_text()
    told = refusal(request, str(tmp_path / "state.json"), "--seed", "7")
    assert "seed 1" in told
    assert "seed 7" in told
    assert (tmp_path / "state.json").read_text() == before


@pytest.mark.parametrize("content", ["", "{", "[]", "{}", '{"cell": 1}', "\x00"])
def test_a_file_that_is_no_memory_is_refused(request, tmp_path, content):
    (tmp_path / "state.json").write_text(content)
    assert "state.json" in refusal(request, str(tmp_path / "state.json"))


def test_a_place_that_cannot_be_written_is_reported_at_the_start(request, tmp_path):
    assert "nowhere" in refusal(request, str(tmp_path / "nowhere" / "state.json"))

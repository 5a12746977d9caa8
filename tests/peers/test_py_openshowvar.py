"""py_openshowvar, which knows nothing of cellctl, completes a session against the simulated proxy."""

from __future__ import annotations

import json
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest

from drivers.kuka_varproxy.line import Kind, request, text_field

ROOT = Path(__file__).parents[2]
PATIENCE_S = 60.0

py_openshowvar = pytest.importorskip("py_openshowvar", reason="needs the group 'peers'")


@contextmanager
def session(proxy: str, folder: Path):
    cell = folder / "cell.yaml"
    cell.write_text(
        f"name: proxy cell\nmodel: {ROOT}/procedures/robots/kr5_r1400.yaml\n"
        "devices: {robot: 'kuka+varproxy://172.31.1.147:7000'}\n"
        f"simulate: {{clock: realtime, seed: 4, varproxy: {{proxy: {proxy}}}}}\n"
    )
    command = [sys.executable, "-P", "-m", "sims", "run", str(cell)]
    simulators = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        port = int(json.loads(simulators.stdout.readline())["robot"].rpartition(":")[2])
        client = py_openshowvar.openshowvar("127.0.0.1", port)
        client.sock.settimeout(PATIENCE_S)
        try:
            yield client
        finally:
            client.close()
    finally:
        simulators.terminate()
        simulators.wait(PATIENCE_S)
        simulators.stdout.close()


@pytest.mark.realtime
@pytest.mark.parametrize("proxy", ["c3_bridge", "kukavarproxy"])
def test_a_session_reads_writes_and_reads_back(proxy, tmp_path):
    with session(proxy, tmp_path) as client:
        assert client.can_connect
        assert client.read("$KR_SERIALNO", debug=False).startswith(b'"SIM-')
        assert client.read("$AXIS_ACT", debug=False).startswith(b"{E6AXIS: A1 0.0")
        assert client.write("$FLAG[12]", "TRUE", debug=False) == b"TRUE"
        assert client.read("$FLAG[12]", debug=False) == b"TRUE"
        row = "{KV_ROW_T: " + ", ".join(f"{name}{axis} -123456789" for name in "NC" for axis in range(1, 7)) + "}"
        assert client.write("KV_TAB[3,500]", row, debug=False)
        assert client.read("KV_TAB[3,500]", debug=False) == row.encode()
        unknown = client.read("$NOBODY", debug=False)
        assert unknown == (b"" if proxy == "kukavarproxy" else None)  # which KUKAVARPROXY calls a success
        assert client.write("$MODE_OP", "#T1", debug=False) is None


def test_the_driver_sends_the_bytes_that_the_foreign_client_sends():
    client = py_openshowvar.openshowvar.__new__(py_openshowvar.openshowvar)
    client.msg_id, client.varname, client.value = 77, b"KV_GO", b"12"
    assert client._pack_read_req() == request(77, Kind.READ, text_field("KV_GO"))
    assert client._pack_write_req() == request(77, Kind.WRITE, text_field("KV_GO") + text_field("12"))

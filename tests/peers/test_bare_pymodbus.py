"""A bare pymodbus client, which knows nothing of cellctl, completes a session against the simulated PLC."""

from __future__ import annotations

import json
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest
from pymodbus.client import ModbusTcpClient

ROOT = Path(__file__).parents[2]
PATIENCE_S = 60.0

CELL = """name: plc cell
model: {root}/procedures/robots/kr5_r1400.yaml
devices: {{plc: "modbus+tcp://192.168.10.5:502?unit=3"}}
simulate: {{clock: realtime, seed: 4}}
"""

pytestmark = pytest.mark.realtime


@contextmanager
def session(folder: Path):
    cell = folder / "cell.yaml"
    cell.write_text(CELL.format(root=ROOT))
    command = [sys.executable, "-P", "-m", "sims", "run", str(cell)]
    simulators = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        address = json.loads(simulators.stdout.readline())["plc"]
        port = int(address.partition("?")[0].rpartition(":")[2])
        with ModbusTcpClient("127.0.0.1", port=port, timeout=PATIENCE_S) as client:
            yield client
    finally:
        simulators.terminate()
        simulators.wait(PATIENCE_S)
        simulators.stdout.close()


def test_a_session_reads_writes_and_is_refused_as_the_map_says(tmp_path):
    with session(tmp_path) as client:
        inputs = client.read_discrete_inputs(0, count=14, device_id=3).bits
        assert inputs[:2] == [True, True]
        assert inputs[5:7] == [True, False]

        registers = client.read_input_registers(0, count=11, device_id=3).registers
        temperatures = client.convert_from_registers(registers[:4], client.DATATYPE.INT16)
        assert all(-40.0 < value / 10 < 60.0 for value in temperatures)
        uptime = client.convert_from_registers(registers[8:10], client.DATATYPE.UINT32, word_order="big")
        assert 0 < uptime < 20_000_000

        assert not client.write_coil(4, True, device_id=3).isError()
        assert not client.write_coils(5, [True, True], device_id=3).isError()
        assert client.read_coils(0, count=9, device_id=3).bits[:9] == [False] * 4 + [True] * 3 + [False] * 2
        assert not client.write_register(1, 17, device_id=3).isError()
        assert not client.write_registers(2, [9, 2000], device_id=3).isError()
        assert client.read_holding_registers(0, count=4, device_id=3).registers == [0, 17, 9, 2000]

        information = client.read_device_information(read_code=1, device_id=3).information
        assert information[1].startswith(b"SIM-")

        assert client.read_input_registers(11, count=1, device_id=3).exception_code == 2
        assert client.write_coils(1, [True, True], device_id=3).exception_code == 3
        assert client.read_coils(0, count=1, device_id=4).exception_code == 0x0B


def test_a_client_that_stops_its_heartbeat_sees_the_drives_go_off(tmp_path):
    with session(tmp_path) as client:
        client.write_register(3, 200, device_id=3)
        client.write_register(0, 1, device_id=3)
        assert client.read_discrete_inputs(8, count=1, device_id=3).bits[0]
        for _ in range(60):  # each answer takes 5 to 20 ms
            drives = client.read_discrete_inputs(8, count=1, device_id=3).bits[0]
        assert not drives
        client.write_register(0, 2, device_id=3)
        assert client.read_discrete_inputs(8, count=1, device_id=3).bits[0]

"""Primary, secondary and real-time interface: their packages, byte by byte, and the messages of programs."""

from __future__ import annotations

import struct

import pytest

from tests.sims.ur.conftest import PRIMARY, REALTIME, SECONDARY, program


def message(begun, client):
    """Type and content of the next one."""
    (size,) = struct.unpack(">i", begun.received(client, 4))
    content = begun.received(client, size - 4)
    return content[0], content[1:]


def state(begun, client):
    """The packages of the next robot state: type → content."""
    kind, content = message(begun, client)
    while kind != 16:
        kind, content = message(begun, client)
    packages = {}
    while content:
        size, kind = struct.unpack_from(">iB", content)
        packages[kind] = content[5:size]
        content = content[size:]
    return packages


def robot_message(begun, client, wanted):
    """The next robot message of this kind: its content."""
    while True:
        kind, content = message(begun, client)
        if kind == 20 and content[9] == wanted:
            return content[10:]


@pytest.mark.parametrize("port", [PRIMARY, SECONDARY])
def test_the_version_comes_first_and_then_ten_states_a_second(bench, port):
    begun = bench()
    client = begun.call(port)
    kind, content = message(begun, client)
    assert (kind, content[9]) == (20, 3)
    assert content[10] == 9
    assert content[11:20] == b"URControl"
    assert struct.unpack_from(">BBii", content, 20) == (5, 12, 4, 0)
    stamps = [struct.unpack_from(">Q", state(begun, client)[0])[0] for _ in range(3)]
    assert stamps[2] - stamps[0] == pytest.approx(200_000, abs=1000)


@pytest.mark.parametrize(("series", "mode", "masterboard"), [("e", 47, 75), ("cb3", 46, 72)])
def test_the_packages_have_the_sizes_of_the_documents(bench, series, mode, masterboard):
    begun = bench(series=series)
    packages = state(begun, begun.call(SECONDARY))
    sizes = {kind: len(content) + 5 for kind, content in packages.items()}
    assert sizes == {0: mode, 1: 251, 2: 37, 3: masterboard, 4: 101, 5: 225}


def test_mode_joints_and_pose(bench):
    begun = bench(errors={})
    packages = state(begun, begun.call(PRIMARY))
    flags = struct.unpack_from(">7?BB", packages[0], 8)
    assert flags == (True, True, True, False, False, False, False, 7, 0)
    q, target, speed = struct.unpack_from(">3d", packages[1], 41)
    assert (q, target, speed) == (pytest.approx(-1.5707963), pytest.approx(-1.5707963), 0.0)
    pose = struct.unpack_from(">6d", packages[4])
    assert pose == pytest.approx(begun.motion.model.tcp(begun.motion.target, begun.motion.tool))


def test_the_kinematics_are_those_that_the_poses_are_made_with(bench):
    """An independent product of the rows of the package gives the controller's own TCP."""
    import numpy as np

    begun = bench(calibration_knows=1.0)
    packages = state(begun, begun.call(PRIMARY))
    theta, a, d, alpha = np.reshape(struct.unpack_from(">24d", packages[5], 24), (4, 6))
    joints = [struct.unpack_from(">d", packages[1], 41 * i)[0] for i in range(6)]
    frame = np.eye(4)
    for i in range(6):
        t = theta[i] + joints[i]
        about_z = [[np.cos(t), -np.sin(t), 0, 0], [np.sin(t), np.cos(t), 0, 0], [0, 0, 1, d[i]], [0, 0, 0, 1]]
        c, s = np.cos(alpha[i]), np.sin(alpha[i])
        frame = frame @ about_z @ [[1, 0, 0, a[i]], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]]
    assert frame[:3, 3] == pytest.approx(struct.unpack_from(">3d", packages[4]), abs=1e-9)
    assert max(abs(d)) > 1.0  # the almost parallel axes
    assert struct.unpack_from(">I", packages[5], 216) == (0,)


def test_an_arm_without_calibration_shows_the_data_sheet(bench):
    begun = bench(calibration_knows=0.0)
    content = state(begun, begun.call(PRIMARY))[5]
    d = struct.unpack_from(">6d", content, 24 + 2 * 48)
    assert d == pytest.approx((0.1807, 0, 0, 0.17415, 0.11985, 0.11655))
    assert struct.unpack_from(">I", content, 216) == (1,)


def test_programs_are_reported_with_key_text_and_exception(bench):
    begun = bench()
    client = begun.call(PRIMARY)
    client.sendall(program('textmsg("a ", 1)\nx = 1 / 0', "mine").encode())
    assert robot_message(begun, client, 7)[9:].endswith(b"PROGRAM_XXX_STARTEDmine")
    assert robot_message(begun, client, 0) == b"a 1"
    content = robot_message(begun, client, 10)
    assert (struct.unpack_from(">ii", content), content[8:]) == ((3, 0), b"Division by zero")
    assert robot_message(begun, client, 7).endswith(b"PROGRAM_XXX_STOPPEDmine")


def test_a_protective_stop_is_an_error_with_its_code_and_a_safety_mode(bench):
    begun = bench()
    client = begun.call(PRIMARY)
    begun.let_pass(0.01)
    begun.controller.protective_stop(153, 2, "text")
    content = robot_message(begun, client, 6)
    assert (struct.unpack_from(">ii", content), content[20:]) == ((153, 2), b"text")
    assert robot_message(begun, client, 5)[8] == 3


@pytest.mark.parametrize(("series", "size"), [("e", 1220), ("cb3", 1108)])
def test_the_real_time_package(bench, series, size):
    begun = bench(series=series, errors={})
    client = begun.call(REALTIME)
    values = struct.unpack(f">i{(size - 4) // 8}d", begun.received(client, size))
    again = struct.unpack(f">i{(size - 4) // 8}d", begun.received(client, size))
    assert values[0] == size
    assert again[1] - values[1] == pytest.approx(begun.controller.cycle_ns * 1e-9)
    assert values[2:8] == values[32:38] == pytest.approx(begun.motion.target)
    assert values[56:62] == pytest.approx(begun.motion.model.tcp(begun.motion.target, begun.motion.tool))
    assert (values[95], values[96], values[102]) == (7, 253, 1)
    assert values[132] == 1  # program stopped


def test_programs_are_taken_at_each_interface_in_remote_control_alone(bench):
    begun = bench()
    for number, port in enumerate((PRIMARY, SECONDARY, REALTIME)):
        begun.call(port).sendall(f"set_digital_out({number}, True)\n".encode())
        begun.let_pass(0.1)
    assert begun.board.digital_out == 7
    begun.controller.requests["by_hand"]({"action": "local control"})
    begun.call(PRIMARY).sendall(b"set_digital_out(5, True)\n")
    begun.let_pass(0.1)
    assert begun.board.digital_out == 7

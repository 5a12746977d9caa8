"""A session of ur_rtde with a controller: `python ur_rtde_session.py control|receive HOST`; prints what it found."""

from __future__ import annotations

import json
import sys
import threading
import time

from dashboard_client import DashboardClient
from rtde_control import RTDEControlInterface
from rtde_io import RTDEIOInterface
from rtde_receive import RTDEReceiveInterface

PATIENCE_S = 120.0


def until(done):
    end = time.monotonic() + PATIENCE_S
    while not done():
        if time.monotonic() > end:
            raise TimeoutError
        threading.Event().wait(0.05)


def control(host):
    receive, dashboard = RTDEReceiveInterface(host, 125.0), DashboardClient(host)
    dashboard.connect()
    robot = RTDEControlInterface(host, 125.0)
    goal = list(receive.getTargetQ())
    goal[0] += 0.2
    goal[5] -= 0.1
    assert robot.moveJ(goal, 1.0, 2.0)
    until(robot.isSteady)
    moved, pose = receive.getActualQ(), receive.getActualTCPPose()
    forward = robot.getForwardKinematics()
    inverse = robot.getInverseKinematics(pose)
    line_goal = list(pose)
    line_goal[2] += 0.03
    assert robot.moveL(line_goal, 0.2, 1.0)
    until(robot.isSteady)
    line = receive.getActualTCPPose()
    assert robot.speedL([0, 0, -0.02, 0, 0, 0], 0.5)
    until(lambda: abs(receive.getTargetTCPSpeed()[2] + 0.02) < 1e-4)
    speed = receive.getTargetTCPSpeed()
    robot.speedStop()
    until(robot.isSteady)
    robot.setPayload(1.5, [0.0, 0.0, 0.1])
    inputs = RTDEIOInterface(host)
    inputs.setStandardDigitalOut(3, True)
    inputs.setSpeedSlider(0.5)
    until(lambda: receive.getDigitalOutState(3) and receive.getTargetSpeedFraction() == 0.5)
    found = {
        "goal": goal,
        "moved": moved,
        "pose": pose,
        "forward": forward,
        "inverse": inverse,
        "line": line,
        "line_goal": line_goal,
        "speed": speed,
        "stopped": receive.getTargetTCPSpeed(),
        "output": receive.getDigitalOutState(3),
        "slider": receive.getTargetSpeedFraction(),
        "payload": receive.getPayload(),
    }
    robot.stopScript()
    until(lambda: dashboard.programState() != "PLAYING <unnamed>")
    return {**found, "state": dashboard.programState()}


def receive(host):
    dashboard = DashboardClient(host)
    dashboard.connect()
    modes = [dashboard.robotmode()]
    dashboard.powerOn()
    dashboard.brakeRelease()
    until(lambda: dashboard.robotmode() == "Robotmode: RUNNING")
    modes.append(dashboard.robotmode())
    states = RTDEReceiveInterface(host)
    earlier = states.getTimestamp()
    until(lambda: states.getTimestamp() > earlier)
    found = {
        "version": dashboard.polyscopeVersion(),
        "serial": dashboard.getSerialNumber(),
        "remote": dashboard.isInRemoteControl(),
        "q": states.getActualQ(),
        "earlier": earlier,
        "later": states.getTimestamp(),
        "currents": states.getActualCurrent(),
    }
    dashboard.powerOff()
    return {**found, "modes": [*modes, dashboard.robotmode()]}


if __name__ == "__main__":
    print(json.dumps({"control": control, "receive": receive}[sys.argv[1]](sys.argv[2])))

"""Plate and stems in the robot's way: a move or a search that runs into one of them ends as a collision."""

from __future__ import annotations

from dataclasses import replace

from sims.cell import Plate

HOME = (0.0, -90.0, 90.0, 0.0, 45.0, 0.0)
LOW = (0.0, 20.0, 60.0, 0.0, 20.0, 0.0)


def on_plate(bench, z, sphere=None):
    """The cell's plate at a height, with no sphere on it but the one given."""
    cell = bench().cell
    first = replace(cell.artefact.spheres[0], centre=sphere or (-1000.0, 0.0, 3000.0))
    artefact = replace(cell.artefact, spheres=(first,), distances=(), plate=Plate(z, 8.0))
    return replace(cell, artefact=artefact)


def test_a_transfer_into_the_plate_is_a_collision_and_the_way_back_is_free(bench):
    pc = bench(cell=on_plate(bench, 100.0))
    number, code, joints, text = pc.ptp(LOW, percent=5.0)
    assert (number, code) == ("1", 31)
    assert "KSS00117" in text
    assert 'Prog="ERROR"' in pc.state(["KSS00117", "ERROR"])
    assert -8.0 < pc.world().free(joints) < 0.0
    assert pc.ptp(LOW)[1] == 12
    assert pc.command("RESET")[1] == 0
    assert pc.ptp(LOW, percent=5.0)[1] == 31, "not deeper"
    assert pc.command("RESET")[1] == 0
    assert pc.ptp(HOME, percent=5.0)[1:3] == (0, HOME)


def test_without_the_plate_the_same_transfer_arrives(bench):
    pc = bench(cell=on_plate(bench, -2000.0))
    assert pc.ptp(LOW, percent=5.0)[1:3] == (0, LOW)


def test_a_search_into_the_plate_is_a_collision(bench):
    cell = on_plate(bench, 0.0)
    _, _, z = bench(cell=cell).world().true_tcp(HOME)
    pc = bench(cell=on_plate(bench, z - 2.0))
    pc.rsi_on()
    number, code, joints, text = pc.until_reply(lambda i: (0.0, 0.004 * i, 0.0, 0.0, 0.0, 0.0))
    assert (number, code) == ("7", 31)
    assert "KSS00117" in text
    assert -3.0 < pc.world().free(joints) < 0.0

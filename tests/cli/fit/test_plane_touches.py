"""Touches on planes in a data set, from the file to the model and the page."""

from dataclasses import replace

import numpy as np
import pytest

from cellctl.cli import exit_codes
from cellctl.cli.verbs import app
from cellctl.formats import ModelFile
from tests.helpers.arms import ELBOW_ROBOT, ElbowArm, csv_text

TIP = 2.0
ARM = replace(ElbowArm(), at=(0.0, 0.0, 0.0))
PLANES = {
    "floor": (np.array([600.0, 0.0, 150.0]), np.array([0.0, 0.0, 1.0])),
    "wall": (np.array([800.0, 0.0, 400.0]), np.array([-1.0, 0.0, 0.0])),
    "slope": (np.array([600.0, -350.0, 300.0]), np.array([0.0, 0.8, 0.6])),
}
ARTEFACT = f"""\
tip_radius: {TIP}
planes: [{{id: floor}}, {{id: wall}}, {{id: slope}}]
"""


@pytest.fixture
def cellctl(tmp_path, monkeypatch):
    (tmp_path / "robot.yaml").write_text(ELBOW_ROBOT)
    monkeypatch.chdir(tmp_path)
    return lambda *words: exit_codes.exit_code_of(lambda: app([str(word) for word in words], standalone_mode=False))


def touch(rng, surface, normals):
    """Readings that bring the tip onto points of a surface, 0.017 mm off along the normals."""
    readings = ARM.reaching(surface + (TIP + rng.normal(0, 0.017, (len(surface), 1))) * normals, rng)
    return {f"A{joint + 1}": readings[:, joint] for joint in range(3)}


def on_planes(rng, count=25):
    """Touches plane by plane."""
    parts = []
    for name, (place, normal) in PLANES.items():
        beside = rng.uniform(-200.0, 200.0, (count, 3))
        beside -= np.outer(beside @ normal, normal)
        parts.append({**touch(rng, place + beside, normal), "plane": [name] * count})
    return parts


def on_a_sphere(rng, count=25):
    """Touches on a sphere of 30 mm radius."""
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    part = touch(rng, np.array([600.0, -200.0, 300.0]) + 30.0 * normals, normals)
    return {**part, "sphere": ["S1"] * count, "radius": [30.0] * count}


def joined(parts, **further):
    """One data set of parts with different columns, and of columns alike in all rows."""
    names = list(dict.fromkeys(name for part in parts for name in part))
    columns = {name: [cell for part in parts for cell in part.get(name, [""] * len(part["A1"]))] for name in names}
    return csv_text(columns | {name: [value] * len(columns["A1"]) for name, value in further.items()})


@pytest.mark.long
def test_three_planes_identify_a_robot_from_its_data_set_and_are_in_model_and_page(cellctl, tmp_path, capsys):
    (tmp_path / "data.csv").write_text(joined(on_planes(np.random.default_rng(4))))
    (tmp_path / "planes.yaml").write_text(ARTEFACT)
    words = ("--artefact", "planes.yaml", "--model", "geometry", "--out", "m.json", "--report", "page.html")
    assert cellctl("fit", "robot.yaml", "data.csv", *words) == 0
    assert "Error of held-out plane touches" in capsys.readouterr().out
    model = ModelFile.load(tmp_path / "m.json")
    assert model.centres == []
    assert model.frame_of_points
    found = {plane.id: plane for plane in model.planes}
    for name, (place, normal) in PLANES.items():
        assert np.dot(found[name].normal, normal) > 0.99999
        assert abs(np.dot(found[name].normal, place) - found[name].offset) < 5.0
        assert 0.0 < found[name].sigma < 3.0
    page = (tmp_path / "page.html").read_text()
    assert "75 plane touches" in page
    assert all(name in page for name in PLANES)


@pytest.mark.long
def test_planes_and_spheres_in_one_file_and_one_kind_of_it_if_asked(cellctl, tmp_path, capsys):
    rng = np.random.default_rng(5)
    (tmp_path / "data.csv").write_text(joined([on_a_sphere(rng), *on_planes(rng)], tip_radius=TIP))
    assert cellctl("fit", "robot.yaml", "data.csv", "--model", "geometry", "--json", "r.json") == 0
    assert '"measure":"sphere+plane"' in (tmp_path / "r.json").read_text().replace(" ", "")
    assert cellctl("fit", "robot.yaml", "data.csv", "--model", "geometry", "--measure", "plane") == 0
    assert "a touch, and only plane touches are asked for" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("10,20,30,wal,,", "plane 'wal' is not in the artefact"),
        ("10,20,30,,,2", "plane is missing"),
        ("10,20,30,S1,,", "'S1' is a point in the artefact, and no plane"),
        ("10,20,30,floor,,3", "tip_radius 3, but the artefact says 2 mm"),
    ],
)
def test_a_row_on_no_such_plane_is_named(cellctl, tmp_path, capsys, line, words):
    head, *rows = joined(on_planes(np.random.default_rng(4))).splitlines()
    text = [f"{head},sphere,tip_radius", *(f"{row},," for row in rows), line]
    (tmp_path / "data.csv").write_text("\n".join(text))
    (tmp_path / "planes.yaml").write_text(ARTEFACT + "spheres: [{id: S1, diameter: 60, centre: [600, 0, 300]}]\n")
    cellctl("fit", "robot.yaml", "data.csv", "--model", "geometry", "--measure", "plane", "--artefact", "planes.yaml")
    assert words in capsys.readouterr().err


def test_one_name_for_a_plane_and_a_socket_and_a_distance_to_a_plane_are_refused(cellctl, tmp_path, capsys):
    head, *rows = joined(on_planes(np.random.default_rng(4))).splitlines()
    (tmp_path / "data.csv").write_text("\n".join([f"{head},socket", *(f"{row}," for row in rows), "10,20,30,,floor"]))
    cellctl("fit", "robot.yaml", "data.csv", "--model", "geometry")
    assert "'floor' is a plane here and a point in line 77" in capsys.readouterr().err
    (tmp_path / "data.csv").write_text("\n".join([head, *rows]))
    assert cellctl("fit", "robot.yaml", "data.csv", "--spacing", "floor,wall=300±0.01") == 2
    assert "'floor' is a plane\n    name spheres, sockets or anchors" in capsys.readouterr().err
    (tmp_path / "planes.yaml").write_text(ARTEFACT + "sockets: [{id: floor}]\n")
    assert cellctl("fit", "robot.yaml", "data.csv", "--artefact", "planes.yaml") == 2
    assert "'floor' is there twice" in capsys.readouterr().err


def test_a_reversed_joint_is_named_and_no_robot_that_can_only_move_in_a_plane(cellctl, tmp_path, capsys):
    # read as Craig's, the table is a planar arm, all of whose places lie in every plane: RMS 0
    parts = [{**part, "A2": -part["A2"]} for part in on_planes(np.random.default_rng(4))]
    (tmp_path / "data.csv").write_text(joined(parts))
    (tmp_path / "planes.yaml").write_text(ARTEFACT)
    assert cellctl("fit", "robot.yaml", "data.csv", "--artefact", "planes.yaml") == 2
    told = capsys.readouterr().err
    assert "A2 reversed" in told
    assert "Craig" not in told

"""The simulators' own reader of cell and robot files."""

import json

import pytest
import yaml

from sims.cell import ERRORS, CellError, read_cell
from sims.schema import schema_of
from sims.simulators import installed


@pytest.fixture
def sphere_cell(request):
    return request.config.rootpath / "procedures/cells/sphere_cell.yaml"


@pytest.fixture
def edited(sphere_cell, tmp_path):
    """Reads the sphere cell after `edit(cell, robot)` has changed its files' content."""

    def read(edit):
        cell = yaml.safe_load(sphere_cell.read_text())
        robot = yaml.safe_load((sphere_cell.parent / cell["model"]).read_text())
        cell["model"] = "robot.yaml"
        edit(cell, robot)
        (tmp_path / "robot.yaml").write_text(yaml.safe_dump(robot))
        (tmp_path / "cell.yaml").write_text(yaml.safe_dump(cell))
        return read_cell(tmp_path / "cell.yaml")

    return read


def problems(edited, edit):
    with pytest.raises(CellError) as caught:
        edited(edit)
    return caught.value.problems


def test_the_shipped_cell_is_read_with_the_documents_defaults(sphere_cell):
    cell = read_cell(sphere_cell)
    assert list(cell.addresses) == ["robot", "probe"]
    assert [sphere.id for sphere in cell.artefact.spheres][:3] == ["S1", "S2", "S3"]
    assert cell.robot.name == "KUKA KR5 R1400"
    assert [link.a for link in cell.robot.links] == [180, 600, 40, 0, 0, 0]
    assert [joint.sign for joint in cell.robot.joints] == [-1, 1, 1, -1, 1, -1]
    assert cell.robot.tool.mass == 1.535
    unasked = {
        "wear",
        "warm_up",
        "compliance",
        "gear",
        "backlash",
        "expansion",
        "station_drift",
        "air",
        "friction_torsion",
    }
    assert {kind for kind, scale in cell.simulate.errors.items() if scale == 0.0} == unasked
    assert {kind for kind, scale in cell.simulate.errors.items() if scale == 1.0} == set(ERRORS) - unasked
    rsi = {
        "cycle_ms": None,
        "precision": 4,
        "timeout_cycles": 100,
        "counter": "total",
        "mark": "session",
        "port": "kept",
        "restart_cycles": 3,
        "mode": None,
        "hello": "rsi_on",
        "jitter_ms": 0.0,
        "lag_ms": None,
        "t1": "allowed",
    }
    assert cell.simulate.settings["rsi"] == rsi
    assert cell.simulate.settings["probe"] == {"usb_delay_ms": 1.0, "bounce": 2}
    assert cell.simulate.settings["plc"] == {"delay_least_ms": 5.0, "delay_most_ms": 20.0, "clamp_ms": 300.0}
    assert cell.simulate.settings["drives"] == {"brakes_after_s": 10.0, "noise": 0.004}


def test_errors_are_switched_off_or_scaled(edited):
    cell = edited(lambda cell, _: cell["simulate"].update(errors={"tool": False, "servo": True, "geometry": 2.5}))
    assert [cell.simulate.errors[kind] for kind in ("tool", "servo", "geometry", "encoder")] == [0.0, 1.0, 2.5, 1.0]


def test_all_errors_of_both_files_are_named_at_once(edited):
    def edit(cell, robot):
        cell["simulate"] = {
            "seed": -1,
            "clok": "lockstep",
            "errors": {"gravity": 1, "tool": -1},
            "rsi": {"cycle_ms": 5},
            "probe": {"bounce": 3},
            "faults": [{"fault": "probe.sulks"}],
        }
        cell["artefact"]["distances"][0]["between"] = ["S1", "S9"]
        robot["joints"][1]["max"] = -500
        del robot["links"][0]

    text = "\n".join(problems(edited, edit))
    for place in [
        "simulate.seed", "simulate.clok", "simulate.errors.gravity", "simulate.errors.tool", "simulate.rsi.cycle_ms",
        "simulate.probe.bounce", "simulate.faults[0]", "artefact.distances[0].between", "robot.yaml.joints[1].max",
        "6 joints for 5 links",
    ]:  # fmt: skip
        assert place in text


@pytest.mark.parametrize("wrong", [None, "lots", [1], {"x": 1}, float("nan"), True])
def test_a_number_is_a_number(edited, wrong):
    found = problems(edited, lambda cell, robot: robot["joints"][0].update(max_speed=wrong))
    assert len(found) == 1
    assert found[0].startswith("robot.yaml.joints[0].max_speed: ")


def test_a_real_cell_is_not_simulated(edited):
    assert "real cell" in problems(edited, lambda cell, _: cell.pop("simulate"))[0]


def test_files_that_cannot_be_read_are_named(tmp_path, edited):
    with pytest.raises(CellError, match=r"nowhere\.yaml: .*\n.*cannot be read"):
        read_cell(tmp_path / "nowhere.yaml")
    (tmp_path / "torn.yaml").write_text("simulate: [")
    with pytest.raises(CellError, match="is not YAML"):
        read_cell(tmp_path / "torn.yaml")
    assert any(
        "gone.yaml cannot be read" in text for text in problems(edited, lambda c, _: c.update(model="gone.yaml"))
    )


def test_the_published_schema_is_that_of_the_shipped_simulators(request):
    published = json.loads((request.config.rootpath / "sims/simulate.schema.json").read_text())
    assert published == schema_of(installed()), "python -m sims schema > sims/simulate.schema.json"


def test_the_defaults_of_the_schema_are_the_readers(edited):
    def with_defaults(cell, _):
        cell["simulate"] = defaults_of(schema_of(installed()))

    assert edited(with_defaults).simulate == edited(lambda cell, _: cell.update(simulate={})).simulate


def defaults_of(schema):
    found = {}
    for key, value in schema["properties"].items():
        if "default" in value:
            found[key] = value["default"]
        elif "properties" in value:
            found[key] = defaults_of(value)
    return found


def test_an_address_at_top_level_is_reported_where_it_belongs(edited):
    found = problems(edited, lambda cell, _: cell.update(cell.pop("devices")))
    assert found == [f"{name}: is an address at top level; write it under `devices:`" for name in ("probe", "robot")]

"""A table as a KRL module and as CSV: the same joints, read back, and nothing that moves another robot."""

import csv
import io

import pytest

from cellctl.files import InputError
from cellctl.formats import TableFile
from cellctl.formats.table import TableRegion, TableRobot, TableSource, table_rows
from cellctl.formats.table_export import krl_module, module_name, nominal_name, targets_csv
from cellctl.krl import Control, KrlFile
from cellctl.robot_file import Tool
from tests.helpers.krl import Krl


def table(rows=3, *, joints=6, serial="925185", simulated=False, name="KUKA KR5 R1400"):
    import numpy as np

    rng = np.random.default_rng(4)
    nominal = rng.uniform(-170, 170, (rows, joints))
    figures = rng.uniform(0, 1, (3, rows))
    return TableFile.of(
        table_rows(rng.uniform(-900, 900, (rows, 6)), nominal, nominal + rng.normal(0, 0.1, (rows, joints)), *figures),
        robot=TableRobot(serial=serial, name=name),
        simulated=simulated,
        tool=Tool(xyz=[59.9, 50.5, 410.3], mass=1.5),
        source=TableSource(run="2026-11-23_sphere", model_sha256="0" * 64, method="pseudo-target"),
        joint_region=TableRegion(min=[-180.0] * joints, max=[180.0] * joints),
        created="2026-11-23T00:00:00Z",
    )


def module(made):
    name = module_name(made)
    files = krl_module(made)
    assert list(files) == [f"{name}.dat", f"{name}.src"]
    return [KrlFile.parse(text.encode("ascii"), file) for file, text in files.items()]


def test_the_data_list_holds_the_joints_of_every_row_digit_by_digit():
    made = table()
    data, _ = module(made)
    for place, row in enumerate(made.rows, 1):
        assert list(data.point(f"COMPENSATED[{place}]").values.values()) == row.compensated
        assert list(data.point(f"NOMINAL[{place}]").values.values()) == row.nominal
    assert data.unknown == ()


def test_the_program_moves_to_the_rows_after_it_asked_for_the_serial():
    _, program = module(table())
    assert program.unknown == ()
    assert [motion.target.name for motion in program.motions] == ["COMPENSATED", "NOMINAL"]
    assert program.text.count("IF $KR_SERIALNO<>925185 THEN") == 2
    halts = [statement.line for statement in program.of(Control) if statement.keyword == "HALT"]
    assert len([line for line in halts if line < program.motions[0].line]) == 2


class Halted(Exception):
    pass


class Controller(Krl):
    """Runs the module's program; a motion is kept, HALT ends it."""

    def __init__(self, made, serial):
        data, program = module(made)
        super().__init__([program.text], {})
        arrays = {
            name: {(n,): data.point(f"{name}[{n}]").values for n in range(1, len(made.rows) + 1)}
            for name in ("COMPENSATED", "NOMINAL")
        }
        self.variables |= {"$KR_SERIALNO": serial, "ROWS": len(made.rows), **arrays}
        self.moved = []

    def _loop(self, lines, at, close, local):
        self._block(lines, at + 1, close, local)

    def _statement(self, line, local):
        if line == "HALT":
            raise Halted
        if line.startswith("PTP "):
            self.moved.append(list(self.value(line[4:], local).values()))
        else:
            super()._statement(line, local)


def test_the_program_moves_to_the_row_on_the_controller_of_the_table():
    made = table()
    controller = Controller(made, 925185)
    controller.call(module_name(made), 2)
    controller.call(nominal_name(made), 3)
    assert controller.moved == [made.rows[1].compensated, made.rows[2].nominal]


@pytest.mark.parametrize(
    ("serial", "row", "simulated"), [(925186, 1, False), (925185, 0, False), (925185, 4, False), (1, 1, True)]
)
def test_the_program_halts_on_another_controller_at_a_missing_row_and_if_simulated(serial, row, simulated):
    made = table(serial="SIM-1" if simulated else "925185", simulated=simulated)
    controller = Controller(made, serial)
    for name in (module_name(made), nominal_name(made)):
        with pytest.raises(Halted):
            controller.call(name, row)
    assert controller.moved == []


def test_the_comments_name_table_robot_serial_tool_and_run():
    made = table(name="Größe 5")
    data, program = module(made)
    for file in (data, program):
        assert made.id in file.text
        assert "Gr??e 5, controller serial 925185" in file.text
        assert "X 59.9, Y 50.5, Z 410.3" in file.text
        assert "2026-11-23_sphere" in file.text


def test_the_module_of_a_simulated_robot_stops_on_every_controller():
    _, program = module(table(serial="SIM-925185", simulated=True))
    assert program.text.count("IF TRUE THEN\n  LOOP\n    HALT") == 2


def test_a_robot_with_seven_axes_has_no_krl():
    with pytest.raises(InputError, match="7 axes"):
        krl_module(table(joints=7))


def test_the_csv_holds_targets_joints_and_predicted_errors():
    made = table(joints=7)
    rows = list(csv.DictReader(io.StringIO(targets_csv(made))))
    for place, (written, row) in enumerate(zip(rows, made.rows, strict=True), 1):
        assert int(written["row"]) == place
        assert [float(written[name]) for name in "XYZABC"] == row.target
        assert [float(written[f"nominal_A{axis}"]) for axis in range(1, 8)] == row.nominal
        assert [float(written[f"compensated_A{axis}"]) for axis in range(1, 8)] == row.compensated
        assert float(written["predicted_before_mm"]) == row.predicted_before_mm
        assert float(written["sigma_mm"]) == row.sigma_mm

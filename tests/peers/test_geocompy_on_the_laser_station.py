"""GeoComPy, which we did not write, completes a session with the simulated laser station.

Nothing of cellctl is imported here.
"""

from __future__ import annotations

import json
import subprocess
import sys
from math import atan2, cos, hypot, pi, radians, sin
from urllib.parse import urlsplit

import pytest

from tests.helpers.station import STATION, write_cell

geocompy = pytest.importorskip("geocompy")
from geocompy import Angle, Coordinate, GeoCom, open_serial  # noqa: E402
from geocompy.geo.gctypes import GeoComCode  # noqa: E402

PATIENCE_S = 60
QUICK = {"edm_s": 0.2, "fine_adjust_s": 0.2, "lock_s": 0.2, "predict_s": 0.5, "speed_deg_s": 180.0}


@pytest.fixture
def terminal(request, tmp_path):
    """Starts a cell with a simulated laser station and gives the path of its terminal."""
    processes = []

    def start(clock, **simulate):
        cell = write_cell(request.config.rootpath, tmp_path, tracker=QUICK, clock=clock, **simulate)
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", "sims", "run", str(cell)], stdout=subprocess.PIPE, text=True
        )
        processes.append(process)
        return urlsplit(json.loads(process.stdout.readline())["tracker"]).path

    yield start
    for process in processes:
        process.terminate()
        process.communicate(timeout=PATIENCE_S)


def direction(place):
    """By the file's rough frame of the station: turned by 30° about z."""
    east, north, up = (a - b for a, b in zip(place, STATION["xyz"], strict=True))
    turn = radians(STATION["abc"][0])
    x, y = cos(turn) * east + sin(turn) * north, cos(turn) * north - sin(turn) * east
    return Angle(atan2(x, y) % (2 * pi)), Angle(atan2(hypot(x, y), up)), hypot(x, y, up)


def ok(response):
    assert response.error == GeoComCode.OK, response
    return response.params


@pytest.mark.parametrize(
    ("clock", "checksum"), [pytest.param("realtime", True, marks=pytest.mark.realtime), ("lockstep", False)]
)
def test_a_whole_session(terminal, clock, checksum):
    with open_serial(terminal(clock), speed=115_200, timeout=20) as line:
        station = GeoCom(line, checksum=checksum)
        assert ok(station.csv.get_instrument_name()) == "SIM-TDRA6000"
        ok(station.bap.set_prism_type("USER"))
        ok(station.tmc.set_prism_correction(-0.0038))
        assert ok(station.tmc.get_prism_correction()) == pytest.approx(-0.0038)
        ok(station.tmc.set_atmospheric_corrections(0.658, 1013.25, 20.0, 13.3))
        ok(station.tmc.switch_compensator(True))
        ok(station.aus.switch_user_atr(True))
        ok(station.aus.switch_user_lock(True))
        hz, v, length = direction(STATION["nests"][0]["xyz"])
        ok(station.aut.turn_to(hz, v))
        ok(station.aut.fine_adjust(0.06, 0.06))
        ok(station.aut.lock_in())
        assert ok(station.mot.get_lockon_status()).name == "LOCK"
        ok(station.tmc.do_measurement("CLEAR"))
        ok(station.tmc.do_measurement("DISTANCE"))
        first_hz, first_v, metres = ok(station.tmc.get_simple_measurement(5000))
        assert metres * 1e3 == pytest.approx(length, abs=30.0)
        ok(station.aut.change_face())
        second_hz, second_v = ok(station.tmc.get_angle())
        assert float(second_v) == pytest.approx(2 * pi - float(first_v), abs=1e-3)
        assert abs(float(second_hz) - float(first_hz)) == pytest.approx(pi, abs=1e-3)


def test_it_decodes_every_reply_that_the_instrument_gives(terminal):
    with open_serial(terminal("lockstep"), speed=115_200, timeout=20) as line:
        station = GeoCom(line, checksum=True)
        ok(station.bap.set_user_prism_definition("SMR", -0.0038, "PRISM", "bench"))
        assert ok(station.bap.get_user_prism_definition("SMR"))[0] == pytest.approx(-0.0038)
        ok(station.bap.set_prism_definition("USER1", "SMR 1.5", 0.001, "PRISM"))
        assert ok(station.bap.get_prism_definition("USER1"))[:2] == ("SMR 1.5", pytest.approx(0.001))
        ok(station.bap.set_prism_type("USER1"))
        assert ok(station.bap.get_prism_type()).name == "USER1"
        ok(station.aut.switch_atr(True))
        hz, v, _ = direction(STATION["nests"][1]["xyz"])
        ok(station.aut.set_search_area(hz, v, Angle(0.2), Angle(0.2)))
        assert ok(station.aut.get_search_area())[4] is True
        ok(station.aut.powersearch_window())
        ok(station.tmc.do_measurement())
        ok(station.tmc.get_complete_measurement(5000))
        ok(station.tmc.set_station(Coordinate(1.0, 2.0, 3.0), 0.2))
        assert ok(station.tmc.get_station())[1] == pytest.approx(0.2)
        for ask in (
            station.com.nullprocess,
            station.com.get_geocom_version,
            station.com.get_double_precision,
            station.csv.get_serial_number,
            station.csv.get_firmware_version,
            station.csv.get_internal_temperature,
            station.csv.check_power,
            station.bap.get_measurement_program,
            station.bap.get_target_type,
            station.bap.measure_distance_angle,
            station.tmc.get_edm_mode_v2,
            station.tmc.get_compensator_status,
            station.tmc.get_atmospheric_corrections,
            station.tmc.get_atmospheric_correction_ppm,
            station.tmc.get_geometric_correction_ppm,
            station.tmc.get_angle,
            station.tmc.get_angle_inclination,
            station.tmc.get_coordinate,
            station.tmc.get_simple_coordinate,
            station.tmc.quick_distance,
            station.aut.get_atr_status,
            station.aut.get_lock_status,
            station.aut.get_tolerance,
            station.aut.get_timeout,
            station.aut.get_spiral,
            station.aus.get_user_atr_state,
            station.aus.get_user_lock_state,
            station.mot.get_lockon_status,
        ):
            ok(ask())
        assert station.tmc.get_face().error == GeoComCode.COM_PROC_UNAVAIL  # a procedure that it does not have
        assert station.aut.turn_to(0.5, 0.5).error == GeoComCode.OK
        assert station.aut.fine_adjust(0.01, 0.01).error == GeoComCode.AUT_NO_TARGET
        ok(station.com.switch_off("SLEEP"))
        assert station.csv.get_serial_number().error == GeoComCode.COM_SRVR_IS_SLEEPING
        ok(station.com.switch_on())
        ok(station.csv.get_serial_number())


@pytest.mark.realtime
def test_its_abort_breaks_off_nothing_and_is_answered(terminal):
    with open_serial(terminal("realtime"), speed=115_200, timeout=20) as line:
        station = GeoCom(line)
        assert station.abort().error == GeoComCode.OK
        assert station.com.nullprocess().error == GeoComCode.OK

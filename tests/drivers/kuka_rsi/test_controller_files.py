"""What `cellctl krl` writes for a controller: it fits the cell, the channel's reference and the driver's documents."""

from __future__ import annotations

import asyncio
import itertools
import re
import zlib
from collections import defaultdict, deque
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellctl.clock import WallClock
from cellctl.devices import Address, ControllerTable, Surroundings, TableInfo, TableRow, TableState
from drivers.kuka_rsi.controller_files.generate import controller_files
from drivers.kuka_rsi.eki.channel import (
    ANSWER_S,
    SILENCE_S,
    DocumentStream,
    EkiChannel,
    Reply,
    Stat,
    point_to_point,
    read_document,
    write_command,
)
from drivers.kuka_rsi.eki.tables import BLOCK_ROWS, TableChannel
from tests.helpers.krl import Krl, Place, Text
from tests.helpers.runs import CELL, ROOT, cellctl

ADDRESS = Address.parse("kuka+rsi://192.168.10.2:49152?ethernet=rsi_ethernet.xml&eki=172.31.1.147:54601")
REFERENCE = (ROOT / "docs" / "reference" / "eki-channel.md").read_text()
SERIAL = 925185


def files_for(address: Address, folder: Path, limits: dict[str, float], cell: str = "sphere cell") -> dict[str, str]:
    return controller_files(cell, address, Surroundings(WallClock(), folder, limits))


@pytest.fixture(scope="module")
def made() -> dict[str, str]:
    return files_for(ADDRESS, CELL.parent, {"correction_deg": 3})


class Controller:
    """The programs as shipped, on a stand-in for EthernetKRL and the system: what goes in, what comes out."""

    def __init__(self, made: dict[str, str]) -> None:
        self.received: dict[str, deque[str]] = defaultdict(deque)
        self.sent = b""
        builtins = {name[1:]: getattr(self, name) for name in dir(self) if re.match(r"_[a-z]", name)}
        self.krl = Krl([text for name, text in made.items() if name.endswith((".src", ".dat"))], builtins)
        self.tags = {element.get("Tag", "") for element in ElementTree.fromstring(made["cellctl_eki.xml"]).iter()}
        variables = self.krl.variables
        variables["$FLAG"] = {(number,): False for number in range(401, 406)} | {(401,): True}
        variables |= {"$STOPMESS": False, "$PERI_RDY": True, "$ROB_STOPPED": True, "$PRO_STATE1": "#P_ACTIVE"}
        variables |= {"$MODE_OP": "#EX", "$KR_SERIALNO": SERIAL, "$ROB_TIMER": 0, "$CMD": 0}
        variables["$TRAFONAME"], variables["$V_R1MADA"] = Text(map(ord, "KR5")), Text(map(ord, "KSS8.6"))
        variables["$AXIS_ACT_MEAS"] = {f"A{n}": float(n) for n in range(1, 7)}
        variables["$SOFTN_END"] = {(n,): -170.0 for n in range(1, 7)}
        variables["$SOFTP_END"] = {(n,): 170.0 for n in range(1, 7)}
        self.krl.call("CC_INIT")
        self.cycle()  # its greeting

    def take(self, document: bytes) -> list[Reply | Stat]:
        """One document in, as EthernetKRL takes it apart; a round of the submit program; what it sent."""
        root = ElementTree.fromstring(document)
        for path, element in _elements(root, root.tag):
            for name, value in element.attrib.items():
                assert f"{path}/@{name}" in self.tags, "the channel's configuration does not take this apart"
                self.received[f"{path}/@{name}"].append(value)
        return self.cycle()

    def cycle(self) -> list[Reply | Stat]:
        self.sent = b""
        self.krl.call("CC_CYCLE")
        return [read_document(document) for document in DocumentStream().feed(self.sent)]

    def reply(self, document: bytes) -> Reply:
        replies = [said for said in self.take(document) if isinstance(said, Reply)]
        assert len(replies) == 1
        return replies[0]

    def raw(self, document: bytes) -> ElementTree.Element:
        """The reply as XML, with what the plain reader leaves out."""
        self.take(document)
        return next(
            root for part in DocumentStream().feed(self.sent) if (root := ElementTree.fromstring(part)).tag == "Rep"
        )

    # EthernetKRL and the system, as far as the programs call them

    def _get_msgbuffer(self, buffer: Place) -> int:
        buffer.get()[1,] = {"NR": 29002}
        return 1

    def _confirm(self, _: str) -> None:
        self.krl.variables["$STOPMESS"] = False

    def _wait(self, _: str) -> None:
        self.krl.variables["$ROB_TIMER"] += 12

    def _cwrite(self, channel: Place, state: Place, mode: Place, command: Place) -> None:
        word = re.split(r"[ /]", str(command.get()))[0]
        self.krl.variables["$PRO_STATE1"] = {"STOP": "#P_STOP", "CANCEL": "#P_FREE", "RUN": "#P_ACTIVE"}[word]

    def _eki_init(self, *_: Place) -> None: ...

    def _eki_open(self, *_: Place) -> None: ...

    def _eki_clear(self, *_: Place) -> None:
        self.received.clear()

    def _eki_clearbuffer(self, *_: Place) -> None:
        self.received.clear()

    def _eki_checkbuffer(self, _: Place, tag: Place) -> dict[str, int]:
        assert str(tag.get()) in self.tags
        return {"BUFF": len(self.received[str(tag.get())])}

    def _eki_getint(self, _: Place, tag: Place, value: Place) -> None:
        value.set(int(self.received[str(tag.get())].popleft()))

    def _eki_getreal(self, _: Place, tag: Place, value: Place) -> None:
        value.set(float(self.received[str(tag.get())].popleft()))

    def _eki_getstring(self, _: Place, tag: Place, value: Place) -> None:
        value.get()[:] = map(ord, self.received[str(tag.get())].popleft())

    def _eki_send(self, _: Place, text: Place, length: Place) -> None:
        assert length.get() == len(text.get()) <= 470, "a KRL text of this program holds 470 characters"
        self.sent += str(text.get()).encode("ascii")

    def _swrite(self, text: Place, _: Place, at: Place, layout: Place, value: Place) -> None:
        given = value.get()
        text.get()[at.get() :] = map(ord, str(layout.get()) % (str(given) if isinstance(given, Text) else given))
        at.set(len(text.get()))

    def _strclear(self, text: Place) -> bool:
        text.get()[:] = []
        return True

    def _strcopy(self, to: Place, text: Place) -> bool:
        to.get()[:] = text.get()
        return True

    def _strcomp(self, a: Place, b: Place, _: Place) -> bool:
        return str(a.get()) == str(b.get())

    def _strlen(self, text: Place) -> int:
        return len(text.get())

    def _strtoint(self, text: Place, value: Place) -> bool:
        digits = str(text.get())
        value.set(int(digits) if digits.isdigit() else 0)
        return digits.isdigit()


def _elements(root: ElementTree.Element, path: str) -> list[tuple[str, ElementTree.Element]]:
    return [(path, root), *(found for child in root for found in _elements(child, f"{path}/{child.tag}"))]


@pytest.fixture
def controller(made: dict[str, str]) -> Controller:
    return Controller(made)


ROWS = [
    ([0.1 * n - 90.0, -90.5, 45.123456, -0.000001, 12.5, 170.0], [0.1 * n - 90.01, -90.4, 45.2, 0.3, 12.4, 169.99])
    for n in range(1, 13)
]


def line(number: int, row: tuple[list[float], list[float]]) -> str:
    """A row's line as docs/reference/eki-channel.md has it."""
    return f"{number};" + ";".join(f"{value:.6f}" for value in (*row[0], *row[1])) + "\n"


def checksum(first: int, rows: list[tuple[list[float], list[float]]]) -> str:
    return f"{zlib.crc32(''.join(line(first + n, row) for n, row in enumerate(rows)).encode()):08X}"


def block(number: int, first: int, rows: list[tuple[list[float], list[float]]]) -> bytes:
    def joints(tag: str, values: list[float]) -> str:
        return f"<{tag} " + " ".join(f'A{axis}="{value:.6f}"' for axis, value in enumerate(values, 1)) + "/>"

    each = (f'<R N="{first + n}">{joints("Q", row[0])}{joints("C", row[1])}</R>' for n, row in enumerate(rows))
    head = f'<Block First="{first}" Count="{len(rows)}" Sum="{checksum(first, rows)}"/>'
    return write_command(number, "TBLOCK", head + "".join(each))


def stage(controller: Controller, name: str, rows: list[Any] = ROWS) -> None:
    table = f'<Table Id="{name}" Serial="{SERIAL}" Rows="{len(rows)}" Sum="{checksum(1, rows)}"/>'
    assert controller.reply(write_command(1, "TSTAGE", table)).code == 0
    for first in range(0, len(rows), 10):
        assert controller.reply(block(2, first + 1, rows[first : first + 10])).code == 0


def activation(name: str, rows: list[Any] = ROWS) -> bytes:
    return write_command(3, "TACTIVATE", f'<Table Id="{name}" Sum="{checksum(1, rows)}"/>')


def roles(controller: Controller) -> dict[str, str]:
    root = controller.raw(write_command(4, "TSTATE"))
    return {part.tag: part.get("Id", "") for part in root if part.tag != "Q"}


def test_every_operation_and_code_of_the_reference_is_in_the_programs(made: dict[str, str]) -> None:
    programs = "".join(made.values())
    operations = set(re.findall(r"^\| `([A-Z]+)` \|", REFERENCE, re.MULTILINE))
    assert len(operations) == 15
    assert operations == set(re.findall(r'StrComp\(CC_OP\[\],"([A-Z]+)"', programs))
    codes = set(re.findall(r"^\| (\d+) \|", REFERENCE, re.MULTILINE)) | {"40", "41", "42", "43"}
    assert codes == set(re.findall(r"CC_(?:BEGIN_)?REPLY\([A-Z_]+,(\d+),", programs))


def test_every_routine_is_defined_once_and_every_name_is_declared(made: dict[str, str]) -> None:
    programs = "\n".join(re.sub(r"^\s*;.*$", "", made[name], flags=re.MULTILINE) for name in made if "cellctl" in name)
    defined = re.findall(r"^(?:GLOBAL )?(?:DEF|DEFFCT \w+) (\w+)\(", programs, re.MULTILINE)
    assert len(defined) == len(set(defined)) > 60
    called = set(re.findall(r"\b(CC_\w+)\(", programs))
    assert called <= set(defined)
    declared = set(re.findall(r"DECL GLOBAL \w+ (CC_\w+)", programs)) | {"CC_BANK_T"}
    assert set(re.findall(r"\bCC_\w+", programs)) == declared | {name for name in defined if name.startswith("CC_")}


def test_the_ethernet_configuration_is_the_persons_own_with_the_address_filled_in(made: dict[str, str]) -> None:
    own = (CELL.parent / "rsi_ethernet.xml").read_text()
    assert made["rsi_ethernet.xml"] == own
    other = Address.parse("kuka+rsi://10.1.2.3:49152?ethernet=rsi_ethernet.xml&eki=172.31.1.147:54600")
    files = files_for(other, CELL.parent, {})
    assert files["rsi_ethernet.xml"] == own.replace("192.168.10.2", "10.1.2.3")


def test_the_channel_listens_where_the_address_looks_for_it(made: dict[str, str]) -> None:
    root = ElementTree.fromstring(made["cellctl_eki.xml"])
    inner = root.find("CONFIGURATION/INTERNAL")
    assert inner is not None
    assert (inner.findtext("IP"), inner.findtext("PORT")) == ("172.31.1.147", "54601")
    assert root.findtext("CONFIGURATION/EXTERNAL/TYPE") == "Client"
    alive = inner.find("ALIVE")
    assert alive is not None
    assert f"CC_F_ALIVE={alive.get('Set_Flag')}" in made["cellctl.dat"]


def test_the_instructions_name_every_file_the_limits_and_that_nobody_tried_it(made: dict[str, str]) -> None:
    told = made["README.txt"]
    assert [name for name in made if name != "README.txt" and name not in told] == []
    assert "-3 / +3" in told
    assert "speed 2 deg/s" in told
    assert f"waits\n      {SILENCE_S:g} s for a word and {ANSWER_S:g} s for the answer" in told
    assert "NOT TRIED ON A REAL CONTROLLER" in told
    assert "outputs 1, 2, 3, 4, 5, 6" in told.replace("\n", " ")


def test_every_file_that_the_controller_loads_says_at_its_head_that_nobody_tried_it(made: dict[str, str]) -> None:
    for name in made.keys() - {"rsi_ethernet.xml"}:
        assert re.search("not tried on a real", "\n".join(made[name].splitlines()[:9]), re.IGNORECASE), name


def links(root: ElementTree.Element, kind: str, place: str, output: str) -> dict[int, int]:
    """Input → output of the ETHERNET object, of the one object of that kind in a context."""
    (item,) = (item for item in root.iter() if item.get("ObjType", "").upper() == kind)
    inputs = [part for part in item.iter() if part.tag.endswith("Input")]
    return {int(part.get(place, "")): int(part.get(output, "")) for part in inputs}


def parameters(root: ElementTree.Element, kind: str) -> dict[str, str]:
    (item,) = (item for item in root.iter() if item.get("ObjType", "").upper() == kind)
    return {part.get("Name", ""): part.get("ParamValue", "") for part in item.iter() if part.tag.endswith("Parameter")}


@pytest.mark.parametrize(("name", "first"), [("cellctl.rsix", 0), ("cellctl.rsi.xml", 1)])
def test_the_context_wires_the_channels_of_the_persons_own_ethernet_file(tmp_path: Path, name: str, first: int) -> None:
    xml = (CELL.parent / "rsi_ethernet.xml").read_text()
    for axis in range(6, 0, -1):  # as KUKA's own example has it: the stop first
        xml = xml.replace(
            f'TAG="AK.A{axis}" TYPE="DOUBLE" INDX="{axis}"', f'TAG="AK.A{axis}" TYPE="DOUBLE" INDX="{axis + 1}"'
        )
    (tmp_path / "rsi_ethernet.xml").write_text(xml.replace('TYPE="BOOL" INDX="7"', 'TYPE="BOOL" INDX="1"'))
    root = ElementTree.fromstring(files_for(ADDRESS, tmp_path, {})[name])
    spelling = ("InIdx", "OutIdx")
    assert links(root, "AXISCORR", *spelling) == {first + n: first + n + 1 for n in range(6)}
    assert links(root, "STOP", *spelling) == {first: first}


@pytest.mark.parametrize("name", ["cellctl.rsix", "cellctl.rsi.xml"])
def test_the_context_has_the_limits_of_the_cell_file_and_the_tolerance_of_the_address(name: str) -> None:
    address = Address.parse(f"{ADDRESS}&tolerance=20")
    root = ElementTree.fromstring(files_for(address, CELL.parent, {"correction_deg": 3})[name])
    axes = range(1, 7)
    assert parameters(root, "AXISCORR") == {f"LowerLimA{n}": "-3" for n in axes} | {f"UpperLimA{n}": "3" for n in axes}
    assert parameters(root, "AXISCORRMON").items() >= {f"MaxA{n}": "4" for n in axes}.items()
    assert parameters(root, "STOP") == {"Mode": "4", "Channel": "0"}
    ethernet = {"ConfigFile": "rsi_ethernet.xml", "Timeout": "20", "Flag": "-1", "Precision": "4"}
    assert parameters(root, "ETHERNET") == ethernet


def test_the_text_beside_the_context_names_the_same_limits(made: dict[str, str]) -> None:
    text = "\n".join(made.values())
    assert "LowerLim / UpperLim of each axis -3 / +3 (degrees" in text
    assert "MaxA1 ... MaxA6 4: RSI stops there" in text


PUBLISHED = {
    "cellctl.rsix": {
        "Ethernet": ("64", {"ConfigFile": "0", "Timeout": "0", "Flag": "3", "Precision": "7"}),
        "AxisCorr": ("33", {"LowerLimA1": "0", "LowerLimA6": "5", "UpperLimA1": "6", "UpperLimA6": "11"}),
        "AxisCorrMon": ("82", {"MaxA1": "0", "MaxA6": "5", "MaxE1": "6", "MaxE6": "11"}),
        "Stop": ("18", {"Mode": "0", "Channel": "1"}),
    },
    "cellctl.rsi.xml": {
        "ETHERNET": ("64", {"ConfigFile": "1", "Timeout": "1", "Flag": "4", "Precision": "8"}),
        "AXISCORR": ("33", {"LowerLimA1": "1", "LowerLimA6": "6", "UpperLimA1": "13", "UpperLimA6": "18"}),
        "AXISCORRMON": ("82", {"MaxA1": "1", "MaxA6": "6", "MaxE1": "7", "MaxE6": "12"}),
        "STOP": ("18", {"Mode": "1", "Channel": "2"}),
    },
}
"""Numbers of objects and parameters in the contexts of kuka_experimental and kuka-external-control-sdk."""


@pytest.mark.parametrize("name", PUBLISHED)
def test_objects_and_parameters_have_the_names_and_numbers_of_published_contexts(
    made: dict[str, str], name: str
) -> None:
    root = ElementTree.fromstring(made[name])
    objects = {item.get("ObjType", ""): item for item in root.iter() if item.get("ObjType")}
    assert objects.keys() == PUBLISHED[name].keys()
    for kind, (number, wanted) in PUBLISHED[name].items():
        item = objects[kind]
        assert number in (item.get("ObjTypeId"), item.get("ObjTypeID"))
        places = {part.get("Name", ""): part.get("ParamId") or part.get("ParamID") for part in item.iter()}
        assert places.items() >= wanted.items()
        fixed = {part.get("Name") for part in item.iter() if part.get("IsRuntime") == "false"}
        assert fixed == ({"ConfigFile"} if kind.upper() == "ETHERNET" else set())


def test_the_program_creates_the_context_under_the_name_of_its_file(made: dict[str, str]) -> None:
    assert 'RSI_CREATE("cellctl",CC_CONTEXT,TRUE)' in made["cellctl.src"]


def test_a_text_parameter_without_brackets_in_the_header_does_not_load() -> None:
    body = "\nDECL CHAR TXT[]\nEND\n"
    Krl([f"GLOBAL DEF CC_X(TXT[]:IN){body}"], {})
    with pytest.raises(AssertionError, match="arrays in the header"):
        Krl([f"GLOBAL DEF CC_X(TXT:IN){body}"], {})


@pytest.mark.parametrize("mode", ["absolute", "relative"])
@pytest.mark.parametrize(("cycle", "length"), [("ipo_fast", "0.4 s at 4 ms"), ("ipo", "0.492 s at 12 ms")])
def test_rsi_is_switched_on_as_the_address_says_and_each_file_names_it(
    tmp_path: Path, mode: str, cycle: str, length: str
) -> None:
    xml = (CELL.parent / "rsi_ethernet.xml").read_text()
    (tmp_path / "rsi.xml").write_text(xml.replace('HOLDON="1"', 'HOLDON="0"') if mode == "relative" else xml)
    address = f"kuka+rsi://10.1.2.3:49152?ethernet=rsi.xml&eki=172.31.1.147:54600&mode={mode}&cycle={cycle}"
    made = files_for(Address.parse(address), tmp_path, {})
    rsi_on = f"RSI_ON(#{mode.upper()},#{cycle.upper()})"
    assert re.findall(r"RSI_ON\([^)]*\)", made["cellctl.src"]) == [rsi_on]
    assert all(rsi_on in made[name] for name in ("cellctl.rsix", "cellctl.rsi.xml", "README.txt"))
    assert f"corrections {mode}" in made["README.txt"]
    assert length in " ".join(made["README.txt"].split())
    hello = Controller(made).reply(write_command(7, "HELLO")).ident
    assert f"RSI_ON(#{hello['Correction']},#{hello['Cycle']})" == rsi_on


@pytest.mark.long
def test_an_error_in_the_configuration_is_named_and_nothing_written(tmp_path: Path) -> None:
    cell = tmp_path / "cell.yaml"
    text = CELL.read_text().replace("../robots/", f"{ROOT}/procedures/robots/")
    cell.write_text(text)
    (tmp_path / "rsi_ethernet.xml").write_text("<ROOT><CONFIG/></ROOT>")
    done = cellctl("krl", cell, "-o", tmp_path / "krc")
    assert done.returncode == 2
    assert "SENTYPE is missing" in done.stderr
    assert not (tmp_path / "krc").exists()


@pytest.mark.long
def test_the_files_are_ascii_with_the_line_ends_of_windows(tmp_path: Path) -> None:
    done = cellctl("krl", CELL, "-o", tmp_path / "krc")
    assert done.returncode == 0, done.stderr
    for file in (tmp_path / "krc").iterdir():
        content = file.read_bytes()
        assert content.count(b"\n") == content.count(b"\r\n") > 10
        assert content.isascii()
        assert max(map(len, content.splitlines())) <= 120


@cache
def sums() -> Krl:
    made = files_for(ADDRESS, CELL.parent, {})
    krl = Krl([made["cellctl_sum.src"], made["cellctl_sub.dat"]], {"STRLEN": lambda place: len(place.get())})
    krl.call("CC_MAKE_TABLE")
    return krl


@settings(max_examples=40)
@given(st.text(st.characters(min_codepoint=32, max_codepoint=126), min_size=0, max_size=40))
def test_the_sum_of_a_text_is_that_of_zlib(text: str) -> None:
    krl = sums()
    total = krl.call("CC_CRC", -1, Text(map(ord, text)))
    krl.call("CC_HEX", ~total)
    assert str(krl.variables["CC_DIGITS"]) == f"{zlib.crc32(text.encode()):08X}"


def test_hello_says_who_the_controller_is(controller: Controller) -> None:
    reply = controller.reply(write_command(7, "HELLO"))
    assert (reply.id, reply.code) == (7, 0)
    who = {"Serial": str(SERIAL), "Model": "KR5", "KSS": "KSS8.6", "Version": "1"}
    assert reply.ident == who | {"Correction": "ABSOLUTE", "Cycle": "IPO_FAST"}
    assert reply.joints == (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)


def test_a_move_is_handed_to_the_robot_program_and_answered_when_it_is_done(controller: Controller) -> None:
    said = controller.take(write_command(8, "PTP", point_to_point((10.0, -90.0, 90.5, 0.0, 45.0, 1.0), 12.7)))
    assert [stat.program for stat in said if isinstance(stat, Stat)] == ["MOVING"]
    assert not [reply for reply in said if isinstance(reply, Reply)]
    variables = controller.krl.variables
    assert variables["CC_PERCENT"] == 12
    assert variables["CC_TARGET"] == {"A1": 10.0, "A2": -90.0, "A3": 90.5, "A4": 0.0, "A5": 45.0, "A6": 1.0}
    assert variables["$FLAG"][402,]
    assert controller.reply(write_command(9, "PTP", point_to_point((0.0,) * 6, 10.0))).code == 10
    variables["CC_OUTCOME"], variables["$FLAG"][405,] = 0, True
    said = controller.cycle()
    assert [(said.id, said.code) for said in said if isinstance(said, Reply)] == [(8, 0)]


@pytest.mark.parametrize(
    ("joints", "speed", "mode", "code"),
    [
        ((171.0, 0.0, 0.0, 0.0, 0.0, 0.0), 10.0, "#EX", 20),
        ((0.0,) * 6, 0.0, "#EX", 21),
        ((0.0,) * 6, 100.5, "#EX", 21),
        ((0.0,) * 6, 10.0, "#T1", 12),
    ],
)
def test_a_move_that_must_not_be_is_refused(
    controller: Controller, joints: tuple[float, ...], speed: float, mode: str, code: int
) -> None:
    controller.krl.variables["$MODE_OP"] = mode
    assert controller.reply(write_command(8, "PTP", point_to_point(joints, speed))).code == code
    assert not controller.krl.variables["$FLAG"][402,]


def test_halt_ends_the_command_with_30_and_is_answered_after_it(controller: Controller) -> None:
    controller.take(write_command(8, "RSI"))
    controller.krl.variables["$FLAG"][404,] = True
    assert [(said.id, said.code) for said in controller.cycle() if isinstance(said, Reply)] == [(8, 1)]
    controller.take(write_command(9, "HALT"))
    variables = controller.krl.variables
    assert variables["$FLAG"][403,]
    variables["CC_OUTCOME"], variables["$FLAG"][404,], variables["$FLAG"][405,] = 30, False, True
    said = controller.cycle()
    assert [(said.id, said.code) for said in said if isinstance(said, Reply)] == [(8, 30), (9, 0)]
    assert [stat.program for stat in said if isinstance(stat, Stat)] == ["STOPPED"]


def job_begun(controller: Controller, number: int, operation: str, content: str = "") -> int:
    """The job that a command hands to the robot program; 0 for none. It is answered at its end."""
    variables = controller.krl.variables
    assert not [said for said in controller.take(write_command(number, operation, content)) if isinstance(said, Reply)]
    job = variables["CC_JOB"] if variables["$FLAG"][402,] else 0
    return int(job)


def end_job(controller: Controller, *, corrected: bool) -> list[tuple[int, int]]:
    """The robot program ends its job; ids and codes of the replies. `corrected`: whether RSI stays on."""
    variables = controller.krl.variables
    variables["CC_CORR"], variables["CC_OUTCOME"] = corrected, 0
    variables["$FLAG"][402,], variables["$FLAG"][405,] = False, True
    return [(said.id, said.code) for said in controller.cycle() if isinstance(said, Reply)]


def test_on_line_correction_stays_on_beside_moves_and_own_programs_until_it_is_ended(controller: Controller) -> None:
    variables = controller.krl.variables
    variables["CC_OWN_COUNT"] = 2
    assert job_begun(controller, 8, "CORRON") == 3
    assert end_job(controller, corrected=True) == [(8, 0)]
    assert [controller.reply(write_command(9, operation)).code for operation in ("CORRON", "RSI")] == [10, 10]
    assert job_begun(controller, 10, "PTP", point_to_point((10.0,) * 6, 5.0)) == 1
    assert end_job(controller, corrected=True) == [(10, 0)]
    assert (job_begun(controller, 11, "OWN", '<Row N="2"/>'), variables["CC_OWN_N"]) == (5, 2)
    assert end_job(controller, corrected=True) == [(11, 0)]
    assert job_begun(controller, 12, "CORROFF") == 4
    assert end_job(controller, corrected=False) == [(12, 0)]
    assert job_begun(controller, 13, "RSI") == 2


@pytest.mark.parametrize("number", [0, 3])
def test_an_own_program_that_there_is_not_is_refused(controller: Controller, number: int) -> None:
    controller.krl.variables["CC_OWN_COUNT"] = 2
    assert controller.reply(write_command(8, "OWN", f'<Row N="{number}"/>')).code == 42
    assert controller.reply(write_command(9, "OWN")).code == 11
    assert not controller.krl.variables["$FLAG"][402,]


def test_halt_and_a_lost_connection_end_the_correction_of_a_robot_that_stands(controller: Controller) -> None:
    variables = controller.krl.variables
    job_begun(controller, 8, "CORRON")
    end_job(controller, corrected=True)
    assert job_begun(controller, 9, "HALT") == 4
    assert end_job(controller, corrected=False) == [(9, 0)]
    job_begun(controller, 10, "CORRON")
    end_job(controller, corrected=True)
    variables["$FLAG"][401,] = False
    controller.cycle()
    assert (variables["CC_JOB"], variables["$FLAG"][402,]) == (4, True)
    assert end_job(controller, corrected=False) == []


class Resumed(Exception):
    """The interrupt's RESUME: the job is given up where it is."""


def test_a_halt_right_behind_rsi_on_switches_rsi_off(made: dict[str, str]) -> None:
    called = []

    def rsi_on(*mode_and_cycle: str) -> int:
        called.append("on")
        raise Resumed

    builtins = {"RSI_CREATE": lambda *_: 0, "RSI_ON": rsi_on, "RSI_DELETE": lambda *_: 0}
    builtins["RSI_OFF"] = lambda: called.append("off") or 0
    krl = Krl([made["cellctl.src"], made["cellctl.dat"]], builtins)
    krl.variables |= {"RSIOK": 0, "$FLAG": {(404,): False}, "$TECHPAR_C": {}}
    with pytest.raises(Resumed):
        krl.call("CC_BEGIN_RSI")
    krl.call("CC_CLEAR")
    assert called == ["on", "off"]


def test_each_rsi_session_has_a_mark_of_its_own_before_it_is_switched_on(made: dict[str, str]) -> None:
    marks = []
    builtins = {"RSI_CREATE": lambda *_: 0, "RSI_ON": lambda *_: marks.append(dict(parameters)) or 0}
    krl = Krl([made["cellctl.src"], made["cellctl.dat"]], builtins)
    krl.variables |= {"RSIOK": 0, "$TECHPAR_C": (parameters := {})}
    for krl.variables["CC_MARK"] in (0, 1, 9999):
        krl.call("CC_BEGIN_RSI")
    assert marks == [{(2, 1): mark, (2, 2): -mark} for mark in (1, 2, 1)]
    assert '<ELEMENT TAG="DEF_Tech.C2" TYPE="DOUBLE" INDX="INTERNAL"/>' in made["rsi_ethernet.xml"]


@pytest.mark.parametrize("operation", ["PTP", "HALT"])
def test_a_command_that_ended_with_a_message_is_not_begun_after_reset(controller: Controller, operation: str) -> None:
    variables = controller.krl.variables
    variables["CC_CORR"] = operation == "HALT"
    assert job_begun(controller, 8, operation, point_to_point((10.0,) * 6, 5.0) if operation == "PTP" else "")
    variables["$STOPMESS"], variables["$PRO_STATE1"] = True, "#P_STOP"
    assert [said.code for said in controller.cycle() if isinstance(said, Reply)] == [31]
    assert controller.reply(write_command(9, "RESET")).code == 0
    assert not variables["$FLAG"][402,]


def test_a_lost_connection_halts_what_moves(controller: Controller) -> None:
    controller.take(write_command(8, "PTP", point_to_point((0.0,) * 6, 10.0)))
    controller.krl.variables["$FLAG"][401,] = False
    controller.cycle()
    assert controller.krl.variables["$FLAG"][403,]


def test_a_message_ends_the_command_with_31_and_stands_until_reset(controller: Controller) -> None:
    variables = controller.krl.variables
    controller.take(write_command(8, "RSI"))
    variables["$STOPMESS"], variables["$PRO_STATE1"], variables["$ROB_STOPPED"] = True, "#P_STOP", False
    said = controller.cycle()
    assert [(stat.program, stat.message) for stat in said if isinstance(stat, Stat)] == [("ERROR", "KSS29002")]
    assert not [reply for reply in said if isinstance(reply, Reply)], "the robot does not stand yet"
    variables["$ROB_STOPPED"] = True
    replies = [said for said in controller.cycle() if isinstance(said, Reply)]
    assert [(reply.id, reply.code, reply.text) for reply in replies] == [(8, 31, "KSS29002")]
    assert controller.reply(write_command(9, "RSI")).code == 12
    assert controller.reply(write_command(10, "RESET")).code == 0
    assert variables["$PRO_STATE1"] == "#P_ACTIVE"
    controller.take(write_command(11, "RSI"))
    assert variables["$FLAG"][402,]


def test_whoever_connects_next_hears_nothing_of_the_command_before(controller: Controller) -> None:
    flags = controller.krl.variables["$FLAG"]
    controller.take(write_command(8, "RSI"))
    flags[401,] = False
    controller.cycle()
    flags[401,], flags[404,] = True, True
    assert not [said for said in controller.cycle() if isinstance(said, Reply)]
    controller.krl.variables["CC_OUTCOME"], flags[404,], flags[405,] = 30, False, True
    said = controller.cycle()
    assert [type(part) for part in said] == [Stat]
    assert controller.reply(write_command(1, "HALT")).code == 0


def test_an_operation_that_nobody_knows_is_refused(controller: Controller) -> None:
    assert controller.reply(write_command(8, "JUMP")).code == 11


def test_a_table_is_staged_read_back_activated_and_moved_to(controller: Controller) -> None:
    stage(controller, "aa")
    root = controller.raw(write_command(5, "TREAD", '<Block First="11" Count="2"/>'))
    head = root.find("Block")
    assert head is not None
    assert head.get("Sum") == checksum(11, ROWS[10:12])
    read = [[float(part.get(f"A{axis}", "")) for part in row for axis in range(1, 7)] for row in root.iterfind("R")]
    assert read == [pytest.approx([*row[0], *row[1]], abs=1e-9) for row in ROWS[10:12]]
    assert controller.reply(activation("aa")).code == 0
    assert roles(controller) == {"Active": "aa"}
    assert controller.reply(activation("aa")).code == 0
    controller.take(write_command(6, "PTPT", '<Vel P="10.0"/><Row N="12"/>'))
    target = controller.krl.variables["CC_TARGET"]
    assert [target[f"A{axis}"] for axis in range(1, 7)] == pytest.approx(ROWS[11][1])


STATEMENTS_S = 1000
"""Statements a second of a controller so slow that it takes six seconds for a block of the driver's."""


@pytest.mark.parametrize("operation", ["TBLOCK", "TREAD"])
def test_a_slow_controller_is_heard_of_all_the_time_and_answers_the_drivers_block_in_time(
    controller: Controller, operation: str
) -> None:
    rows = BLOCK_ROWS
    stage(controller, "aa", ROWS[:rows])
    if operation == "TBLOCK":
        table = f'<Table Id="bb" Serial="{SERIAL}" Rows="{rows}" Sum="{checksum(1, ROWS[:rows])}"/>'
        assert controller.reply(write_command(1, "TSTAGE", table)).code == 0
    variables, words_s, ticks = controller.krl.variables, [0.0], itertools.count()
    began = variables["$ROB_TIMER"]

    def pass_time() -> None:
        variables["$ROB_TIMER"] = began + next(ticks) * 1000 // STATEMENTS_S

    def send(*arguments: Place) -> None:
        words_s.append((variables["$ROB_TIMER"] - began) / 1000)
        Controller._eki_send(controller, *arguments)

    controller.krl.on_statement = pass_time
    controller.krl.builtins["EKI_SEND"] = send
    read = write_command(5, "TREAD", f'<Block First="1" Count="{rows}"/>')
    assert controller.reply(block(2, 1, ROWS[:rows]) if operation == "TBLOCK" else read).code == 0
    assert max(b - a for a, b in itertools.pairwise(words_s)) < SILENCE_S / 4
    assert SILENCE_S < words_s[-1] < ANSWER_S


@pytest.mark.long
def test_the_table_before_comes_back_and_a_staged_one_does_not_survive_a_restart(controller: Controller) -> None:
    stage(controller, "aa")
    controller.reply(activation("aa"))
    stage(controller, "bb", ROWS[:3])
    controller.reply(activation("bb", ROWS[:3]))
    assert roles(controller) == {"Active": "bb", "Previous": "aa"}
    assert controller.reply(write_command(9, "TROLLBACK")).code == 0
    stage(controller, "cc", ROWS[:2])
    assert roles(controller) == {"Active": "aa", "Previous": "bb", "Staged": "cc"}
    controller.krl.call("CC_INIT")
    assert roles(controller) == {"Active": "aa", "Previous": "bb"}


def test_what_a_table_is_refused_for(controller: Controller) -> None:
    def code(number: int, operation: str, content: str) -> int:
        return controller.reply(write_command(number, operation, content)).code

    assert code(1, "TSTAGE", '<Table Id="x" Serial="1" Rows="2" Sum="00000000"/>') == 40
    assert code(1, "TSTAGE", f'<Table Id="x" Serial="SIM-{SERIAL}" Rows="2" Sum="00000000"/>') == 40
    assert code(1, "TSTAGE", f'<Table Id="x" Serial="{SERIAL}" Rows="501" Sum="00000000"/>') == 43
    assert controller.reply(block(2, 1, ROWS[:2])).code == 42
    assert code(3, "TROLLBACK", "") == 42
    assert code(4, "PTPT", '<Vel P="10.0"/><Row N="1"/>') == 42
    table = f'<Table Id="x" Serial="{SERIAL}" Rows="4" Sum="{checksum(1, ROWS[:4])}"/>'
    assert code(5, "TSTAGE", table) == 0
    assert controller.reply(block(6, 2, ROWS[1:3])).code == 42
    assert controller.reply(block(6, 1, ROWS[:2]).replace(b"-90.4", b"-90.5")).code == 41
    assert controller.reply(block(7, 1, ROWS[:2])).code == 0
    assert controller.reply(block(7, 1, ROWS[:2])).code == 0
    assert controller.reply(activation("x", ROWS[:4])).code == 42
    assert controller.reply(block(8, 3, ROWS[2:4])).code == 0
    assert controller.reply(activation("x", ROWS[:3])).code == 41
    assert controller.reply(activation("y", ROWS[:4])).code == 41
    assert controller.reply(activation("x", ROWS[:4])).code == 0


@pytest.mark.long
def test_the_driver_pushes_reads_back_and_rolls_back_a_table_on_these_programs(controller: Controller) -> None:
    table = ControllerTable("ab" * 32, str(SERIAL), tuple(TableRow(tuple(a), tuple(b)) for a, b in ROWS))

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        stream = DocumentStream()
        while data := await reader.read(4096):
            for document in stream.feed(data):
                controller.take(document)
                writer.write(controller.sent)
        writer.close()

    async def push() -> tuple[TableState, ControllerTable | None, TableState]:
        server = await asyncio.start_server(serve, "127.0.0.1", 0)
        eki = EkiChannel("robot", server.sockets[0].getsockname()[:2], WallClock())
        await eki.open()
        try:
            tables = TableChannel("robot", eki, str(SERIAL))
            return await tables.push(table), await tables.read(), await tables.rollback()
        finally:
            await eki.close()
            server.close()
            await server.wait_closed()

    pushed, read, after = asyncio.run(push())
    info = TableInfo(table.id, len(ROWS), checksum(1, ROWS))
    assert (pushed.active, pushed.staged) == (info, None)
    assert read is not None
    assert [row.compensated for row in read.rows] == [tuple(round(a, 6) for a in row.compensated) for row in table.rows]
    assert (after.active, after.previous) == (None, info)

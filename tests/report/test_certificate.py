"""A run as Digital Calibration Certificate: what it states, what it refuses, and other programs that read it."""

import os
import re
import sys
from pathlib import Path
from unittest.mock import MagicMock
from xml.etree import ElementTree as ET

import pytest

from cellctl.cli import exit_codes
from cellctl.cli.exit_codes import Exit
from cellctl.cli.verbs import app
from cellctl.files import InputError
from cellctl.operations.export import Form, export_run
from cellctl.report import assessed_run

FACTS = """
report:
  customer: ACME & Sons
  site: hall 3
  order: "0815"
  laboratory: ACME, metrology
  responsible: Ada Muster
  country: DE
  calibrated:
    artefact: {date: 2026-01-15, certificate: C-1203, serial: B-17}
  sigma_mm: {artefact: 0.003}
acceptance: [{limit_mm: 0.05, measurand: mean}]
"""
SPACES = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}
SCHEMAS = os.environ.get("CELLCTL_DCC_SCHEMAS")
"""A folder with dcc.xsd 3.3.0, and SI_Format.xsd and xmldsig-core-schema.xsd, which it imports, as PTB publishes them.
They are under the LGPL, and no package ships them."""


@pytest.fixture(scope="module")
def run(make_run_once, campaign):
    return make_run_once(campaign, cell=FACTS)


@pytest.fixture(scope="module")
def certificate(run):
    return export_run(run, Form.DCC).content


@pytest.fixture(scope="module")
def root(certificate):
    return ET.fromstring(certificate)


def texts(root, path):
    return [each.text for each in root.findall(path, SPACES)]


def test_the_figure_has_its_expanded_uncertainty_factor_and_coverage(run, root):
    figure = assessed_run(run).acceptance.figure
    real = root.find(".//dcc:quantity[@refType='basic_measuredValue']/si:real", SPACES)
    assert float(real.find("si:value", SPACES).text) == pytest.approx(figure.value_mm, rel=1e-5)
    assert real.find("si:unit", SPACES).text == r"\milli\metre"
    stated = real.find("si:measurementUncertaintyUnivariate/si:expandedMU", SPACES)
    assert [float(each.text) for each in stated] == pytest.approx([figure.expanded_mm, figure.factor, 0.95], rel=1e-5)


def test_parties_robot_and_instruments_are_named(root):
    assert texts(root, ".//dcc:calibrationLaboratory//dcc:name/dcc:content") == ["ACME, metrology"]
    assert texts(root, ".//dcc:customer/dcc:name/dcc:content") == ["ACME & Sons"]
    assert texts(root, ".//dcc:respPerson/dcc:person/dcc:name/dcc:content") == ["Ada Muster", "somebody"]
    assert texts(root, ".//dcc:item//dcc:identification/dcc:value") == ["SIM-1", "8.6"]
    assert texts(root, ".//dcc:measuringEquipment//dcc:value") == ["B-17", "C-1203"]
    assert texts(root, ".//dcc:coreData/dcc:beginPerformanceDate") == ["2026-11-21"]


def test_conditions_are_stated_or_said_to_be_not_recorded(root):
    names = texts(root, ".//dcc:influenceCondition/dcc:name/dcc:content")
    assert dict(zip(names, texts(root, ".//dcc:influenceCondition/dcc:data//dcc:content"), strict=True)) == {
        **dict.fromkeys(("air temperature", "air pressure", "relative humidity", "robot temperature"), "not recorded")
    }


def test_it_claims_no_accreditation_and_says_that_a_robot_was_simulated(root):
    words = texts(root, ".//dcc:statement/dcc:declaration/dcc:content")
    assert words[0].startswith("This is no accredited calibration certificate")
    assert "simulated" in words[1]


def test_conformity_is_the_decision_of_the_acceptance(run, root):
    assert texts(root, ".//dcc:conformity") == ["pass"]
    failed = ET.fromstring(export_run(run, Form.DCC, {"limit_mm": 0.001}).content)
    assert texts(failed, ".//dcc:conformity") == ["fail"]
    value = assessed_run(run).acceptance.value_mm
    undecided = ET.fromstring(export_run(run, Form.DCC, {"limit_mm": value}).content)
    assert texts(undecided, ".//dcc:conformity") == []
    assert "No decision:" in texts(undecided, ".//dcc:metaData/dcc:declaration/dcc:content")[0]


def test_the_same_run_gives_the_same_bytes(run, certificate):
    assert export_run(run, Form.DCC).content == certificate


def test_text_that_xml_cannot_hold_is_left_out(run):
    content = export_run(run, Form.DCC, {"customer": "AC\x00ME\x1b \n <b>"}).content
    assert texts(ET.fromstring(content), ".//dcc:customer/dcc:name/dcc:content") == ["ACME <b>"]


def test_all_that_a_certificate_lacks_is_named_at_once(make_run, campaign):
    with pytest.raises(InputError) as refused:
        export_run(make_run(campaign, ended="aborted"), Form.DCC)
    for words in ("`laboratory`", "`responsible`", "`customer`", "`country`", "no measured error"):
        assert words in str(refused.value)


def test_the_command_line_states_what_the_cell_file_does_not(make_run, campaign, tmp_path):
    place, out = make_run(campaign), tmp_path / "dcc.xml"
    words = ["export", str(place), "--as", "dcc", "-o", str(out)]
    assert exit_codes.exit_code_of(lambda: app(words, standalone_mode=False)) == Exit.BAD_INPUT
    assert not out.exists()
    for name in ("laboratory=L", "responsible=R", "customer=C", "country=CH"):
        words += ["--set", name]
    assert exit_codes.exit_code_of(lambda: app(words, standalone_mode=False)) == Exit.GOOD
    assert texts(ET.parse(out).getroot(), ".//dcc:calibrationLaboratory//dcc:countryCode") == ["CH"]


@pytest.mark.parametrize("text", ["country=Germany", "limit_mm=3", "nonsense"])
def test_a_fact_that_is_none_is_refused(run, text):
    words = ["export", str(run), "--as", "dcc", "--set", text]
    assert exit_codes.exit_code_of(lambda: app(words, standalone_mode=False)) == Exit.BAD_INPUT


def test_pydcc_reads_it(certificate, run, monkeypatch):
    # its library of certificate chains does not know OpenSSL 3.0.10 and newer, and is for signatures alone
    monkeypatch.setitem(sys.modules, "certvalidator", MagicMock())
    dcc = pytest.importorskip("dcc.dcc", reason="pydcc is of the group peers")
    monkeypatch.setattr(dcc, "DCCXMLValidator", lambda: None)  # it fetches the schemas of PTB
    read = dcc.DCC(byte_array=certificate)
    assert read.version() == "3.3.0"
    assert read.calibration_laboratory_name() == "ACME, metrology"
    assert read.mandatory_language() == "en"
    assert read.calibration_date().isoformat()[:10] == "2026-11-21"
    assert not read.has_previous_report()
    found = {name.strip(): data for name, data in read.get_calibration_results("name", "en")}
    (stated,) = [each["real"] for each in found.values() if "measurementUncertaintyUnivariate" in each["real"]]
    expanded = stated["measurementUncertaintyUnivariate"]["expandedMU"]
    assert float(expanded["valueExpandedMU"]) == pytest.approx(
        assessed_run(run).acceptance.figure.expanded_mm, rel=1e-5
    )


@pytest.mark.filterwarnings("ignore:open_text is deprecated", "ignore:Key .* is doubled")
def test_it_is_the_same_after_a_round_trip_through_json(run):
    """dccXMLJSONConv knows names, types and repetitions of elements by PTB's schema. It does not escape `&` and `<`."""
    text = re.sub(r"&\w+;", "", export_run(run, Form.DCC).content.decode())
    module = pytest.importorskip("dccXMLJSONConv.dccConv", reason="dccXMLJSONConv is of the group peers")
    back = module.JSONToXML(module.XMLToJson(text))
    assert ET.canonicalize(back, strip_text=True) == ET.canonicalize(text, strip_text=True)


@pytest.mark.filterwarnings("ignore:open_text is deprecated")
def test_leaves_are_elements_of_the_schema(root):
    module = pytest.importorskip("dccXMLJSONConv.typeCastDictCreator", reason="dccXMLJSONConv is of the group peers")
    known, lists, _ = module.XSDParserCacheWrapper().parse_with_cache("https://ptb.de/dcc/v3.3.0/dcc.xsd")
    prefixes = {uri: prefix for prefix, uri in SPACES.items()}
    leaves = {each.tag for each in root.iter() if not len(each)}
    names = {f"{prefixes[tag[1:].partition('}')[0]]}:{tag.partition('}')[2]}" for tag in leaves}
    of_no_simple_type = {"dcc:content", "dcc:issuer", "dcc:type", "dcc:performanceLocation"}
    assert names - of_no_simple_type <= known.keys() | lists.keys()


@pytest.mark.skipif(not SCHEMAS, reason="CELLCTL_DCC_SCHEMAS names no folder with PTB's schemas")
def test_it_is_valid_by_ptbs_schema(certificate):
    xmlschema = pytest.importorskip("xmlschema", reason="xmlschema comes with the group peers")
    folder = Path(SCHEMAS or "")
    places = {
        "https://ptb.de/si": str(folder / "SI_Format.xsd"),
        "http://www.w3.org/2000/09/xmldsig#": str(folder / "xmldsig-core-schema.xsd"),
    }
    xmlschema.XMLSchema(str(folder / "dcc.xsd"), locations=places).validate(certificate.decode())

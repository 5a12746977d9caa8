"""A run as Digital Calibration Certificate: XML by PTB's schema 3.3.0 (https://ptb.de/dcc) with D-SI quantities.

It states what the journal has. It is not signed and claims no accreditation.
"""

from __future__ import annotations

import datetime
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final
from uuid import UUID, uuid5
from xml.etree import ElementTree as ET

from cellctl.devices.cell import ARTEFACT
from cellctl.files import InputError, Problem
from cellctl.journal import PushedTable
from cellctl.metrology.acceptance import COVERAGE, MeasuredFigure
from cellctl.report import Run, assessed_run
from cellctl.report.acceptance import CONTAINED, NAMES, NOT_CONTAINED, RULE, Acceptance
from cellctl.version import __version__

SCHEMA: Final = "3.3.0"
_DCC, _SI, _XSI = "https://ptb.de/dcc", "https://ptb.de/si", "http://www.w3.org/2001/XMLSchema-instance"
_NAMESPACE = UUID("0d1f6a0e-8f1c-5c1c-9b36-63656c6c6374")
_ROBOT = "robot"

NO_ACCREDITATION: Final = (
    "This is no accredited calibration certificate: it claims no accreditation, and no accreditation body has assessed "
    "the calibration. It is not signed. Its results are traceable to the SI as far as the calibrations of the "
    "instruments that it names are."
)
SIMULATED: Final = "Devices of this run were simulated: the results are of no real robot."

_CONFORMITY = {"accepted": "pass", "rejected": "fail"}
"""Without a decision neither is proved, and the schema has no word for that: the declaration says so."""

_STATED = ("laboratory", "responsible", "customer", "country")
"""Fields of the cell file's `report:` that a certificate cannot do without."""


def certificate(place: Path, facts: Mapping[str, Any]) -> bytes:
    """The certificate of the run in `place`. facts: fields of `report:` in place of the cell file's.

    Raises InputError, with all that is missing, unless the run finished, its figure of errors has an uncertainty, and
    laboratory, responsible, customer and country are stated; JournalError if the journal cannot be read.
    """
    assessed = assessed_run(place, facts)
    run, found = assessed.run, assessed.acceptance
    _refuse_incomplete(run, found)
    root = ET.Element(f"{{{_DCC}}}digitalCalibrationCertificate", {"schemaVersion": SCHEMA})
    root.set(f"{{{_XSI}}}schemaLocation", f"{_DCC} {_DCC}/v{SCHEMA}/dcc.xsd")
    _administration(root, run)
    _result(root, run, found, assessed.environment)
    for prefix, uri in (("dcc", _DCC), ("si", _SI), ("xsi", _XSI)):
        ET.register_namespace(prefix, uri)
    ET.indent(root)
    text: str = ET.tostring(root, encoding="unicode")
    return f"<?xml version='1.0' encoding='UTF-8'?>\n{text}\n".encode()


def _refuse_incomplete(run: Run, found: Acceptance) -> None:
    problems = []
    for name in _STATED:
        if not _plain(getattr(run.facts, name)):
            cure = f"write it in the cell file under `report:`, or give --set {name}=…"
            problems.append(Problem(run.name, 0, 0, f"a certificate needs `{name}`, which is not stated", cure))
    if found.figure is None:
        reason = found.reason if found.limit_mm is not None else "the run has no measured error with an uncertainty"
        problems.append(Problem(run.name, 0, 0, f"a certificate states an expanded uncertainty: {reason}", ""))
    if problems:
        raise InputError(problems)


def _add(parent: ET.Element, name: str, text: object = None, **attributes: str) -> ET.Element:
    """A child of the certificate's namespace."""
    child = ET.SubElement(parent, f"{{{_DCC}}}{name}", attributes)
    if text is not None:
        child.text = _plain(str(text))
    return child


def _plain(text: str) -> str:
    """In one line, without what XML cannot hold."""
    return "".join(letter for letter in " ".join(text.split()) if letter.isprintable()).strip()


def _text(parent: ET.Element, name: str, *contents: str) -> ET.Element:
    """A `textType` or `richContentType` in English."""
    child = _add(parent, name)
    for content in contents:
        _add(child, "content", content, lang="en")
    return child


def _contact(parent: ET.Element, name: str, who: str, country: str, further: str = "") -> None:
    contact = _add(parent, name)
    _text(contact, "name", who)
    location = _add(contact, "location")
    _add(location, "countryCode", country)
    if further:
        _text(location, "further", further)


def _identified(parent: ET.Element, numbers: Iterable[tuple[str, str, str]]) -> None:
    """issuer, value and name of each number that is known."""
    known = [each for each in numbers if _plain(each[1])]
    if known:
        listed = _add(parent, "identifications")
        for issuer, value, name in known:
            number = _add(listed, "identification")
            _add(number, "issuer", issuer)
            _add(number, "value", value)
            _text(number, "name", name)


def _administration(root: ET.Element, run: Run) -> None:
    data, facts = _add(root, "administrativeData"), run.facts
    _software(_add(data, "dccSoftware"))
    _core(data, run)
    _item(data, run)
    _contact(_add(data, "calibrationLaboratory"), "contact", facts.laboratory, facts.country)
    _persons(data, run)
    _contact(data, "customer", facts.customer, facts.country, facts.site)
    statements = _add(data, "statements")
    for name, words in (("accreditation", NO_ACCREDITATION), *((("simulation", SIMULATED),) if run.simulated else ())):
        statement = _add(statements, "statement")
        _text(statement, "name", name)
        _text(statement, "declaration", words)


def _software(listed: ET.Element) -> None:
    software = _add(listed, "software")
    _text(software, "name", "cellctl")
    _add(software, "release", f"v{__version__}")
    _add(software, "type", "application")


def _core(data: ET.Element, run: Run) -> None:
    core, facts = _add(data, "coreData"), run.facts
    began, ended = _days(run)
    _add(core, "countryCodeISO3166_1", facts.country)
    _add(core, "usedLangCodeISO639_1", "en")
    _add(core, "mandatoryLangCodeISO639_1", "en")
    _add(core, "uniqueIdentifier", uuid5(_NAMESPACE, f"{run.name} {began}"))
    _identified(core, [("calibrationLaboratory", run.name, "run"), ("customer", facts.order, "order")])
    _add(core, "beginPerformanceDate", began)
    _add(core, "endPerformanceDate", ended)
    _add(core, "performanceLocation", "customer")


def _days(run: Run) -> tuple[str, str]:
    """First and last day, UTC: the last by the cell's time since the start, or of a resumption if that is later."""
    started = run.state.started
    began = datetime.datetime.fromisoformat(started.calendar if started else run.state.calendar)
    seconds = max(0, run.state.last_ns - run.state.first_ns) * 1e-9
    resumed = datetime.datetime.fromisoformat(run.state.calendar)
    return began.date().isoformat(), max(began + datetime.timedelta(seconds=seconds), resumed).date().isoformat()


def _item(data: ET.Element, run: Run) -> None:
    who = run.state.identities.get(_ROBOT, {})
    name = run.model.robot.name if run.model else str(who.get("model") or _ROBOT)
    item = _add(_add(data, "items"), "item")
    _text(item, "name", f"Robot {name}")
    if who.get("model"):
        _add(item, "model", who["model"])
    table = PushedTable.of(run.state)
    numbers = [
        ("manufacturer", str(who.get("serial") or "not reported"), "serial number"),
        ("manufacturer", str(who.get("firmware") or ""), "firmware of the controller"),
    ]
    if table and table.row.active:
        numbers.append(("calibrationLaboratory", table.row.id, "compensation table in force"))
    _identified(item, numbers)


def _persons(data: ET.Element, run: Run) -> None:
    started = run.state.started
    operator = run.facts.operator or (started.operator if started else "")
    persons = _add(data, "respPersons")
    for who, role in ((run.facts.responsible, "responsible for the calibration"), (operator, "operator")):
        if _plain(who):
            person = _add(persons, "respPerson")
            _text(_add(person, "person"), "name", who)
            _add(person, "role", role)


def _method(result: ET.Element, run: Run) -> None:
    method, started = _add(_add(result, "usedMethods"), "usedMethod"), run.state.started
    _text(method, "name", run.title)
    if started:
        _text(method, "description", f"file {Path(started.procedure.path).name}, SHA-256 {started.procedure.sha256}")


def _equipment(result: ET.Element, run: Run) -> None:
    known = {name: dict(who) for name, who in run.state.identities.items() if name != _ROBOT}
    if run.artefact is not None:
        known[ARTEFACT] = {"model": f"artefact with {len(run.artefact.spheres)} spheres"}
    if not known:
        return
    listed = _add(result, "measuringEquipments")
    for name, who in known.items():
        calibrated = run.facts.calibrated.get(name)
        each = _add(listed, "measuringEquipment")
        _text(each, "name", name)
        if calibrated:
            _text(each, "description", f"calibrated on {calibrated.date}")
        if who.get("model"):
            _add(each, "model", who["model"])
        serial = (calibrated.serial if calibrated else "") or str(who.get("serial") or "")
        number = calibrated.certificate if calibrated else ""
        _identified(
            each, [("manufacturer", serial, "serial number"), ("other", number, "certificate of the calibration")]
        )


def _conditions(result: ET.Element, environment: Mapping[str, str]) -> None:
    listed = _add(result, "influenceConditions")
    for name, words in environment.items():
        condition = _add(listed, "influenceCondition")
        _text(condition, "name", name)
        _text(_add(condition, "data"), "text", words)


def _result(root: ET.Element, run: Run, found: Acceptance, environment: Mapping[str, str]) -> None:
    result, figure = _add(_add(root, "measurementResults"), "measurementResult"), found.figure
    assert figure is not None  # refused before
    missing = f" Not stated, so not contained: {'; '.join(found.missing)}." if found.missing else ""
    _text(result, "name", f"Position error of the robot: {NAMES[found.measurand]}")
    _text(
        result,
        "description",
        f"{NAMES[found.measurand].capitalize()} of {figure.n} measured errors of the position at places that the "
        f"identification did not use. U contains {CONTAINED[found.measurand]}. It does not contain {NOT_CONTAINED}."
        + missing,
    )
    _method(result, run)
    _software(_add(result, "usedSoftware"))
    _equipment(result, run)
    _conditions(result, environment)
    one = _add(_add(result, "results"), "result")
    _text(one, "name", "Position errors")
    data = _add(one, "data")
    _quantity(data, NAMES[found.measurand], figure.value_mm, figure)
    after = run.verdict.after if run.verdict else None
    before = run.verdict.before if run.verdict else None
    for when, figures in (("before", before), ("after", after)):
        for name in ("mean", "rms", "max"):
            value = getattr(figures, name, None)
            if value is not None:
                _quantity(data, f"{name} of the errors {when} the calibration", value)
    if found.limit_mm is not None:
        _quantity(data, f"limit of the {NAMES[found.measurand]}", found.limit_mm)
        _quantity(data, "guard band", found.guard_band_mm)
        _conformity(result, found)


def _quantity(data: ET.Element, name: str, value_mm: float, figure: MeasuredFigure | None = None) -> None:
    """A length in mm; with the expanded uncertainty of `figure`."""
    quantity = _add(data, "quantity", **({"refType": "basic_measuredValue"} if figure else {}))
    _text(quantity, "name", name)
    real = ET.SubElement(quantity, f"{{{_SI}}}real")
    _si(real, "value", value_mm)
    _si(real, "unit", r"\milli\metre")
    if figure:
        uncertainty = ET.SubElement(real, f"{{{_SI}}}measurementUncertaintyUnivariate")
        expanded = ET.SubElement(uncertainty, f"{{{_SI}}}expandedMU")
        _si(expanded, "valueExpandedMU", figure.expanded_mm)
        _si(expanded, "coverageFactor", figure.factor)
        _si(expanded, "coverageProbability", COVERAGE)


def _si(parent: ET.Element, name: str, value: float | str) -> None:
    text = value if isinstance(value, str) else f"{value:.6g}"
    ET.SubElement(parent, f"{{{_SI}}}{name}").text = text


def _conformity(result: ET.Element, found: Acceptance) -> None:
    stated = _add(_add(result, "measurementMetaData"), "metaData", refType="basic_conformity")
    _text(stated, "name", "Conformity")
    _add(stated, "norm", "ISO 14253-1")
    _text(stated, "declaration", f"{found.word.capitalize()}: {found.reason}", RULE)
    if found.decided:
        _add(stated, "conformity", _CONFORMITY[found.word])

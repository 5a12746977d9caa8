"""What is wrong with an installed package that extends cellctl: its entry points, and what they lead to.

Nothing is connected. Each entry point is loaded as cellctl would load it, compared with its interface, and the
package's procedures and cells are checked as `cellctl check` does.
"""

from __future__ import annotations

import difflib
import inspect
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from importlib.metadata import EntryPoint
from pathlib import Path
from types import ModuleType
from typing import Any, final

from cellctl.calibration import Effect, kinds
from cellctl.clock import WallClock
from cellctl.compensation import METHODS
from cellctl.devices import Device
from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.files import InputError, Problem
from cellctl.formats.measurements import KINDS
from cellctl.installed import OBJECTS, files_beside, points_of
from cellctl.operations.cell_devices import simulation_errors
from cellctl.operations.checking import checked
from cellctl.procedure import StepKind, StepRegistry, checked_parameters, load_procedure
from cellctl.procedure.check import abilities_of
from cellctl.records import Row

_UNKNOWN_LIMIT = "not_a_limit_of_any_driver"


@final
@dataclass(frozen=True)
class CheckedPackage:
    """The entry points of a package, `group: name`, its procedures and cells, and all that is wrong."""

    package: str
    entry_points: tuple[str, ...]
    files: tuple[str, ...]
    problems: tuple[Problem, ...]


def check_package(name: str) -> CheckedPackage:
    """Check an installed package. Raises InputError if it is not installed, or extends nothing."""
    points = points_of(name)
    modules = sorted({point.module.partition(".")[0] for point in points})
    problems: list[Problem] = []
    for point in points:
        problems += _of_point(point)
    problems += _of_rows(modules)
    cells, procedures = files_beside(modules, "cell"), files_beside(modules, "procedure")
    for file in cells:
        problems += _of_cell(file, {point.name for point in points if point.group == "cellctl.devices"})
    for file in procedures:
        problems += _of_procedure(file)
    labels = tuple(f"{point.group}: {point.name}" for point in points)
    return CheckedPackage(name, labels, tuple(map(str, (*procedures, *cells))), tuple(dict.fromkeys(problems)))


def _of_point(point: EntryPoint) -> Iterator[Problem]:
    """An entry point, and its object if it can be loaded."""
    where = f"entry point {point.group}: {point.name} = {point.value}"
    if point.group not in OBJECTS:
        near = difflib.get_close_matches(point.group, OBJECTS, n=1)
        cure = f"did you mean {near[0]}?" if near else f"there are {', '.join(OBJECTS)}"
        yield Problem(where, 0, 0, "is in a group that cellctl does not read", cure)
        return
    try:
        found = point.load()
    except Exception as error:  # the code of another package may raise anything
        yield Problem(where, 0, 0, f"cannot be loaded: {type(error).__name__}: {error}", "import it in Python")
        return
    if type(found).__name__ != OBJECTS[point.group]:
        wanted = OBJECTS[point.group].replace("ABCMeta", "class derived from Effect")
        yield Problem(where, 0, 0, f"is a {type(found).__name__}, and a {wanted} is expected")
        return
    if check := _CHECKS.get(OBJECTS[point.group]):
        yield from check(point, found)


def _driver(point: EntryPoint, driver: Any) -> Iterator[Problem]:
    yield from _callable(point, "open", driver.open, "name", "address", "surroundings")
    yield from _undocumented(driver.abilities)
    missing = sorted(abilities_of(Device).keys() - set(dir(driver.abilities)))
    if missing:
        what = f"the abilities {driver.abilities.__name__} lack {', '.join(missing)} of every device"
        yield _at(driver.abilities, what, "derive it from cellctl.devices.Device")
    made = (
        inspect.get_annotations(driver.open, eval_str=True).get("return") if inspect.isfunction(driver.open) else None
    )
    if isinstance(made, type) and not getattr(made, "_is_protocol", False):
        yield from _undocumented(made)
        yield from _unmet(made, driver.abilities)


def _simulator(point: EntryPoint, simulator: Any) -> Iterator[Problem]:
    yield from _callable(point, "start", simulator.start, "setup")
    for scheme in sorted(set(simulator.schemes) - set(DriverRegistry().schemes())):
        yield _at_module(point, f"simulates '{scheme}://', for which no driver is installed", "install its driver")
    for setting in simulator.settings:
        if not setting.what:
            yield _at_module(point, f"the setting '{setting.name}' has no text", "state it in `what=`, with its unit")


def _steps(point: EntryPoint, module: ModuleType) -> Iterator[Problem]:
    kinds_here = [kind for kind in vars(module).values() if isinstance(kind, StepKind)]
    names = [kind.name for kind in kinds_here]
    for name in sorted({name for name in names if names.count(name) > 1}):
        yield _at_module(point, f"two functions are the step '{name}'", "only the last one counts: rename one")
    registry = StepRegistry.installed()
    described = [each.name for each in getattr(module, "STEPS", ())]
    if not (names or described):
        yield _at_module(point, "holds no step", 'write `@step("family.verb")` above an async function')
    for name in (*names, *described):
        try:
            kind = registry.find(name)
        except Exception as error:  # of the registry, or of a module that it imports
            yield _at_module(point, str(error))
            return
        yield from _undocumented(kind.inputs)
        for protocol in (*kind.needs.values(), *kind.uses.values()):
            yield from _undocumented(protocol)


def _section(point: EntryPoint, section: Any) -> Iterator[Problem]:
    yield from _callable(point, "build", section.build, "run")
    for row in section.needs:
        yield from _undocumented(row)


def _effect(point: EntryPoint, effect: type) -> Iterator[Problem]:
    if not issubclass(effect, Effect):
        yield _at(effect, f"{effect.__name__} is not derived from cellctl.calibration.Effect")
        return
    yield from _abstract(effect)
    yield from _undocumented(effect)
    for name in ("group", "title"):
        if not getattr(effect, name, ""):
            yield _at(effect, f"{effect.__name__} has no {name}", "state it as a ClassVar")
    yield from _taken(effect, "effect", getattr(effect, "group", ""), kinds())


def _row_kind(point: EntryPoint, kind: Any) -> Iterator[Problem]:
    yield from _abstract(kind.rows)
    yield from _undocumented(kind.rows)
    yield from _taken(kind, "row kind", point.name, KINDS, point)
    for other, known in KINDS.items():
        if known is not kind and set(kind.filled_by or kind.columns) <= set(known.filled_by or known.columns):
            cure = "a kind needs a column of its own"
            yield _at_module(point, f"its columns {', '.join(kind.columns)} are those of the kind '{other}'", cure)


def _method(point: EntryPoint, method: Any) -> Iterator[Problem]:
    yield from _callable(point, "correction", method.correction, "controller", "robot", "targets", "now")
    yield from _undocumented(method.correction)
    yield from _taken(method, "method", point.name, METHODS, point)


_CHECKS: Mapping[str, Callable[[EntryPoint, Any], Iterator[Problem]]] = {
    "DriverDescription": _driver,
    "Simulator": _simulator,
    "module": _steps,
    "ReportSection": _section,
    "ABCMeta": _effect,
    "RowKind": _row_kind,
    "Method": _method,
}


def _unmet(made: type, protocol: type) -> Iterator[Problem]:
    """Where a device's class does not fulfil the Protocol of its driver: which method, and how it is called."""
    for name, wanted in sorted(abilities_of(protocol).items()):
        found = inspect.getattr_static(made, name, None)
        call = f"{name}{inspect.signature(wanted)}" if inspect.isfunction(wanted) else name
        if found is None:
            yield _at(made, f"{made.__name__} has no {call} of {protocol.__name__}")
        elif inspect.isfunction(wanted) and inspect.isfunction(found):
            if inspect.iscoroutinefunction(wanted) != inspect.iscoroutinefunction(found):
                word = "async" if inspect.iscoroutinefunction(wanted) else "no async"
                yield _at(found, f"{made.__name__}.{name} has to be {word}, as {protocol.__name__} declares it")
            if not _accepts(found, wanted):
                what = f"{made.__name__}.{name}{inspect.signature(found)} does not take what {protocol.__name__} gives"
                yield _at(found, what, f"declare it as {call}")


def _accepts(found: Callable[..., Any], wanted: Callable[..., Any]) -> bool:
    """Whether `found` can be called as `wanted` declares: by place and by name, with its optional parameters or not."""
    given = [each for each in inspect.signature(wanted).parameters.values() if each.kind is not each.VAR_KEYWORD][1:]
    needed = [each for each in given if each.default is each.empty]
    try:
        for some in (given, needed):
            inspect.signature(found).bind(None, *some)
            inspect.signature(found).bind(None, **{each.name: None for each in some})
    except TypeError:
        return False
    return True


def _callable(point: EntryPoint, what: str, function: Any, *given: str) -> Iterator[Problem]:
    try:
        inspect.signature(function).bind(*given)
    except (TypeError, ValueError) as error:
        yield _at_module(point, f"`{what}` cannot be called with ({', '.join(given)}): {error}")


def _abstract(kind: type) -> Iterator[Problem]:
    if missing := sorted(getattr(kind, "__abstractmethods__", ())):
        yield _at(kind, f"{kind.__name__} lacks {', '.join(missing)}", "its base class says what they return")


def _undocumented(found: Any) -> Iterator[Problem]:
    """A class without a docstring of its own, its public methods included; a function without one."""
    members = vars(found) if isinstance(found, type) else {}
    public = (one for name, one in members.items() if inspect.isfunction(one) and not name.startswith("_"))
    for one in (found, *public):
        text = one.__doc__ or ""  # a dataclass without one gets its signature
        if (not text or text.startswith(f"{one.__name__}(")) and not _of_ours(one):
            yield _at(one, f"{one.__qualname__} has no docstring", "state units, frames, shapes and errors")


def _of_ours(found: Any) -> bool:
    return str(found.__module__).partition(".")[0] == "cellctl"


def _taken(
    found: object, what: str, name: str, table: Mapping[str, object], point: EntryPoint | None = None
) -> Iterator[Problem]:
    """Raised where another one has the name: this one is not used."""
    if table.get(name, found) is not found:
        text, cure = f"is not used: another {what} has the name '{name}'", "give it another name"
        yield _at_module(point, text, cure) if point else _at(found, text, cure)


def _of_rows(modules: list[str]) -> Iterator[Problem]:
    """The row classes of the package, as far as its entry points import them."""
    every = list(_derived(Row))
    for row in (each for each in every if each.__module__.partition(".")[0] in modules):
        yield from _undocumented(row)
        own = vars(row)
        if not ("__dataclass_params__" in own and own["__dataclass_params__"].frozen):
            yield _at(row, f"{row.__name__} is no frozen dataclass", "write @dataclass(frozen=True) above it")
        rivals = [each for each in every if each is not row and "KIND" in own and vars(each).get("KIND") == own["KIND"]]
        for rival in rivals:
            what = f"{row.__name__} has the KIND '{own['KIND']}' of {rival.__module__}.{rival.__name__}"
            yield _at(row, what, "a journal cannot tell them apart: give it another KIND")


def _derived(kind: type[Row]) -> Iterator[type[Row]]:
    for each in kind.__subclasses__():
        yield each
        yield from _derived(each)


def _of_cell(file: Path, schemes: set[str]) -> Iterator[Problem]:
    drivers = DriverRegistry()
    try:
        cell = Cell.load(file, drivers)
    except InputError as error:
        yield from error.problems
        return
    if cell.simulated:
        yield from simulation_errors(cell.document, file)
    for name, address in cell.addresses.items():
        if address.scheme in schemes:
            given = replace(cell.surroundings(name, WallClock()), limits={_UNKNOWN_LIMIT: 1.0})
            if all(finding.warning for finding in drivers.findings(name, address, given)):
                what = f"{name}: the driver of '{address.scheme}://' declares no limits: it takes any name of one"
                cure = "refuse in `open` or `check_setup` the names in `surroundings.limits` that the driver lacks"
                yield cell.document.problem(("devices", name), what, cure)


def _of_procedure(file: Path) -> Iterator[Problem]:
    try:
        procedure = load_procedure(file)
        if procedure.cell:
            yield from checked(file, None, []).problems
        else:
            checked_parameters(procedure, [], StepRegistry.installed(), None)
    except InputError as error:
        yield from error.problems


def _at(found: Any, what: str, cure: str = "") -> Problem:
    """At the line of a class or function."""
    try:
        file, (_, line) = inspect.getsourcefile(found) or "", inspect.getsourcelines(found)
    except (OSError, TypeError):
        file, line = f"{found.__module__}.{found.__qualname__}", 0
    return Problem(file, line, 0, what, cure)


def _at_module(point: EntryPoint, what: str, cure: str = "") -> Problem:
    """At an entry point whose object states no line."""
    return Problem(f"{point.module} ({point.group}: {point.name})", 0, 0, what, cure)

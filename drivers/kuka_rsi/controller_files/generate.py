"""The controller's files, made from templates and from the cell's address and limits."""

from __future__ import annotations

import re
from importlib.resources import files
from xml.etree import ElementTree
from xml.sax.saxutils import escape

from cellctl.devices import Address, Surroundings
from drivers.kuka_rsi.axes import AXIS_NAMES
from drivers.kuka_rsi.controller_files.instructions import instructions
from drivers.kuka_rsi.controller_files.rsi_context import CONTEXT_NAME, Context, rsi_xml, rsix
from drivers.kuka_rsi.cyclic.limits import SearchLimits
from drivers.kuka_rsi.cyclic.online_limits import of_each
from drivers.kuka_rsi.eki.channel import SILENCE_S
from drivers.kuka_rsi.ethernet_config import read_ethernet_config
from drivers.kuka_rsi.settings import RsiSettings

KRL_FILES = (
    "cellctl.src",
    "cellctl.dat",
    "cellctl_sub.src",
    "cellctl_sub.dat",
    "cellctl_cmd.src",
    "cellctl_tab.src",
    "cellctl_sum.src",
    "cellctl_own.src",
)

_EKI_FILE = "cellctl_eki.xml"
_FLAGS = {"ALIVE": 401, "GO": 402, "HALT": 403, "RSI": 404, "DONE": 405}
_INTERRUPT = 21
_WILDCARDS = ("0.0.0.0", "::")


def controller_files(cell: str, address: Address, surroundings: Surroundings) -> dict[str, str]:
    """File name → text of all files that the controller of the cell named `cell` needs.

    Raises ValueError for errors in the address, the Ethernet configuration that it names, or the limits.
    """
    search = SearchLimits.from_settings(of_each(surroundings.limits)[0], surroundings.reach_mm)
    settings = RsiSettings.of(address, surroundings.folder)
    if errors := read_ethernet_config(settings).errors:
        raise ValueError("; ".join(errors))
    places = {
        "CELL": " ".join(cell.split()),
        "CONTEXT": CONTEXT_NAME,
        "MODE": settings.mode.upper(),
        "CYCLE": settings.cycle.upper(),
        "INTERRUPT": str(_INTERRUPT),
        "EKI_HOST": escape(settings.eki[0]),
        "EKI_PORT": str(settings.eki[1]),
        "SILENCE": f"{SILENCE_S:g}",
        "RECEIVE": "\n".join(f"      {element}" for element in _received()),
        **{f"FLAG_{name}": str(number) for name, number in _FLAGS.items()},
    }
    made = {name: _filled(_template(name), places) for name in (*KRL_FILES, _EKI_FILE)}
    made[settings.ethernet.name] = _ethernet(settings)
    context = _context(places["CELL"], settings, search)
    made |= {
        f"{CONTEXT_NAME}.rsix": _ascii_xml(rsix(context)),
        f"{CONTEXT_NAME}.rsi.xml": _ascii_xml(rsi_xml(context)),
    }
    made["README.txt"] = instructions(settings, search, context, _FLAGS, _INTERRUPT)
    return made


def _context(cell: str, settings: RsiSettings, limits: SearchLimits) -> Context:
    """The RSI context; its links are the channels (INDX) in the user's own Ethernet configuration."""
    elements = ElementTree.parse(settings.ethernet).iterfind("RECEIVE/ELEMENTS/ELEMENT")
    channels = {element.get("TAG", ""): element.get("INDX", "") for element in elements}
    return Context(
        cell=cell,
        ethernet=settings.ethernet.name,
        axes=tuple(int(channels[f"{settings.correction}.{axis}"]) for axis in AXIS_NAMES),
        stop=int(channels[settings.stop]),
        correction_deg=limits.correction_deg,
        timeout=settings.tolerance,
        mode=settings.mode,
        cycle=settings.cycle,
    )


def _ascii_xml(text: str) -> str:
    return text.encode("ascii", "xmlcharrefreplace").decode("ascii")


def _template(name: str) -> str:
    return files("drivers.kuka_rsi.controller_files").joinpath(name).read_text(encoding="ascii")


def _filled(template: str, places: dict[str, str]) -> str:
    """The template with every `@NAME@` replaced; ASCII, since KRL has no other characters."""
    text = re.sub(r"@([A-Z_]+)@", lambda found: places[found[1]], template)
    return text.encode("ascii", "replace").decode("ascii")


def _received() -> list[str]:
    """The elements that the channel parses: every attribute of a `<Cmd>` document, and its end."""
    kinds = {
        "Cmd/@Id": "INT",
        "Cmd/@Op": "STRING",
        "Cmd/Vel/@P": "REAL",
        **{f"Cmd/Q/@{axis}": "REAL" for axis in AXIS_NAMES},
        "Cmd/Row/@N": "INT",
        "Cmd/Table/@Id": "STRING",
        "Cmd/Table/@Serial": "STRING",
        "Cmd/Table/@Rows": "INT",
        "Cmd/Table/@Sum": "STRING",
        "Cmd/Block/@First": "INT",
        "Cmd/Block/@Count": "INT",
        "Cmd/Block/@Sum": "STRING",
        "Cmd/R/@N": "INT",
        **{f"Cmd/R/{group}/@{axis}": "STRING" for group in "QC" for axis in AXIS_NAMES},
    }
    return [f'<ELEMENT Tag="{tag}" Type="{kind}"/>' for tag, kind in kinds.items()]


def _ethernet(settings: RsiSettings) -> str:
    """The user's own file, with host and port of the address if it has them."""
    text = settings.ethernet.read_text(encoding="utf-8")
    host, port = settings.bind
    if host not in _WILDCARDS:
        text = re.sub(r"(<IP_NUMBER>)[^<]*(</IP_NUMBER>)", rf"\g<1>{escape(host)}\g<2>", text)
    return re.sub(r"(<PORT>)[^<]*(</PORT>)", rf"\g<1>{port}\g<2>", text) if port else text

"""The controller's files, made from templates and the cell's address and limits, and README.txt to load them by."""

from __future__ import annotations

import re
from importlib.resources import files
from xml.etree import ElementTree
from xml.sax.saxutils import escape

from cellctl.devices import Address, Surroundings
from drivers.kuka_rsi import AXIS_NAMES
from drivers.kuka_rsi.controller_files.rsi_context import (
    CONTEXT_NAME,
    MONITOR_ABOVE_DEG,
    PRECISION,
    Context,
    rsi_xml,
    rsix,
)
from drivers.kuka_rsi.cyclic.limits import SearchLimits, of_each
from drivers.kuka_rsi.eki.channel import ANSWER_S, SILENCE_S
from drivers.kuka_rsi.eki.tables import BLOCK_ROWS
from drivers.kuka_rsi.ethernet_config import read_ethernet_config
from drivers.kuka_rsi.settings import RsiSettings

_PLACES = """\
WHERE EACH FILE GOES (KSS, on the controller, user group Expert)

  cellctl.src, cellctl.dat           KRC:\\R1\\Program\\
  cellctl_sub.src, cellctl_sub.dat   KRC:\\R1\\Program\\
  cellctl_cmd.src, cellctl_tab.src   KRC:\\R1\\Program\\
  cellctl_sum.src, cellctl_own.src   KRC:\\R1\\Program\\  (cellctl_own.src: your own programs; keep yours)
  cellctl_eki.xml                    C:\\KRC\\ROBOTER\\Config\\User\\Common\\EthernetKRL\\
  {ethernet:34} C:\\KRC\\ROBOTER\\Config\\User\\Common\\SensorInterface\\
  cellctl.rsix                       the same folder, with RSI 4 or 5 (KSS 8.5 and later)
  cellctl.rsi.xml                    the same folder, with RSI 3 (KSS 8.2 to 8.4), in place of cellctl.rsix

  In a WorkVisual project these folders are KRC/R1/Program and Config/User/Common/...

  In the submit program (SPS.SUB, or one of your own from KSS 8.3 on):
    in its INIT section   CC_INIT( )
    in its loop           CC_CYCLE( )

  iiQKA.OS2 (RSI 6): these files do not run there. Its EthernetKRL has other functions (EKI_Load, EKI_ReadNext) and
  another channel format, and iiQWorks.Sim imports no context of RSI 5 or older. There a context belongs under
  Config/RobotSensorInterface/Context, the Ethernet configuration under Config/RobotSensorInterface/Ethernet
  configuration, the channel under Config/EthernetKRL/Ethernet configuration.
"""

_CONTEXT_TEXT = """\
RSI CONTEXT "{context}" (cellctl.rsix, cellctl.rsi.xml: what the controller reads; RSI Visual has no drawing of it)

  Made for      {rsi_on}, corrections {mode}; a telegram each {cycle} ms
  ETHERNET      ConfigFile {ethernet}, Timeout {timeout} (late answers: {patience:g} s at {cycle} ms),
                Flag -1 (none), Precision {precision} (1, the default, would round every joint to 0.1 degrees)
  AXISCORR      CorrA1 ... CorrA6 from the ETHERNET outputs {outputs};
                LowerLim / UpperLim of each axis -{correction:g} / +{correction:g} (degrees, from the pose at RSI_ON)
  AXISCORRMON   MaxA1 ... MaxA6 {monitor:g}: RSI stops there
  STOP          from the ETHERNET output {stop}; Mode 4 (ExitMoveCorr): it ends RSI_MOVECORR( )
  It follows the cell file and the Ethernet configuration: after a change there, generate it again.
  Do not add a link from an ETHERNET output to an ETHERNET input, nor objects for external axes that the robot lacks.

  Limits of the cell file, which the computer keeps: correction {correction:g} deg, travel {travel:g} deg,
  speed {speed:g} deg/s, acceleration {acceleration:g} deg/s2, jerk {jerk:g} deg/s3.
  The context has the same correction limits: they hold where the computer fails to.
"""

_NETWORK = """\
NETWORK

  RSI           this computer: {bind}, UDP port {port}; a subnet of its own, not the KLI's, not 192.0.1.x
  EthernetKRL   the controller: {eki_host}, TCP port {eki_port} (54600 ... 54615), released in its NAT
"""

_FLAGS_TEXT = """\
WHAT IS USED ON THE CONTROLLER (has to be free; the numbers stand in cellctl.dat and cellctl_eki.xml)

  {flags}
  interrupt {interrupt}; names that begin with CC_; $ADVANCE = 0
  Speeds are whole percent: 12.7 becomes 12, anything under 1 becomes 1.
"""

_FIRST = """\
FIRST START

  1. T1, override 10 %, nobody in the cell. Select CELLCTL, drive the BCO run. Start the submit interpreter.
  2. `cellctl check` with this cell; then let it connect. The pendant shows nothing; `Stat` comes every 100 ms.
  3. In T1 every move is refused (code 12). For first moves at the enabling switch set CC_ALLOW_T1=TRUE in cellctl.dat;
     the first RSI activation asks at the pendant: "Attention - Sensor correction goes active". Back to FALSE after.
  4. EXT: start CELLCTL, run.
"""

_VERIFY = """\
NOT TRIED ON A REAL CONTROLLER

  The files were written from published descriptions, for KSS 8.5 to 8.7, EthernetKRL 3 and RSI 4 or 5. cellctl's
  tests run the conversation (not the motion) in a small KRL interpreter of their own, against the documents that the
  computer sends; nobody has loaded the files on a KRC. Try in T1, in this order, before anything else relies on them:

   1. EKI_Send with a text and its length (EthernetKRL 3; 2.x knows no third argument), in pieces of one document.
   2. HALT while PTP runs, and while RSI_MOVECORR( ) runs: the interrupt brakes, RESUME comes back, RSI is off after it.
   3. STOP in the context ends RSI_MOVECORR( ) (Mode 4), and `PTP $AXIS_ACT_MEAS` does not move the robot.
   4. Pull the EthernetKRL cable while it moves: it brakes, and the next connection is accepted.
   5. RESET: CONFIRM, STOP, CANCEL and RUN by CWRITE($CMD, ...) in the submit interpreter, and the path in RUN.
   6. Get_MsgBuffer and its fields: the number in `Msg` is that of the message at the pendant.
   7. Push a table, switch the controller off and on: `cellctl table show` still names it.
   8. While a block of {rows} rows is taken (its sums are worked out in KRL), `Stat` goes on coming. The computer waits
      {silence:g} s for a word and {answer:g} s for the answer.
   9. $V_R1MADA[] in HELLO, as this KSS wants it.
  10. RSI_CREATE takes the context: `cellctl.rsix` was written from published contexts, without their drawing part.
  11. On-line correction: with RSI_ON and no RSI_MOVECORR( ), PTP runs as without, ASPos is the program's place and does
      not move with a correction of 0.1 degrees (in T1, at rest), RSI_OFF and the next PTP leave no step.
"""


def instructions(
    settings: RsiSettings, limits: SearchLimits, context: Context, flags: dict[str, int], interrupt: int
) -> str:
    """The text; `context`: the RSI context as generated, `flags`: purpose → number, `interrupt`: its number."""
    host, port = settings.bind
    parts = [
        "cellctl on a KUKA controller: not tried on a real one, see the last section\n",
        _PLACES.format(ethernet=context.ethernet),
        _CONTEXT_TEXT.format(context=CONTEXT_NAME, **_context_words(context), **_limits(limits)),
        _NETWORK.format(
            bind="the address in IP_NUMBER" if host in ("0.0.0.0", "::") else host,
            port=port or "as in PORT",
            eki_host=settings.eki[0],
            eki_port=settings.eki[1],
        ),
        _FLAGS_TEXT.format(
            flags=", ".join(f"$FLAG[{number}] {name}" for name, number in flags.items()), interrupt=interrupt
        ),
        _FIRST,
        _VERIFY.format(rows=BLOCK_ROWS, silence=SILENCE_S, answer=ANSWER_S),
    ]
    return "\n".join(parts)


def _context_words(context: Context) -> dict[str, object]:
    return {
        "ethernet": context.ethernet,
        "timeout": context.timeout,
        "patience": context.timeout * context.cycle.milliseconds / 1000,
        "rsi_on": context.rsi_on,
        "cycle": context.cycle.milliseconds,
        "mode": context.mode,
        "precision": PRECISION,
        "outputs": ", ".join(map(str, context.axes)),
        "stop": context.stop,
        "correction": context.correction_deg,
        "monitor": context.correction_deg + MONITOR_ABOVE_DEG,
    }


def _limits(limits: SearchLimits) -> dict[str, float]:
    return {
        "travel": limits.travel_deg,
        "speed": limits.speed_deg_s,
        "acceleration": limits.acceleration_deg_s2,
        "jerk": limits.jerk_deg_s3,
    }


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
"""Numbers of $FLAG and of the interrupt: chosen high, as programs take the first ones for themselves. README.txt names
them: they have to be free."""
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

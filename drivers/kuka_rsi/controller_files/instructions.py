"""README.txt for whoever loads the files: what goes where, what to draw in RSI Visual, what has to be tried first."""

from __future__ import annotations

from xml.etree import ElementTree

from drivers.kuka_rsi.limits import SearchLimits
from drivers.kuka_rsi.settings import RsiSettings

_PLACES = """\
WHERE EACH FILE GOES (on the controller, user group Expert)

  cellctl.src, cellctl.dat           KRC:\\R1\\Program\\
  cellctl_sub.src, cellctl_sub.dat   KRC:\\R1\\Program\\
  cellctl_cmd.src, cellctl_tab.src   KRC:\\R1\\Program\\
  cellctl_sum.src                    KRC:\\R1\\Program\\
  cellctl_eki.xml                    C:\\KRC\\ROBOTER\\Config\\User\\Common\\EthernetKRL\\
  {ethernet:34} C:\\KRC\\ROBOTER\\Config\\User\\Common\\SensorInterface\\
  {context_file:34} the same folder: you draw it in RSI Visual, below

  In the submit program (SPS.SUB, or one of your own from KSS 8.3 on):
    in its INIT section   CC_INIT( )
    in its loop           CC_CYCLE( )
"""

_CONTEXT = """\
RSI CONTEXT "{context}" (RSI Visual)

  ETHERNET      ConfigFile {ethernet}, Timeout 100 (cycles, 0.4 s at 4 ms), Precision 4 or more
                (1, the default, would round every joint to 0.1 degrees)
  AXISCORR      CorrA1 ... CorrA6 from the ETHERNET outputs {outputs};
                LowerLim / UpperLim of each axis -{correction:g} / +{correction:g} (degrees, from the pose at RSI_ON)
  AXISCORRMON   MaxA1 ... MaxA6 {monitor:g}. Without it the ceiling is 6 degrees
  STOP          input from ETHERNET output {stop}; Mode ExitMoveCorr (4): it ends RSI_MOVECORR( )
  Do not wire an ETHERNET output back to an ETHERNET input, and no objects for external axes that the robot lacks.

  Limits of the cell file, which the computer keeps: correction {correction:g} deg, travel {travel:g} deg,
  speed {speed:g} deg/s, acceleration {acceleration:g} deg/s2, jerk {jerk:g} deg/s3.
  The controller is to have the same correction limits: they are the second fence.
"""

_NETWORK = """\
NETWORK

  RSI           this computer: {bind}, UDP port {port}; a subnet of its own, not the KLI's, not 192.0.1.x
  EthernetKRL   the controller: {eki_host}, TCP port {eki_port} (54600 ... 54615), released in its NAT
"""

_FLAGS = """\
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

  The programs were written from published descriptions, for KSS 8.5 to 8.7, EthernetKRL 3 and RSI 4 or 5. cellctl's
  tests run the conversation (not the motion) in a small KRL interpreter of their own, against the documents that the
  computer sends; nobody has run the programs on a KRC. Try in T1, in this order, before anything else relies on them:

   1. EKI_Send with a text and its length (EthernetKRL 3; 2.x knows no third argument), in pieces of one document.
   2. HALT while PTP runs, and while RSI_MOVECORR( ) runs: the interrupt brakes, RESUME comes back, RSI is off after it.
   3. STOP in the context ends RSI_MOVECORR( ) (Mode 4), and `PTP $AXIS_ACT_MEAS` does not move the robot.
   4. Pull the EthernetKRL cable while it moves: it brakes, and the next connection is accepted.
   5. RESET: CONFIRM, STOP, CANCEL and RUN by CWRITE($CMD, ...) in the submit interpreter, and the path in RUN.
   6. Get_MsgBuffer and its fields: the number in `Msg` is that of the message at the pendant.
   7. Push a table, switch the controller off and on: `cellctl table show` still names it.
   8. A block of ten rows is answered in well under ten seconds (the sums are worked out in KRL).
   9. Text parameters (NAME:IN with DECL CHAR NAME[]) and $V_R1MADA[] in HELLO, as this KSS wants them.
"""


def instructions(
    settings: RsiSettings, limits: SearchLimits, flags: dict[str, int], interrupt: int, context: str
) -> str:
    """The text; `flags`: purpose → number, `interrupt`: its number, `context`: the RSI context's name."""
    host, port = settings.bind
    parts = [
        "cellctl on a KUKA controller\n",
        _PLACES.format(ethernet=settings.ethernet.name, context_file=f"{context}.rsix"),
        _CONTEXT.format(context=context, ethernet=settings.ethernet.name, **_outputs(settings), **_limits(limits)),
        _NETWORK.format(
            bind="the address in IP_NUMBER" if host in ("0.0.0.0", "::") else host,
            port=port or "as in PORT",
            eki_host=settings.eki[0],
            eki_port=settings.eki[1],
        ),
        _FLAGS.format(
            flags=", ".join(f"$FLAG[{number}] {name}" for name, number in flags.items()), interrupt=interrupt
        ),
        _FIRST,
        _VERIFY,
    ]
    return "\n".join(parts)


def _outputs(settings: RsiSettings) -> dict[str, str]:
    """Numbers of the ETHERNET object's outputs, by what they carry."""
    elements = ElementTree.parse(settings.ethernet).iterfind("RECEIVE/ELEMENTS/ELEMENT")
    channels = {element.get("TAG", ""): element.get("INDX", "") for element in elements}
    axes = [channels[f"{settings.correction}.A{axis}"] for axis in range(1, 7)]
    return {"outputs": ", ".join(axes), "stop": channels[settings.stop]}


def _limits(limits: SearchLimits) -> dict[str, float]:
    return {
        "correction": limits.correction_deg,
        "monitor": limits.correction_deg + 1.0,
        "travel": limits.travel_deg,
        "speed": limits.speed_deg_s,
        "acceleration": limits.acceleration_deg_s2,
        "jerk": limits.jerk_deg_s3,
    }

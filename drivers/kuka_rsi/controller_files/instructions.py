"""README.txt for loading the files: where each file goes, the RSI context's content, and what to test first."""

from __future__ import annotations

from drivers.kuka_rsi.controller_files.rsi_context import CONTEXT_NAME, MONITOR_ABOVE_DEG, PRECISION, Context
from drivers.kuka_rsi.cyclic.limits import SearchLimits
from drivers.kuka_rsi.eki.channel import ANSWER_S, SILENCE_S
from drivers.kuka_rsi.eki.table_rows import BLOCK_ROWS
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

_CONTEXT = """\
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
        _CONTEXT.format(context=CONTEXT_NAME, **_context(context), **_limits(limits)),
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
        _VERIFY.format(rows=BLOCK_ROWS, silence=SILENCE_S, answer=ANSWER_S),
    ]
    return "\n".join(parts)


def _context(context: Context) -> dict[str, object]:
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

"""What the simulated controller is to the rest: its scheme, settings, faults and events."""

from __future__ import annotations

from sims.faults import MOVE, SEARCH, SEARCH_END
from sims.simulator import FOR_MS, FaultKind, Setting, Setup, Simulator, Started


def _start(setup: Setup) -> Started:
    from sims.krc._controller import start  # when a cell has the device

    return start(setup)


SIMULATOR = Simulator(
    schemes=("kuka+rsi",),
    start=_start,
    section="rsi",
    settings=(
        Setting(
            "cycle_ms",
            "whole",
            among=(4, 12),
            what="Cycle. Without it: as the robot's address says.",
            measured="telegrams.cycle_ms",
        ),
        Setting("precision", "whole", 4, what="Decimals of a telegram's numbers."),
        Setting("timeout_cycles", "whole", 100, 1, what="Tolerated late cycles."),
        Setting(
            "counter",
            "word",
            "total",
            among=("total", "reset"),
            what="Does a good reply reset the late count, and Delay?",
        ),
        Setting(
            "mode",
            "word",
            among=("absolute", "relative"),
            what="What the program passes to RSI_ON. Without it: as the robot's address says.",
        ),
        Setting(
            "mark",
            "word",
            "session",
            among=("session", "none"),
            what="Does the program mark its RSI sessions?",
            measured="telegrams.mark",
        ),
        Setting(
            "port",
            "word",
            "kept",
            among=("kept", "new"),
            what="UDP port of the next RSI session.",
            measured="telegrams.port",
        ),
        Setting(
            "jitter_ms",
            "number",
            0.0,
            0.0,
            what="Median delay of a telegram on its way, exponential, 0.8 of a cycle at most.",
            measured="telegrams.jitter_ms",
        ),
        Setting(
            "lag_ms",
            "number",
            None,
            0.0,
            what="Lag of an axis at constant speed. Without it: 24 ms times errors.servo.",
            measured="stop.lag_ms",
        ),
        Setting("t1", "word", "allowed", among=("allowed", "refused"), what="Does the program move in T1?"),
        Setting("restart_cycles", "whole", 3, 1, what="Cycles from a session's end to the next one, at `rsi.restart`."),
        Setting("hello", "word", "rsi_on", among=("rsi_on", "short"), what="Does HELLO name RSI_ON's mode and cycle?"),
    ),
    faults=(
        FaultKind("rsi.silent", "`RSI_ON` succeeds, no telegram ever comes"),
        FaultKind("rsi.sentype", "the controller expects another `SENTYPE`: every reply counts as faulty"),
        FaultKind("rsi.stall", "replies are lost on the way", (FOR_MS,)),
        FaultKind("rsi.drop", "telegrams to the host are lost", (FOR_MS,)),
        FaultKind("rsi.restart", "the program ends RSI and switches it on again; the host is not told", momentary=True),
        FaultKind("robot.stop", "the operator's stop: the controller brakes and shows a message", momentary=True),
        FaultKind("robot.restart", "the controller restarts", momentary=True),
    ),
    events={
        MOVE: "a point-to-point move begins",
        SEARCH: "RSI is on for a search",
        SEARCH_END: "the search's last reply has been sent",
    },
)

"""The health of controller and RSI process, as text and figures."""

from __future__ import annotations

from cellctl.devices import Health
from drivers.kuka_rsi.cyclic.shared_block import Slot
from drivers.kuka_rsi.robot.lines import ControllerLines
from drivers.kuka_rsi.robot.searching import foreign_datagrams

_COUNTED = (
    Slot.TELEGRAMS,
    Slot.LATE,
    Slot.LATE_REPORTED,
    Slot.LOST,
    Slot.SKIPPED,
    Slot.STALE,
    Slot.BEYOND,
    Slot.MALFORMED,
    Slot.FOREIGN,
)

_WITHOUT = {
    "fifo": "no real-time priority for RSI (grant CAP_SYS_NICE or an rtprio limit)",
    "mlock": "the memory of RSI is not locked (grant CAP_IPC_LOCK or a memlock limit)",
    "affinity": "RSI has no processor of its own (isolcpus)",
}


def health_of(lines: ControllerLines) -> Health:
    """State of controller and RSI process; counts since the lines were opened. Raises DeviceLost."""
    process, eki = lines.process, lines.eki
    stat = eki.stat
    words = process.block.words
    figures = {slot.name.lower(): float(words[slot]) for slot in _COUNTED}
    figures |= {"cycle_ms": words[Slot.CYCLE] * 1e-6, "real_time": float(process.granted["fifo"])}
    figures |= {"memory_locked": float(process.granted["mlock"]), "pinned": float(process.granted["affinity"])}
    figures |= {"unreadable": float(eki.unreadable), "latency_ms": lines.latency_s * 1e3}
    text = f"{stat.mode}, {stat.program}" + (f": {stat.message}" if stat.message else "")
    text += "".join(f"; {what}" for name, what in _WITHOUT.items() if not process.granted[name])
    if words[Slot.FOREIGN]:
        text += f"; {foreign_datagrams(process)}"
    return Health(stat.program != "ERROR" and stat.mode == "EXT", text, figures, stat.mode)
